"""generate(), draws, resuming, shards and COCO instances against a real daemon."""

import json
import pathlib
import re

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from balls import BALLS, SIZE, files, furnished, make, scatter, spin, stage
from PIL import Image
from pycocotools import mask as oracle
from pycocotools.coco import COCO

__all__ = ["stage"]


def test_coco_instances_are_what_pycocotools_reads(stage, tmp_path):
    scene, balls, cam = stage
    frames = {}

    class Kept(hd.Coco):
        def write(self, image):
            frames[image.index] = image.frame
            return super().write(image)

    done = make(stage, tmp_path, writer=Kept(tmp_path))
    assert (done.images, done.skipped, done.complete) == (3, 0, True)
    coco = COCO(tmp_path / "annotations/instances.json")
    assert coco.getImgIds() == [0, 1, 2]
    assert sorted(coco.anns) == list(range(1, len(coco.anns) + 1))
    assert [c["name"] for c in coco.loadCats(coco.getCatIds())] == ["cube", "ball"]
    seen = 0
    for index, frame in frames.items():
        entry = coco.loadImgs(index)[0]
        picture = np.asarray(Image.open(tmp_path / "images" / entry["file_name"]))
        np.testing.assert_array_equal(picture, frame.image(exposure="auto"))
        for ann in coco.loadAnns(coco.getAnnIds(index)):
            mask = frame["instance"] == ann["instance"]
            np.testing.assert_array_equal(coco.annToMask(ann), mask)
            assert ann["area"] == oracle.area(ann["segmentation"]) == mask.sum()
            assert ann["bbox"] == oracle.toBbox(ann["segmentation"]).tolist()
            assert ann["category_id"] == 2
            seen += 1
        visible = frame.labels["visible"] > 0
        assert len(coco.getAnnIds(index)) == visible.sum()
    assert seen >= 5
    poses = [frame.labels["world_from_object"] for frame in frames.values()]
    assert not np.allclose(poses[0], poses[1])


def test_several_writers_have_what_each_has_alone(stage, tmp_path):
    make(stage, tmp_path / "alone", seed=5)
    writers = [
        hd.Coco(tmp_path / "coco"),
        hd.Yolo(tmp_path / "yolo", task="seg"),
        hd.Parquet(tmp_path / "tables"),
    ]
    make(stage, None, writer=writers, seed=5)
    for name, data in files(tmp_path / "alone").items():
        if name.startswith(("images/", "annotations/")):
            assert (tmp_path / "coco" / name).read_bytes() == data
    (tmp_path / "yolo/.heliograph/records/000001.json").unlink()
    again = make(stage, None, writer=writers, seed=5)
    assert (again.images, again.skipped) == (1, 2)
    assert hd.validate(tmp_path / "coco").ok and hd.validate(tmp_path / "yolo").ok
    with pytest.raises(hg.InvalidArgument, match="each with a directory of its own"):
        make(stage, None, writer=[hd.Coco(tmp_path / "x"), hd.Yolo(tmp_path / "y/../x")])


def test_the_same_seed_gives_the_same_bytes_in_shards_too(stage, tmp_path):
    make(stage, tmp_path / "a", seed=7)
    shard = make(stage, tmp_path / "b", seed=7, indices=[2])
    assert not shard.complete
    assert not (tmp_path / "b/annotations").exists()
    rest = make(stage, tmp_path / "b", seed=7, indices=range(2), credits=1)
    assert (rest.images, rest.complete) == (2, True)
    whole = files(tmp_path / "a")
    assert whole == files(tmp_path / "b")
    make(stage, tmp_path / "c", seed=8)
    assert whole["images/000000.png"] != files(tmp_path / "c")["images/000000.png"]


def test_cameras_of_a_draw_see_the_same_and_share_a_split(stage, tmp_path):
    shares = {"train": 0.6, "val": 0.4}
    make(stage, tmp_path, count=10, cameras=["cam", "side"], splits=shares, spp=1)
    split = {}
    for name in shares:
        coco = COCO(tmp_path / f"annotations/instances_{name}.json")
        for entry in coco.loadImgs(coco.getImgIds()):
            split[entry["id"]] = name
            assert (tmp_path / "images" / name / entry["file_name"]).exists()
    assert sorted(split) == list(range(10))
    assert list(split.values()).count("val") == 4
    assert all(split[i] == split[i + 1] for i in range(0, 10, 2))


