"""Contents of the files that writers of data sets make, where the answer is known by arithmetic."""

import dataclasses
import io
import json
import struct

import cv2
import hand_made
import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from heliograph.datasets.writers import bop, colmap, kitti, models, ndds, nerf
from heliograph.datasets.writers.encoded import depth_steps, flo, kitti_disparity, kitti_flow
from heliograph.datasets.writers.instances import instances, quaternion_wxyz
from heliograph.datasets.writers.symmetries import Axis, Symmetries
from heliograph.image import png
from PIL import Image

W, H = hand_made.SIZE


def read(data):
    """By OpenCV: colours come as BGR."""
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def only(columns):
    """The one instance of a frame made by hand."""
    frame = hand_made.frame({}, hand_made.rows(columns), categories={1: "thing"})
    (found,) = instances(frame, None)
    return found


def turned(axis, degrees):
    out = np.eye(4)
    out[:3, :3] = cv2.Rodrigues(np.radians(degrees) * np.asarray(axis, float))[0]
    return out


# ---------------------------------------------------------------- pictures and planes


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (48, 64, 3), (3, 2, 4)])
def test_png_comes_back(dtype, shape):
    pixels = np.random.default_rng(1).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)
    back = read(png.encode(pixels))
    if len(shape) == 3:
        back = back[..., [2, 1, 0, 3][: shape[2]]]
    assert back.dtype == dtype and np.array_equal(back, pixels)
    Image.open(io.BytesIO(png.encode(pixels))).load()


def test_png_refuses_what_it_has_not():
    for wrong in (np.zeros((2, 2)), np.zeros((2, 2, 5), np.uint8)):
        with pytest.raises(hg.InvalidArgument, match="uint8"):
            png.encode(wrong)


def test_flo_has_the_width_first_and_marks_what_is_unknown(tmp_path):
    flow = np.random.default_rng(2).normal(0, 20, (3, 5, 2)).astype(np.float32)
    valid = np.ones((3, 5), np.uint8)
    valid[1, 4] = 0
    data = flo(flow, valid)
    assert data[:4] == b"PIEH" and struct.unpack("<ii", data[4:12]) == (5, 3)
    (tmp_path / "a.flo").write_bytes(data)
    back = cv2.readOpticalFlow(str(tmp_path / "a.flo"))
    assert back.shape == (3, 5, 2) and np.array_equal(back[valid == 1], flow[valid == 1])
    assert (np.abs(back[1, 4]) > 1e9).all()


def test_kitti_flow_is_scaled_and_never_wraps():
    flow = np.zeros((2, 3, 2), np.float32)
    flow[0, 0], flow[0, 1], flow[0, 2] = (1.5, -2.25), (-512, 511.984375), (512, 0)
    flow[1, 0], flow[1, 1] = (0, -513), (3, 3)
    valid = np.ones((2, 3), np.uint8)
    valid[1, 1] = 0
    rgb = read(kitti_flow(flow, valid))[..., ::-1]
    assert rgb.dtype == np.uint16
    assert rgb[..., 2].tolist() == [[1, 1, 0], [0, 0, 1]]
    assert rgb[0, 0].tolist() == [32768 + 96, 32768 - 144, 1]
    assert rgb[0, 1].tolist() == [0, 65535, 1]
    assert not rgb[0, 2].any() and not rgb[1, 1].any()
    decoded = (rgb[..., :2].astype(float) - 32768) / 64
    assert np.array_equal(decoded[rgb[..., 2] == 1], flow[rgb[..., 2] == 1])


def test_kitti_disparity():
    disparity = np.array([[1.5, 255.99609375, 256.0, 0.001, 0.0, 7.0]], np.float32)
    valid = np.array([[1, 1, 1, 1, 1, 0]], np.uint8)
    assert read(kitti_disparity(disparity, valid)).tolist() == [[384, 65535, 0, 0, 0, 0]]


def test_depth_is_rounded_and_clamped():
    depth = np.array([[0.0014, 0.0016, 65.5349, 65.6, 1e9, np.inf, np.nan]], np.float32)
    assert depth_steps(depth, 1e-3).tolist() == [[1, 2, 65535, 65535, 65535, 0, 0]]
    assert depth_steps(np.array([[1.0, 7.0]]), 1e-4).tolist() == [[10000, 65535]]


# ---------------------------------------------------------------- rotations


