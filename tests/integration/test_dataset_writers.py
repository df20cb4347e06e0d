"""Data sets of poses on a real scene (dataset_stage.py), read by other code and re-projected."""

from pathlib import Path

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from dataset_stage import LENS, H, K, W, load, made, picture, shift, stage
from pycocotools import mask as oracle


@pytest.fixture(scope="module")
def scene(client):
    with client.create_scene() as made:
        stage(made)
        yield made


def ply(path):
    """Vertices (V, 3) and faces (F, 3) of the binary PLY files that BOP's tools read."""
    header, _, body = Path(path).read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    width = sum(line.startswith("property float") for line in lines)
    counts = [int(line.split()[2]) for line in lines if line.startswith("element")]
    vertices = np.frombuffer(body, "<f4", counts[0] * width).reshape(-1, width)
    faces = np.frombuffer(body, [("n", "u1"), ("i", "<i4", 3)], offset=vertices.nbytes)
    assert len(faces) == counts[1] and (faces["n"] == 3).all()
    return vertices[:, :3].astype(float), faces["i"]


def drawn_mask(points, faces):
    """(H, W) bool: the pixel centres that triangles of points (V, 2), K coordinates, cover."""
    x, y = np.meshgrid(np.arange(W), np.arange(H))
    out = np.zeros((H, W), bool)
    for a, b, c in points[faces]:
        edges = ((a, b - a), (b, c - b), (c, a - c))
        sides = [d[0] * (y - p[1]) - d[1] * (x - p[0]) for p, d in edges]
        out |= (np.min(sides, 0) >= 0) | (np.max(sides, 0) <= 0)
    return out


def project(gt, camera, points):
    """(N, 2) of model points in mm, as BOP says: K (R p + t)."""
    k = np.reshape(camera["cam_K"], (3, 3))
    turn, place = np.reshape(gt["cam_R_m2c"], (3, 3)), np.array(gt["cam_t_m2c"])
    image = (points @ turn.T + place) @ k.T
    return image[:, :2] / image[:, 2:], image[:, 2]


# ---------------------------------------------------------------- BOP


@pytest.fixture(scope="module")
def bop(scene, tmp_path_factory):
    root = tmp_path_factory.mktemp("bop")
    return root, made(scene, hd.Bop(root, depth_scale=0.1))


def test_bop_models_are_in_millimetres_about_their_centre(bop):
    root, _ = bop
    infos = load(root / "models/models_info.json")
    assert list(infos) == ["1", "2", "3", "4"]  # crate, ball, block and the small block
    for number, info in infos.items():
        points, _ = ply(root / f"models/obj_{int(number):06d}.ply")
        low, high = points.min(0), points.max(0)
        np.testing.assert_allclose(low, -high, atol=1e-3)
        for i, axis in enumerate("xyz"):
            assert info[f"min_{axis}"] == pytest.approx(low[i])
            assert info[f"size_{axis}"] == pytest.approx(high[i] - low[i])
        apart = np.linalg.norm(points[:, None] - points[None], axis=2).max()
        assert info["diameter"] == pytest.approx(apart, rel=1e-6)
    sizes = [[infos[n][f"size_{a}"] for a in "xyz"] for n in infos]
    np.testing.assert_allclose(sizes[0], [450, 400, 490], atol=0.1)  # the crate with its lid
    np.testing.assert_allclose(sizes[3], [120] * 3, atol=0.1)
    assert "symmetries_discrete" not in infos["1"]  # of two meshes
    assert infos["3"]["symmetries_discrete"] == [list(np.diag([-1.0, -1, 1, 1]).ravel())]
    (axis,) = infos["2"]["symmetries_continuous"]
    assert axis == {"axis": [0, 0, 1], "offset": [0, 0, 0]}


def test_bop_poses_reproject_models_onto_masks(bop):
    root, frames = bop
    folder = root / "train_pbr/000000"
    gts, cameras = load(folder / "scene_gt.json"), load(folder / "scene_camera.json")
    assert list(gts) == list(cameras) == ["0", "1"]
    for number, frame in frames.items():
        camera = cameras[str(number)]
        np.testing.assert_array_equal(np.reshape(camera["cam_K"], (3, 3)), K)
        world = np.reshape(camera["cam_R_w2c"], (3, 3))
        np.testing.assert_allclose(world, frame.camera_from_world_cv[:3, :3])
        for i, gt in enumerate(gts[str(number)]):
            turn = np.reshape(gt["cam_R_m2c"], (3, 3))
            np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-6)
            points, faces = ply(root / f"models/obj_{gt['obj_id']:06d}.ply")
            drawn = drawn_mask(project(gt, camera, points)[0], faces)
            mask = picture(folder / f"mask/{number:06d}_{i:06d}.png") == 255
            assert mask.any() and (mask != drawn).sum() <= 1