def test_labels_are_accepted_before_anything_is_shaded(stage, tmp_path):
    asked = []

    def accept(labels):
        asked.append(labels["visibility"].min())
        return asked[-1] > 0.9

    done = make(stage, tmp_path / "a", accept=accept)
    assert done.rejected == len(asked) - 3 > 0
    records = [
        json.loads(path.read_text())
        for path in sorted((tmp_path / "a/.heliograph/records").iterdir())
    ]
    assert sum(record["attempt"] for record in records) == done.rejected
    make(stage, tmp_path / "b", accept=accept, credits=1)
    assert files(tmp_path / "a") == files(tmp_path / "b")
    with pytest.raises(hg.ResourceExhausted, match=r"image \d: accept: none of 2 attempts"):
        make(stage, tmp_path / "c", accept=lambda labels: False, attempts=2)


class Poses(hd.Writer):
    """The shortest writer: keeps where each instance was."""

    planes, labels = (), ("boxes",)

    def write(self, image):
        labels = image.frame.labels
        rows = zip(labels["name"], labels["world_from_object"], strict=True)
        return {name: pose[:3, 3].tolist() for name, pose in rows}

    def finish(self, records):
        self.put("poses.json", json.dumps(dict(records)))


def run_command(capsys, *arguments):
    """(exit status, output) of `heliograph ...`."""
    from heliograph.cli import main

    status = main([*map(str, arguments)])
    output = capsys.readouterr()
    return status, output.out + output.err


def test_an_image_is_rendered_again_to_the_same_bytes(stage, tmp_path, capsys, monkeypatch):
    scene, balls, cam = stage
    noise = np.random.default_rng(0).random((300, 600, 3)).astype("f4")  # above 1 MiB: a blob

    def randomize(draw):
        scatter(balls)(draw)
        for _ in range(600):  # above 64 KiB, which the daemon's manifests keep
            spin(draw)
        if draw.index == 1:
            draw.edit.dome(noise)

    hd.generate(scene, cam, randomize, count=2, spp=2, writer=hd.Coco(tmp_path / "set"))
    assert len(list((tmp_path / "set/.heliograph/blobs").iterdir())) == 1
    for index in range(2):
        name = f"{index:06d}"
        again = tmp_path / f"{name}.png"
        status, output = run_command(capsys, "rerender", tmp_path / "set" / name, "-o", again)
        assert (status, output.splitlines()[-1]) == (0, "the same bytes")
        assert again.read_bytes() == (tmp_path / f"set/images/{name}.png").read_bytes()
    shown = tmp_path / "shown.png"
    status, output = run_command(capsys, "open", tmp_path / "set/images/000001.png", "-o", shown)
    assert status == 0 and output.count("ball/") == BALLS
    assert Image.open(shown).size == SIZE
    monkeypatch.setattr("PIL.ImageShow._viewers", [])
    status, output = run_command(capsys, "open", tmp_path / "set/000001")
    assert status == 1 and "nothing here shows pictures: write it with -o FILE" in output
    record = tmp_path / "set/.heliograph/records/000000.json"
    record.write_text(record.read_text().replace('"sha256":"', '"sha256":"0'))
    status, output = run_command(capsys, "rerender", tmp_path / "set/000000")
    assert (status, output.partition(":")[0]) == (1, "other bytes than were written")
    status, output = run_command(capsys, "rerender", tmp_path / "set/000009")
    assert status == 2 and "no finished image" in output
    status, output = run_command(capsys, "open", tmp_path / "000001.png")
    assert status == 2 and "is no image of a data set" in output
    status, output = run_command(capsys, "open", tmp_path / "set/000001", "-o", tmp_path / "a.foo")
    assert status == 2 and "'a.foo' ends in nothing that pictures are written as" in output
    record.write_text("{")
    status, output = run_command(capsys, "rerender", tmp_path / "set/000000")
    assert status == 1 and "000000.json: is torn" in output and "remove it" in output


def test_files_are_of_the_image_whose_number_begins_anew_in_each_scene(stage, tmp_path):
    scene, balls, cam = stage
    writer = hd.Bop(tmp_path, scene_draws=2)
    shots = {"count": 8, "spp": 1, "writer": writer, "splits": {"train": 0.5, "val": 0.5}}
    hd.generate(scene, [cam, "side"], scatter(balls), **shots)
    found = {}
    for path in sorted(tmp_path.glob("*/*/rgb/*.png")):
        image = hd.KeptImage.find(path)
        found[image.index] = path
        assert path.parts[-4] == f"{image.split}_pbr"
        mask = path.parents[1] / f"mask/{path.stem}_000000.png"
        assert hd.KeptImage.find(mask).index == image.index
        assert hd.KeptImage.find(tmp_path / f"{image.index:06d}").index == image.index
    assert sorted(found) == list(range(8))
    same = hd.KeptImage.find(found[5]).render(scene.client)
    assert found[5].read_bytes() == hd.Picture().encode(same)
    elsewhere = pathlib.Path("val", *found[5].parts[-3:])
    for none in (found[5].parents[1], elsewhere, "models/obj_000001.ply"):
        with pytest.raises(hg.NotFound, match="name one as DIR/000123"):
            hd.KeptImage.find(tmp_path / none)


