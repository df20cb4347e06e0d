"""COCO keypoints and panoptic segmentation; instances are in test_datasets.py."""

import json

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

POINTS = {"top": (0, 0, 0.2), "east": (0.2, 0, 0), "west": (-0.2, 0, 0)}


class Kept(hd.Coco):
    """COCO that keeps the frames."""

    def write(self, image):
        vars(self).setdefault("_frames", {})[image.index] = image.frame
        return super().write(image)


@pytest.fixture(scope="module")
def made(client, tmp_path_factory):
    """(directory, frames) of three balls with keypoints, an arm of two of them, and two floors."""
    out = tmp_path_factory.mktemp("coco")
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=1)
            edit.categories("ball", "ground", "arm", "unseen")
            mesh = edit.mesh(
                "mesh", **hg.shapes.sphere(0.2), keypoints=POINTS, skeleton=[(0, 1), (1, 2)]
            )
            hand = {"tip": (0, 0, 0.1)}
            small = edit.mesh("small", **hg.shapes.sphere(0.1), keypoints=hand)
            plane = edit.mesh("plane", **hg.shapes.plane(3))
            for side in (-1.5, 1.5):
                pose = hg.Pose((side, 0, 0))
                edit.entity(f"floor{side}", mesh=plane, category="ground", transform=pose)
            poses = [hg.Pose((0.5 * i - 0.5, 0, 0.2)) for i in range(3)]
            balls = edit.instances("ball", mesh=mesh, transforms=poses, category="ball")
            arm = edit.entity("arm", mesh=mesh, transform=hg.Pose((0, 1, 0.2)), category="arm")
            edit.entity("arm/hand", parent=arm, mesh=small, transform=hg.Pose((0, 0, 0.3)))
            lens = hg.Camera.from_fov(50, 96, 72, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -2, 1), (0, 0, 0.2)))

        def scatter(draw):
            for ball in balls:
                position = (*draw.rng.uniform(-1.2, 1.2, 2), 0.2)
                draw.place(ball, [hg.Pose(position, euler=(0, 0, draw.rng.uniform(0, 6)))])

        writer = Kept(out, keypoints=True, panoptic=True, stuff=["ground"])
        hd.generate(scene, "cam", scatter, count=6, spp=1, writer=writer)
    return out, writer._frames


def test_keypoints_are_those_of_the_labels(made):
    out, frames = made
    coco = COCO(out / "annotations/keypoints.json")
    classes = {c["name"]: c for c in coco.loadCats(coco.getCatIds())}
    assert classes["ball"]["keypoints"] == list(POINTS)
    assert classes["ball"]["skeleton"] == [[1, 2], [2, 3]]
    assert classes["arm"]["keypoints"] == [*POINTS, "tip"]
    assert sorted(classes) == ["arm", "ball"]
    states = set()
    for ann in coco.anns.values():
        labels = frames[ann["image_id"]].labels
        rows = np.flatnonzero(labels["keypoint_instance"] == ann["instance"])
        points = np.array(ann["keypoints"]).reshape(-1, 3)
        assert len(points) == len(rows)
        assert ann["num_keypoints"] == (points[:, 2] > 0).sum()
        for (x, y, v), row in zip(points, rows, strict=True):
            state = labels["keypoint_state"][row]
            assert v == {0: 0, 1: 1, 2: 1, 3: 2}[state]
            expected = labels["keypoint_image"][row] if state else (0, 0)
            np.testing.assert_allclose((x, y), expected, rtol=1e-6)
            states.add(v)
    assert states == {0, 1, 2}


def test_annotations_have_one_id_in_both_files(made):
    out, _ = made
    instances, keypoints = (
        COCO(out / f"annotations/{name}.json") for name in ("instances", "keypoints")
    )
    assert keypoints.anns
    for number, ann in keypoints.anns.items():
        other = instances.anns[number]
        assert ann == {**ann, **other}
        assert "keypoints" not in other
    assert {c["name"] for c in instances.cats.values()} == {"ball", "arm", "unseen"}