def test_quaternions_of_all_rotations():
    rng = np.random.default_rng(3)
    turns = [cv2.Rodrigues(rng.normal(0, 2, 3))[0] for _ in range(100)]
    turns += [np.diag(d) for d in ([1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])]
    for turn in turns:
        w, x, y, z = quaternion_wxyz(turn)
        assert w >= 0 and abs(w * w + x * x + y * y + z * z - 1) < 1e-12
        v = np.array([x, y, z])
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        back = (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross
        np.testing.assert_allclose(back, turn, atol=1e-9)


# ---------------------------------------------------------------- BOP


def test_bop_boxes_of_the_same_pixels_differ_by_one():
    mask = np.zeros((H, W), bool)
    mask[1:3, 2:4] = True
    box = np.array([2, 1, 4, 3], "i4")
    thing = only({"bbox_amodal": box, "bbox_amodal_canvas": box, "canvas": np.uint32(8)})
    depth = np.ones((H, W), np.uint16)
    depth[1, 2] = 0
    info = bop.info_of(thing, (mask, mask), depth)
    assert info["bbox_obj"] == info["bbox_visib"] == [2, 1, 1, 1]
    counts = [info[f"px_count_{name}"] for name in ("all", "valid", "visib")]
    assert counts == [8, 3, 4] and info["visib_fract"] == 0.5
    annotation = bop.annotation_of(thing, 7, mask, 0.05)
    assert annotation["bbox"] == [2, 1, 2, 2] and annotation["area"] == 4
    assert annotation["ignore"] and annotation["category_id"] == 7
    counts = annotation["segmentation"]["counts"]
    assert counts[:4] == [2 * H + 1, 2, H - 2, 2] and sum(counts) == W * H


def test_bop_hides_the_boxes_of_what_is_hidden():
    mask, none = np.ones((H, W), bool), np.zeros((H, W), bool)
    info = bop.info_of(only({}), (mask, none), np.ones((H, W), np.uint16))
    assert info["bbox_obj"] == info["bbox_visib"] == [-1, -1, -1, -1]
    assert info["visib_fract"] == 0.0 and info["px_count_all"] == 10
    assert bop.annotation_of(only({}), 1, none, 0.0) is None


@pytest.mark.parametrize("scale", [(50, 50, 50), (90, 20, 5), (0, 0, 0)])
def test_diameter_is_the_largest_distance(scale):
    points = np.random.default_rng(4).normal(0, 1, (2500, 3)) * scale + (1e3, 0, 0)
    apart = np.sqrt(((points[:, None] - points[None]) ** 2).sum(2))
    assert models.diameter(points) == pytest.approx(apart.max(), rel=1e-12)


def test_symmetries_move_with_the_origin():
    """A half turn about the vertical through (1, 0, 0), told about (0.5, 0, 0), in mm."""
    half = np.diag([-1.0, -1, 1, 1])
    half[0, 3] = 2.0
    around = Axis(np.array([0.0, 0, 1]), np.array([1.0, 0, 5]))
    origin = np.array([0.5, 0, 0])
    info = Symmetries([half], [around]).info(origin, 1000.0)
    (flat,) = info["symmetries_discrete"]
    np.testing.assert_allclose(np.reshape(flat, (4, 4)) @ [500, 0, 0, 1], [500, 0, 0, 1])
    assert info["symmetries_continuous"] == [{"axis": [0, 0, 1], "offset": [500, 0, 0]}]
    assert Symmetries().info(origin, 1.0) == {} and not Symmetries()


def test_one_of_the_poses_that_look_the_same():
    """A can, whose axis and flip are symmetries, and a box with half turns: however it is turned
    by them, the pose that faces the camera is the same, and is one of those that look alike."""
    rng = np.random.default_rng(6)
    flip = np.diag([1.0, -1, -1, 1])
    halves = [np.diag([*d, 1.0]) for d in ((-1, -1, 1), (-1, 1, -1), (1, -1, -1))]
    can = Symmetries([flip], [Axis(np.array([0, 0, 1.0]), np.zeros(3))])
    for _ in range(50):
        pose = turned(rng.normal(0, 1, 3), 90)
        pose[:3, 3] = rng.normal(0, 0.3, 3) + (0, 0, 2)
        about = turned((0, 0, 1), rng.uniform(0, 360))
        for group, alike in (
            (can, [np.eye(4), about, flip, about @ flip]),
            (Symmetries(halves), [np.eye(4), *halves]),
        ):
            poses = [pose @ s @ group.facing(pose @ s) for s in alike]
            for other in poses[1:]:
                np.testing.assert_allclose(other, poses[0], atol=1e-6)
            assert -poses[0][:3, 3] @ poses[0][:3, 0] > 0  # x towards the camera
            same = np.linalg.inv(pose) @ poses[0]
            if group is can:
                assert abs(same[2, 2]) == pytest.approx(1)
            else:
                assert min(np.abs(same - s).max() for s in alike) < 1e-9


def test_a_turn_about_an_axis_beside_the_origin():
    spin = Symmetries((), [Axis(np.array([0, 0, 1.0]), np.array([0.5, 0, 0]))])
    pose = np.eye(4)
    pose[:3, 3] = (0.2, 0.3, 3)
    same = spin.facing(pose)
    np.testing.assert_allclose(same @ (0.5, 0, 0.7, 1), (0.5, 0, 0.7, 1))
    about = turned((0, 0, 1), 70)
    about[:3, 3] = (np.eye(3) - about[:3, :3]) @ (0.5, 0, 0)
    other = pose @ about
    np.testing.assert_allclose(other @ spin.facing(other), pose @ same, atol=1e-9)


# ---------------------------------------------------------------- KITTI


def fields(line):
    kind, *numbers = line.split()
    assert len(numbers) == 14 and line.endswith("\n")
    return kind, np.array(numbers, float)


# Columns: where the object's x forward, y left and z up point in the camera, z ahead and y down.
FACING_RIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
FACING_AWAY = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def car(rotation, place):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, place
    return only(
        {
            "camera_from_object_cv": pose,
            "box_center": np.array([0, 0, 0.75], "f4"),
            "box_half_extents": np.array([2.0, 0.8, 0.75], "f4"),
        }
    )


def test_kitti_line_of_a_car_that_faces_right():
    kind, numbers = fields(kitti.label_line(car(FACING_RIGHT, (3.0, 1.6, 3.0))))
    assert kind == "thing"
    assert numbers[:2].tolist() == [0.2, 2]  # truncated, occluded
    assert numbers[3:7].tolist() == [2, 1, 5, 4]  # pixels, both ends included
    np.testing.assert_allclose(numbers[7:10], [1.5, 1.6, 4.0])  # height, width, length
    np.testing.assert_allclose(numbers[10:13], [3.0, 1.6, 3.0], atol=1e-6)  # the bottom's centre
    assert abs(numbers[13]) < 1e-6
    assert numbers[2] == pytest.approx(-np.pi / 4, abs=1e-4)  # alpha = 0 - atan2(3, 3)


def test_kitti_line_of_a_car_that_drives_away():
    numbers = fields(kitti.label_line(car(FACING_AWAY, (0.0, 1.6, 10.0))))[1]
    assert numbers[13] == pytest.approx(-np.pi / 2, abs=1e-4)
    assert numbers[2] == pytest.approx(-np.pi / 2, abs=1e-4)
    np.testing.assert_allclose(numbers[7:10], [1.5, 1.6, 4.0], rtol=1e-5)


def test_kitti_box_of_a_tilted_car_holds_all_its_corners():
    rotation = turned((0.3, -0.2, 0.5), 40)[:3, :3] @ FACING_AWAY
    thing = car(rotation, (1.0, 1.0, 8.0))
    numbers = fields(kitti.label_line(thing))[1]
    height, width, length = numbers[7:10]
    c, s = np.cos(numbers[13]), np.sin(numbers[13])
    corners = thing.corners @ rotation.T + (1.0, 1.0, 8.0)
    local = (corners - numbers[10:13]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    low, high = local.min(0), local.max(0)
    np.testing.assert_allclose(high, [length / 2, 0, width / 2], atol=1e-4)
    np.testing.assert_allclose(low, [-length / 2, -height, -width / 2], atol=1e-4)


def test_kitti_regions_that_nobody_would_label():
    limits = kitti.Limits(min_height=4, max_occlusion=0.5, max_truncation=0.25)
    thing = car(FACING_RIGHT, (3.0, 1.6, 3.0))  # 4 rows, occlusion 0.5, truncation 0.2
    assert not limits.refuse(thing)
    for tighter in ({"min_height": 4.5}, {"max_occlusion": 0.49}, {"max_truncation": 0.15}):
        assert dataclasses.replace(limits, **tighter).refuse(thing), tighter
    kind, numbers = fields(kitti.region_line(thing))
    assert kind == "DontCare"
    assert numbers[3:7].tolist() == [2, 1, 5, 4]
    filler = [-1, -1, -10, -1, -1, -1, -1000, -1000, -1000, -10]
    assert [*numbers[:3], *numbers[7:]] == filler  # KITTI's own
    with pytest.raises(hg.InvalidArgument, match="max_truncation"):
        hd.Kitti("unused", max_truncation=1.5)


def test_kitti_calibration_projects():
    lines = dict(line.split(": ") for line in kitti.calibration(hand_made.K, 0.5).splitlines())
    matrices = {name: np.array(text.split(), float) for name, text in lines.items()}
    assert [len(matrices[f"P{i}"]) for i in range(4)] == [12] * 4
    point = np.array([0.4, -0.2, 2.0, 1.0])
    x, y, w = matrices["P2"].reshape(3, 4) @ point
    assert (x / w, y / w) == pytest.approx((100 * 0.2 + 40, 120 * -0.1 + 25))
    right = matrices["P3"].reshape(3, 4) @ point
    assert (x - right[0]) / w == pytest.approx(100 * 0.5 / 2.0)  # the disparity
    assert np.array_equal(matrices["R0_rect"].reshape(3, 3), np.eye(3))
    ahead = matrices["Tr_velo_to_cam"].reshape(3, 4) @ (7.0, 1.0, 2.0, 1.0)
    assert ahead.tolist() == [-1.0, -2.0, 7.0]


# ---------------------------------------------------------------- NDDS


def test_ndds_cuboid_by_meaning():
    """Seen from behind: front is farther, left is left, the bottom is below."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = FACING_AWAY, (0.1, 0.2, 5.0)
    half, off = np.array([0.3, 0.2, 0.1], "f4"), np.array([1, 2, 4], "f4")  # of the origin
    pose[:3, 3] -= FACING_AWAY @ off
    columns = {"camera_from_object_cv": pose, "box_half_extents": half, "box_center": off}
    thing = only(columns)
    found = ndds.object_data(thing, hand_made.K)
    x, y, w, scalar = found["quaternion_xyzw"]
    np.testing.assert_allclose(quaternion_wxyz(FACING_AWAY), [scalar, x, y, w])
    depths = {"front": 5.3, "rear": 4.7}
    sides, levels = {"left": -0.2, "right": 0.2}, {"bottom": 0.1, "top": -0.1}
    ring = [("left", "bottom"), ("right", "bottom"), ("right", "top"), ("left", "top")]
    wanted = [
        (
            100 * (0.1 + sides[side]) / depths[end] + 40,
            120 * (0.2 + levels[level]) / depths[end] + 25,
        )
        for end in ("front", "rear")
        for side, level in ring
    ]
    wanted.append((100 * 0.1 / 5 + 40, 120 * 0.2 / 5 + 25))
    np.testing.assert_allclose(found["projected_cuboid"], wanted, rtol=1e-6)
    assert found["local_cuboid"][0] == pytest.approx([0.3, 0.2, -0.1])
    assert found["location"] == pytest.approx([0.1, 0.2, 5.0]) and found["class"] == "thing"
    assert found["visibility"] == pytest.approx(0.4)
    json.dumps(found, allow_nan=False)


# ---------------------------------------------------------------- lenses


def test_nerf_lens_counts_from_the_corner():
    frame = hand_made.frame()
    plain = nerf.lens(hg.Camera.from_intrinsics(hand_made.K, W, H), frame)
    assert (plain["cx"], plain["cy"], plain["fl_x"], plain["fl_y"]) == (40.5, 25.5, 100, 120)
    assert plain["camera_model"] == "PINHOLE" and "k1" not in plain
    assert plain["camera_angle_x"] == pytest.approx(2 * np.arctan(32 / 100))
    bent = hg.Camera.from_intrinsics(hand_made.K, W, H, distortion=(0.1, 0.2, 0.3, 0.4, 0.5))
    found = nerf.lens(bent, frame)
    assert [found[n] for n in ("k1", "k2", "p1", "p2", "k3")] == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert found["camera_model"] == "OPENCV"
    rational = hg.Camera.from_intrinsics(hand_made.K, W, H, distortion=(0.1, 0, 0, 0, 0, 0.2, 0, 0))
    with pytest.raises(hg.InvalidArgument, match="cam: .*Colmap"):
        nerf.lens(rational, frame)
    with pytest.raises(hg.InvalidArgument, match="orthographic"):
        nerf.lens(hg.Camera.orthographic(10, W, H), frame)


@pytest.mark.parametrize(
    "distortion, line",
    [
        ((), "PINHOLE 64 48 100.0 120.0 40.5 25.5"),
        ((0.1, 0.2, 0.3, 0.4), "OPENCV 64 48 100.0 120.0 40.5 25.5 0.1 0.2 0.3 0.4"),
        (
            (0.1, 0.2, 0.3, 0.4, 0.5),
            "FULL_OPENCV 64 48 100.0 120.0 40.5 25.5 0.1 0.2 0.3 0.4 0.5 0.0 0.0 0.0",
        ),
    ],
)
def test_colmap_cameras(distortion, line):
    camera = hg.Camera.from_intrinsics(hand_made.K, W, H, distortion=distortion)
    assert colmap.camera_line(camera, hand_made.frame()) == line