def test_a_shard_is_no_image(stage, tmp_path):
    scene, balls, cam = stage
    hd.generate(scene, cam, spin, count=1, spp=1, writer=hd.WebDataset(tmp_path))
    assert hd.KeptImage.find(tmp_path / "000000").index == 0
    with pytest.raises(hg.NotFound, match="name one as DIR/000123"):
        hd.KeptImage.find(tmp_path / "000000.tar")


def test_poses_of_a_draw_are_those_of_the_frame(client, tmp_path):
    seen = []

    def randomize(draw):
        def at(entity):
            return draw.pose(entity)[:3, 3].round(5).tolist()

        seen.append(at("child"))
        draw.place("ball/1", [hg.Pose((5, 0, 0), euler=(np.pi, 0, 0))])
        seen.append(at("child"))
        draw.place(["child"], [hg.Pose((1, 2, 3))])
        seen.append(at("child"))
        made = draw.edit.entity("new", mesh="mesh")
        draw.place(made, [hg.Pose((0, 0, 7))])
        seen.extend([at(made), at("ball/0")])

    with client.create_scene() as scene:
        furnished(scene)
        with scene.edit() as edit:
            edit.entity(
                "child", parent="ball/1", mesh="mesh", transform=hg.Pose((0, 0, 1)), label="auto"
            )
        hd.generate(scene, "cam", randomize, count=1, writer=Poses(tmp_path))
    expected = [[0, 0, 1.2], [5, 0, -1], [1, 2, 3], [0, 0, 7], [-0.4, 0, 0.2]]
    np.testing.assert_allclose(seen, expected, atol=1e-5)
    found = json.loads((tmp_path / "poses.json").read_text())["0"]
    np.testing.assert_allclose(found["child"], [1, 2, 3], atol=1e-5)
    np.testing.assert_allclose(found["new"], [0, 0, 7], atol=1e-5)


def test_each_randomizer_has_numbers_of_its_own(stage, tmp_path):
    scene, _, cam = stage
    drawn = []

    def take(n):
        return lambda draw: drawn.append(draw.rng.random(n)[-1])

    for first in (1, 5):
        rand = hd.Compose(take(first), hd.Compose(take(1), take(1)))
        hd.generate(scene, cam, rand, count=1, writer=Poses(tmp_path / str(first)))
    assert drawn[0] != drawn[3]
    assert drawn[1:3] == drawn[4:]
    assert len(set(drawn)) == 4


def test_a_class_of_the_randomizer_alone_is_refused(stage, tmp_path):
    scene, _, cam = stage
    with pytest.raises(hg.FailedPrecondition, match="image 0: category: fish is registered"):
        hd.generate(
            scene,
            cam,
            lambda draw: draw.edit.entity("fish", mesh="mesh", category="fish"),
            count=1,
            writer=Poses(tmp_path),
        )


def test_the_programs_of_the_guide_run(tmp_path, monkeypatch):
    guide = (pathlib.Path(__file__).parents[2] / "docs/datasets.md").read_text()
    programs = re.findall(r"```python\n(.*?)```", guide, re.DOTALL)
    (first,) = [p for p in programs if "hg.connect()" in p]
    (writer,) = [p for p in programs if "class Centroids" in p]
    monkeypatch.chdir(tmp_path)
    names = {"json": json}
    exec(compile(first.split("def scatter")[0], "docs/datasets.md", "exec"), names)
    exec(compile(writer, "docs/datasets.md", "exec"), names)
    exec(compile(first.replace("hd.Coco", "Centroids"), "docs/datasets.md", "exec"), names)
    lines = (tmp_path / "out/centroids.jsonl").read_text().splitlines()
    assert [json.loads(line)["index"] for line in lines] == list(range(10))
    exec(compile(first.replace('"out"', '"coco"'), "docs/datasets.md", "exec"), names)
    assert len(COCO(tmp_path / "coco/annotations/instances.json").imgs) == 10


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"count": 0}, "count"),
        ({"indices": [3]}, "indices"),
        ({"planes": ["depth"]}, "planes"),
        ({"splits": {"train": 0.5}}, "splits"),
        ({"splits": {"../x": 1.0}}, "splits"),
        ({"credits": 0}, "credits"),
        ({"attempts": 0}, "attempts"),
    ],
)
def test_bad_arguments_are_refused_by_name(stage, tmp_path, options, field):
    with pytest.raises(hg.InvalidArgument) as error:
        make(stage, tmp_path, **options)
    assert error.value.field == field