def test_perfect_detections_score_one(made):
    out, _ = made
    truth = COCO(out / "annotations/keypoints.json")
    found = truth.loadRes([{**ann, "score": 1.0} for ann in truth.anns.values()])
    for kind in ("bbox", "segm"):
        scores = COCOeval(truth, found, kind)
        scores.evaluate()
        scores.accumulate()
        scores.summarize()
        assert scores.stats[0] == 1.0


def test_panoptic_ids_are_colours(made):
    out, frames = made
    table = json.loads((out / "annotations/panoptic.json").read_text())
    things = {c["id"]: c["isthing"] for c in table["categories"]}
    assert things == {1: 1, 2: 0, 3: 1, 4: 1}
    assert len(table["annotations"]) == len(frames)
    for row in table["annotations"]:
        labels, ids = frames[row["image_id"]].labels, frames[row["image_id"]]["instance"]
        pixels = np.asarray(Image.open(out / "panoptic" / row["file_name"])).astype(int)
        seen = pixels @ (1, 256, 65536)
        segments = {s["id"]: s for s in row["segments_info"]}
        assert set(np.unique(seen)) - {0} == set(segments)
        for number, segment in segments.items():
            ys, xs = np.nonzero(seen == number)
            x, y, w, h = segment["bbox"]
            assert (x, y, x + w, y + h) == (xs.min(), ys.min(), xs.max() + 1, ys.max() + 1)
            assert segment["area"] == len(xs)
            if segment["category_id"] == 2:
                grounds = labels["label"][labels["category"] == 2]
                np.testing.assert_array_equal(seen == number, np.isin(ids, grounds))
            else:
                np.testing.assert_array_equal(seen == number, ids == number)
        assert sum(s["category_id"] == 2 for s in segments.values()) == 1
        assert (seen == 0).sum() == (ids == 0).sum()


def test_what_coco_cannot_say_is_refused(client, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2))
            ball = edit.entity("ball", mesh=mesh)
            edit.entity("cam", camera=hg.Camera.from_fov(1, 32, 32))

        def begin(**options):
            writer = hd.Coco(tmp_path, **options)
            hd.generate(scene, "cam", lambda draw: None, count=1, writer=writer, resume=False)

        with pytest.raises(hg.FailedPrecondition, match="needs categories"):
            begin()
        with scene.edit() as edit:
            edit.update(ball, category="ball")
        with pytest.raises(hg.FailedPrecondition, match="has keypoints: give meshes"):
            begin(keypoints=True)
        with pytest.raises(hg.InvalidArgument, match="no category 'sky'; there are ball") as error:
            begin(stuff=["sky"])
        assert error.value.field == "stuff"
        with scene.edit() as edit:
            edit.mesh(mesh, **hg.shapes.sphere(0.2), keypoints={"a": (0, 0, 0)})
            other = edit.mesh("other", **hg.shapes.sphere(0.2), keypoints={"b": (0, 0, 0)})
            edit.entity("other ball", mesh=other, category="ball")
        with pytest.raises(hg.FailedPrecondition, match="other ball has the keypoints b, others"):
            begin(keypoints=True)


def test_a_crowd_is_no_instance(client, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=1)
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2))
            for label, x in ((50, 0.1), (50, 0.5), (60, -0.5)):
                edit.entity(
                    f"ball at {x}",
                    mesh=mesh,
                    label=label,
                    group=label == 50,
                    category="ball",
                    transform=hg.Pose((x, 0, 0)),
                )
            lens = hg.Camera.from_fov(50, 96, 72, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))

        def flock(draw):
            for x in (0.3, 0.6):
                place = hg.Pose((x, 0, 0.5))
                draw.edit.entity(
                    f"bird at {x}",
                    mesh=mesh,
                    label=70,
                    group=True,
                    category="ball",
                    transform=place,
                )

        writer = hd.Coco(tmp_path, panoptic=True)
        hd.generate(scene, "cam", flock, count=2, spp=1, writer=writer)
    for name, key in (("instances", "instance"), ("panoptic", "id")):
        annotations = json.loads((tmp_path / f"annotations/{name}.json").read_text())["annotations"]
        rows = [r for a in annotations for r in a.get("segments_info", [a])]
        assert {(r[key], r["iscrowd"]) for r in rows} == {(50, 1), (60, 0), (70, 1)}
    assert hd.validate(tmp_path).ok