def test_bop_masks_depth_and_info_agree(bop):
    root, frames = bop
    folder = root / "train_pbr/000000"
    infos, gts = load(folder / "scene_gt_info.json"), load(folder / "scene_gt.json")
    for number, frame in frames.items():
        depth = picture(folder / f"depth/{number:06d}.png")
        assert depth.dtype == np.uint16 and depth.shape == (H, W)
        near = frame["depth"] < 6.5
        np.testing.assert_allclose(depth[near] * 1e-4, frame["depth"][near], atol=5.1e-5)
        assert (depth[np.isinf(frame["depth"])] == 0).all()
        labels = frame.labels
        assert [gt["obj_id"] for gt in gts[str(number)]] == [1, 2, 3, 4]
        union = np.zeros((H, W), int)
        for i, (info, label) in enumerate(zip(infos[str(number)], (1, 2, 3, 4), strict=True)):
            name = f"{number:06d}_{i:06d}.png"
            mask, seen = (picture(folder / d / name) for d in ("mask", "mask_visib"))
            assert set(np.unique(mask)) <= {0, 255} and not (seen & ~mask).any()
            assert np.array_equal(seen == 255, frame["instance"] == label)
            union += seen == 255
            row = list(labels["label"]).index(label)
            assert info["px_count_all"] == labels["canvas"][row]
            assert info["px_count_visib"] == (seen == 255).sum()
            assert info["px_count_valid"] == (depth[mask == 255] > 0).sum()
            if info["px_count_visib"]:
                ys, xs = np.nonzero(seen)
                box = [xs.min(), ys.min(), xs.max() - xs.min(), ys.max() - ys.min()]
                assert info["bbox_visib"] == box
                assert info["visib_fract"] == info["px_count_visib"] / info["px_count_all"]
            else:
                assert info["bbox_obj"] == info["bbox_visib"] == [-1] * 4
        assert union.max() == 1
        edge, hidden = infos[str(number)][2], infos[str(number)][3]
        assert edge["bbox_obj"][0] + edge["bbox_obj"][2] >= W  # goes on outside the picture
        assert edge["px_count_all"] > edge["px_count_valid"] > 0
        assert hidden["px_count_visib"] == 0 and hidden["px_count_all"] > 10


def test_bop_coco_is_what_pycocotools_reads(bop):
    root, frames = bop
    folder = root / "train_pbr/000000"
    coco = load(folder / "scene_gt_coco.json")
    assert [a["id"] for a in coco["annotations"]] == list(range(1, len(coco["annotations"]) + 1))
    assert [i["id"] for i in coco["images"]] == [0, 1]
    gts = load(folder / "scene_gt.json")
    for found in coco["annotations"]:
        number = found["image_id"]
        rle = oracle.frPyObjects(found["segmentation"], H, W)
        (label,) = np.unique(frames[number]["instance"][oracle.decode(rle) == 1])
        assert gts[str(number)][label - 1]["obj_id"] == found["category_id"]
        assert oracle.area(rle) == found["area"]
        whole = np.asfortranarray(frames[number].amodal_mask(int(label)).astype(np.uint8))
        assert oracle.toBbox(oracle.encode(whole)).tolist() == found["bbox"]
    assert {a["category_id"] for a in coco["annotations"]} == {1, 2, 3}  # none of the hidden one


