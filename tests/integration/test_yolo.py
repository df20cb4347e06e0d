"""YOLO's text files, against the labels and pycocotools."""

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
import yaml
from pycocotools import mask as oracle

WIDTH, HEIGHT = 90, 70
POINTS = {"top": (0, 0, 0.2), "east": (0.2, 0, 0)}


@pytest.fixture(scope="module")
def stage(client):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=1)
            edit.categories("unseen", "ball", "bar")
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2), keypoints=POINTS)
            poses = [hg.Pose((0.5 * i - 0.5, 0, 0.2)) for i in range(3)]
            edit.instances("ball", mesh=mesh, transforms=poses, category="ball")
            ring = edit.mesh("torus", **hg.shapes.torus(0.3, 0.05))
            edit.entity("ring", mesh=ring, transform=hg.Pose((0, -0.6, 0.3)), category="bar")
            lens = hg.Camera.from_fov(50, WIDTH, HEIGHT, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -2, 1), (0, 0, 0.2)))
        yield scene


def scatter(draw):
    for i in range(3):
        draw.place(f"ball/{i}", [hg.Pose((*draw.rng.uniform(-1.2, 1.2, 2), 0.2))])
    if draw.index == 0:
        for name in ("ball/0", "ball/1", "ball/2", "ring"):
            draw.edit.update(name, visible=False)


def made(scene, out, **options):
    """(lines of each image: class and numbers, frames, data.yaml)"""
    frames = {}
    splits = options.pop("splits", None)

    class Kept(hd.Yolo):
        def write(self, image):
            frames[image.index] = image.frame
            return super().write(image)

    writer = Kept(out, **options)
    hd.generate(scene, "cam", scatter, count=5, spp=1, writer=writer, splits=splits)
    lines = {}
    for path in sorted((out / "labels").rglob("*.txt")):
        rows = [line.split() for line in path.read_text().splitlines()]
        lines[int(path.stem)] = [(int(row[0]), np.array(row[1:], float)) for row in rows]
        picture = out / "images" / path.relative_to(out / "labels").with_suffix(".png")
        assert picture.exists()
    assert sorted(lines) == sorted(frames) == list(range(5))
    assert not lines[0]
    return lines, frames, yaml.safe_load((out / "data.yaml").read_text())


def rows_of(frame, categories=(2, 3)):
    labels = frame.labels
    return np.flatnonzero((labels["visible"] > 0) & np.isin(labels["category"], categories))


def test_boxes(stage, tmp_path):
    lines, frames, data = made(stage, tmp_path, splits={"train": 0.6, "val": 0.4})
    assert data["names"] == {0: "unseen", 1: "ball", 2: "bar"}
    assert (data["train"], data["val"]) == ("images/train", "images/val")
    seen = 0
    for index, frame in frames.items():
        rows = rows_of(frame)
        assert len(lines[index]) == len(rows)
        for (kind, numbers), row in zip(lines[index], rows, strict=True):
            assert kind == frame.labels["category"][row] - 1
            cx, cy, w, h = numbers * (WIDTH, HEIGHT, WIDTH, HEIGHT)
            box = [cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2]
            np.testing.assert_allclose(box, frame.labels["bbox_visible"][row], atol=1e-3)
            seen += 1
    assert seen > 8


def test_segments_are_drawn_as_the_masks(stage, tmp_path):
    lines, frames, data = made(stage, tmp_path, task="seg")
    assert (data["train"], data["val"]) == ("images", "images")
    holes = 0
    for index, frame in frames.items():
        for (_, numbers), row in zip(lines[index], rows_of(frame), strict=True):
            corners = numbers.reshape(-1, 2) * (WIDTH, HEIGHT)
            rle = oracle.frPyObjects([np.round(corners).ravel().tolist()], HEIGHT, WIDTH)
            drawn = oracle.decode(rle)[..., 0]
            mask = frame["instance"] == frame.labels["label"][row]
            x, y = corners.T
            area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
            assert abs(area - mask.sum()) < 0.05
            holes += frame.labels["name"][row] == "ring"
            assert (drawn ^ mask).sum() <= 0.05 * mask.sum()  # the ways between parts have a width
    assert holes == 4


def test_poses(stage, tmp_path):
    lines, frames, data = made(stage, tmp_path, task="pose")
    assert data["names"] == {0: "ball"}
    assert data["kpt_shape"] == [2, 3]
    states = set()
    for index, frame in frames.items():
        labels = frame.labels
        rows = rows_of(frame, [2])
        for (kind, numbers), row in zip(lines[index], rows, strict=True):
            assert kind == 0 and len(numbers) == 4 + 6
            own = np.flatnonzero(labels["keypoint_instance"] == labels["label"][row])
            for (x, y, v), k in zip(numbers[4:].reshape(-1, 3), own, strict=True):
                states.add(v)
                state = labels["keypoint_state"][k]
                assert v == {0: 0, 1: 1, 2: 1, 3: 2}[state]
                if v:
                    place = labels["keypoint_image"][k] + 0.5
                    np.testing.assert_allclose((x * WIDTH, y * HEIGHT), place, atol=1e-3)
    assert {1, 2} <= states


def test_what_yolo_cannot_say_is_refused(stage, tmp_path):
    with pytest.raises(hg.InvalidArgument, match="task: one of box, seg, pose") as error:
        hd.Yolo(tmp_path, task="segment")
    assert error.value.field == "task"
    with stage.branch() as scene:
        with scene.edit() as edit:
            edit.mesh("torus", **hg.shapes.torus(0.3, 0.05), keypoints={"one": (0.3, 0, 0)})
        with pytest.raises(hg.FailedPrecondition, match="ball has 2, bar has 1"):
            made(scene, tmp_path, task="pose")


def test_names_are_read_as_they_are_written(stage, tmp_path):
    odd = ["no", "3", "bolt, big: #2", "'", "ball \U0001f3be"]
    with stage.branch() as scene:
        with scene.edit() as edit:
            edit.categories("unseen", "ball", "bar", *odd)
        data = made(scene, tmp_path)[2]
    assert list(data["names"].values()) == ["unseen", "ball", "bar", *odd]
    assert hd.validate(tmp_path).ok