def test_bop_delta_shows_what_lies_just_behind(client, tmp_path):
    """A plate 10 mm behind another one is seen with delta 15 mm, and not with 5 mm."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            mesh = edit.mesh("mesh", **hg.shapes.cube(1.0))
            scale = (0.5, 0.002, 0.5)
            for name, y, x in (("front", 0.0, 0.0), ("back", 0.01, 0.2)):
                pose = hg.Pose((x, y, 0), scale=scale)
                edit.entity(name, mesh=mesh, category=name, transform=pose)
            edit.entity("cam", camera=LENS, transform=hg.look_at((0, -2.5, 0), (0, 0, 0)))
        shares = {}
        for delta in (5, 15):
            root = tmp_path / str(delta)
            writer = hd.Bop(root, visibility="bop-delta", delta=delta)
            frames = made(scene, writer, lambda draw: None, count=1)
            info = load(root / "train_pbr/000000/scene_gt_info.json")["0"]
            shares[delta] = [i["visib_fract"] for i in info]
        exact = frames[0].labels["visibility"]
        assert shares[5] == pytest.approx(exact) and exact[1] < 0.5
        assert shares[15][0] == 1 and shares[15][1] > 0.99


def test_bop_refuses_draws_that_change_a_model(scene, tmp_path):
    def grow(draw):
        draw.edit.entity("behind", transform=hg.Pose((0, 0.7, 0.2), scale=1.5))

    with pytest.raises(hg.InvalidArgument, match="behind: its box .* model 2"):
        made(scene, hd.Bop(tmp_path), grow)


def test_bop_refuses_meshes_that_deform(client, tmp_path):
    with client.create_scene() as scene:
        stage(scene)
        with scene.edit() as edit:
            skin = (["cam"], [np.eye(4)])
            bound = {"joints": np.zeros((3, 4), "u2"), "weights": np.tile([1.0, 0, 0, 0], (3, 1))}
            mesh = edit.mesh("flag/mesh", positions=np.eye(3), indices=[[0, 1, 2]], **bound)
            edit.entity("flag", mesh=mesh, skin=skin, category="flag")
        with pytest.raises(hg.InvalidArgument, match="flag: its mesh deforms"):
            made(scene, hd.Bop(tmp_path))


def test_bop_scenes_and_splits(scene, tmp_path):
    writer = hd.Bop(tmp_path, scene_draws=2, split_type="")
    made(scene, writer, count=5, splits={"train": 0.5, "val": 0.5}, size=(48, 32))
    found = []
    for path in sorted(tmp_path.glob("*/*/scene_gt.json")):
        split, number = path.parts[-3], int(path.parts[-2])
        for image in load(path):
            assert (path.parent / f"rgb/{int(image):06d}.png").exists() and int(image) < 2
            found.append((number * 2 + int(image), split))
    assert sorted(index for index, _ in found) == list(range(5))
    assert {split for _, split in found} == {"train", "val"}


# ---------------------------------------------------------------- KITTI, NDDS


def test_kitti_boxes_project_onto_the_objects(scene, tmp_path):
    def level(draw):
        draw.place(["cam"], [hg.look_at((0.2, -2.4, 0.3), (0.1, 0, 0.3))])

    frame = made(scene, hd.Kitti(tmp_path, categories=["crate", "ball"]), level, count=1)[0]
    lines = (tmp_path / "training/label_2/000000.txt").read_text().splitlines()
    calib = (tmp_path / "training/calib/000000.txt").read_text().splitlines()
    p2 = np.array(calib[2].split()[1:], float).reshape(3, 4)
    assert picture(tmp_path / "training/image_2/000000.png").shape == (H, W, 3)
    assert (tmp_path / "ImageSets/train.txt").read_text() == "000000\n"
    assert [line.split()[0] for line in lines] == ["crate", "ball"]
    labels = frame.labels
    for row, line in enumerate(lines):
        _, _, _, alpha, *rest = line.split()
        left, top, right, bottom, h, w, l, x, y, z, ry = (float(v) for v in rest)
        assert [left, top, right + 1, bottom + 1] == labels["bbox_amodal"][row].tolist()
        assert float(alpha) == pytest.approx(ry - np.arctan2(x, z), abs=1e-4)
        c, s = np.cos(ry), np.sin(ry)
        box = np.array(
            [[i, j, k] for i in (-l / 2, l / 2) for j in (-h, 0) for k in (-w / 2, w / 2)]
        )
        corners = box @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + (x, y, z)
        image = np.c_[corners, np.ones(8)] @ p2.T
        ours = labels["corners_image"][row]
        apart = np.linalg.norm((image[:, :2] / image[:, 2:])[:, None] - ours[None], axis=2)
        assert apart.min(0).max() < 0.01 and apart.min(1).max() < 0.01


def test_kitti_regions_are_what_is_hardly_seen_and_crowds(client, tmp_path):
    with client.create_scene() as scene:
        stage(scene)
        with scene.edit() as edit:
            for i in range(3):
                place = hg.Pose((0.5 + 0.12 * i, -0.2, 0.05), scale=0.15)
                edit.entity(f"gnat/{i}", mesh="box", label=9, group=True, transform=place)
                edit.update(f"gnat/{i}", label=9, group=True, category="block")

        def swarm(draw):
            shift(draw)
            for i in range(2):
                place = hg.Pose((0.1 * i - 0.1, -0.6, 0.05), scale=0.1)
                draw.edit.entity(
                    f"fly/{i}", mesh="box", label=12, group=True, category="ball", transform=place
                )

        strict = hd.Kitti(tmp_path, min_height=2, max_occlusion=0.2, max_truncation=0.05)
        frames = made(scene, strict, swarm)
    kinds = set()
    for index, frame in frames.items():
        labels, lines = frame.labels, {}
        for line in (tmp_path / f"training/label_2/{index:06d}.txt").read_text().splitlines():
            kind, *numbers = line.split()
            lines[tuple(float(v) for v in numbers[3:7])] = kind
        for row, name in enumerate(labels["name"]):
            left, top, right, bottom = labels["bbox_amodal"][row].tolist()
            kind = lines.pop((left, top, right - 1, bottom - 1), None)
            if not labels["category"][row] or not labels["visible"][row]:
                assert kind is None, name
                continue
            hidden = labels["occlusion"][row] > 0.2 or labels["truncation"][row] > 0.05
            crowd = labels["label"][row] in (9, 12)
            assert (kind == "DontCare") == (hidden or crowd or bottom - top < 2), name
            kinds.add((kind == "DontCare", bool(hidden), bool(crowd)))
        assert not lines
    assert {(True, False, True), (True, True, False), (False, False, False)} <= kinds
    report = hd.validate(tmp_path)
    assert report.ok, str(report)


def test_ndds_reprojects(scene, tmp_path):
    for number in made(scene, hd.Ndds(tmp_path, resolve_symmetries=False)):
        content = load(tmp_path / f"{number:06d}.json")
        camera = content["camera_data"]
        assert (camera["width"], camera["height"]) == (W, H)
        found = camera["intrinsics"]
        k = np.array([[found["fx"], 0, found["cx"]], [0, found["fy"], found["cy"]], [0, 0, 1]])
        world = np.array(camera["camera_view_matrix"])
        assert [o["name"] for o in content["objects"]] == ["crate", "behind", "edge", "hidden"]
        for thing in content["objects"]:
            x, y, z, w = thing["quaternion_xyzw"]
            turn = hg.Pose((0, 0, 0), xyzw=(x, y, z, w)).matrix[:3, :3]
            local = np.array(thing["local_cuboid"])
            camera_points = local @ turn.T + thing["location"]
            image = camera_points @ k.T
            projected = np.array(thing["projected_cuboid"])
            np.testing.assert_allclose(image[:, :2] / image[:, 2:], projected, atol=1e-4)
            through_world = np.c_[local, np.ones(9)] @ np.array(thing["local_to_world_matrix"]).T
            np.testing.assert_allclose((through_world @ world.T)[:, :3], camera_points, atol=1e-5)
            assert (local[:4, 0] > local[4:8, 0]).all()  # front
            assert (local[[0, 3, 4, 7], 1] > local[[1, 2, 5, 6], 1]).all()  # left
            assert (local[[2, 3, 6, 7], 2] > local[[0, 1, 4, 5], 2]).all()  # top
        hidden = content["objects"][3]
        assert hidden["visibility"] == 0 < content["objects"][1]["visibility"] < 1


def test_ndds_poses_of_what_is_symmetric(scene, tmp_path):
    """A draw turns the block by a half turn, its symmetry, and the ball about its axis."""

    def turn(draw):
        half = hg.Pose(euler=(0, 0, np.pi * draw.index)).matrix
        draw.place(["edge"], [draw.pose("edge") @ half])
        draw.place(["behind"], [draw.pose("behind") @ hg.Pose(euler=(0, 0, draw.index)).matrix])

    made(scene, hd.Ndds(tmp_path, categories=["block", "ball"]), turn)
    first, second = (load(tmp_path / f"{i:06d}.json")["objects"] for i in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a["projected_cuboid"], b["projected_cuboid"], atol=1e-3)
        one, other = (np.array(thing["quaternion_xyzw"]) for thing in (a, b))
        assert abs(one @ other) == pytest.approx(1, abs=1e-6)
