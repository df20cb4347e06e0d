"""Data sets of flow, tracks and views on a real scene (dataset_stage.py), read by other code."""

import pickle

import cv2
import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from dataset_stage import AT, EYE, LENS, H, K, W, load, made, picture, stage, view
from heliograph.datasets.draw import BasePoses

DT = 0.5


@pytest.fixture(scope="module")
def scene(client):
    with client.create_scene() as made_scene:
        stage(made_scene)
        yield made_scene


@pytest.fixture(scope="module")
def moving(client):
    """The crate moves along x, the camera turns, and all else stands still."""
    with client.create_scene() as made_scene:
        stage(made_scene)
        with made_scene.edit() as edit:
            there = hg.Pose((-0.1, 0.1, 0.2), euler=(0, 0, 0.5))
            edit.entity("crate", keys={0: made_scene["crate"].transform, DT: there})
            later = hg.look_at((EYE[0] + 0.1, *EYE[1:]), AT)
            edit.entity("cam", keys={0: hg.look_at(EYE, AT), DT: later})
        yield made_scene


def reprojected(scene, frame):
    """(H, W, 2) where the surfaces of the crate and of what stands still are in the later frame."""
    later = scene.render("cam", planes=["depth"], labels=["boxes"], time=DT)
    depth = frame["depth"].astype(float)
    x, y = np.meshgrid(np.arange(W), np.arange(H))
    points = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones((H, W))], -1)
    points = np.concatenate(
        [points * np.where(np.isfinite(depth), depth, 1)[..., None], np.ones((H, W, 1))], -1
    )
    world = np.linalg.inv(frame.camera_from_world_cv)
    crate = frame["instance"] == 1
    moved = later.labels["world_from_object"][0] @ np.linalg.inv(
        frame.labels["world_from_object"][0]
    )
    still = points @ (later.camera_from_world_cv @ world).T
    points = np.where(
        crate[..., None], points @ (later.camera_from_world_cv @ moved @ world).T, still
    )
    image = points[..., :3] @ K.T
    return image[..., :2] / image[..., 2:] - np.stack([x, y], -1)


def still(draw):
    """Draws nothing."""


FLOW = {"frame_interval": DT, "time": 0.0, "hold": True, "count": 1}


def test_flow_leads_to_the_second_picture(moving, tmp_path):
    frame = made(moving, hd.Middlebury(tmp_path), still, **FLOW)[0]
    flow = cv2.readOpticalFlow(str(tmp_path / "other-gt-flow/000000/flow10.flo"))
    assert flow.shape == (H, W, 2)
    labels = moving.render("cam", planes=["depth", "instance"], labels=["boxes"], time=0.0)
    known = np.isfinite(labels["depth"]) & (np.abs(flow) < 1e9).all(2)
    assert known.sum() > 4000 and np.abs(flow[known]).max() > 3
    np.testing.assert_allclose(flow[known], reprojected(moving, labels)[known], atol=0.05)
    first, second = (picture(tmp_path / f"other-data/000000/frame{n}.png") for n in (10, 11))
    assert np.array_equal(first[..., ::-1], frame.image(exposure="auto"))
    stops = frame.stops("auto")
    later = moving.render("cam", spp=1, seed=frame.seed, time=DT)
    assert np.array_equal(second[..., ::-1], later.image(exposure=stops))


def test_kitti_flow_and_disparity(client, tmp_path):
    with client.create_scene() as scene:
        stage(scene)
        with scene.edit() as edit:
            hg.stereo(edit, "rig", camera=LENS, baseline=0.1, transform=hg.look_at(EYE, AT))
        writer = hd.Kitti(tmp_path, objects=False, flow=True, disparity="rig/right")
        written = {}
        write = writer.write
        writer.write = lambda image: written.update({image.index: image.frame}) or write(image)
        options = {**FLOW, "spp": 1}
        hd.generate(scene, "rig/left", still, writer=writer, **options)
    frame = written[0]
    root = tmp_path / "training"
    assert not (root / "label_2").exists() and (root / "image_2/000000_11.png").exists()
    rgb = picture(root / "flow_occ/000000_10.png")[..., ::-1].astype(float)
    valid = rgb[..., 2] == 1
    assert valid.all()
    np.testing.assert_allclose((rgb[..., :2] - 32768) / 64, frame["flow_forward"], atol=0.5 / 64)
    seen = picture(root / "flow_noc/000000_10.png")[..., 0]
    assert np.array_equal(seen, frame["flow_forward_visible"])
    disparity = picture(root / "disp_occ_0/000000_10.png") / 256
    hit = frame["disparity"] > 1 / 256
    np.testing.assert_allclose(disparity[hit], frame["disparity"][hit], atol=0.5 / 256)
    both = picture(root / "disp_noc_0/000000_10.png") > 0
    assert np.array_equal(both, hit & (frame["disparity_visible"] > 0))
    calib = (root / "calib/000000.txt").read_text().splitlines()
    right = np.array(calib[3].split()[1:], float).reshape(3, 4)
    assert right[0, 3] == pytest.approx(-K[0, 0] * 0.1, rel=1e-5)


def test_flow_without_its_interval_is_refused(moving, tmp_path):
    with pytest.raises(hg.HeliographError, match="frame_interval"):
        made(moving, hd.Middlebury(tmp_path), still, count=1)


def push(draw):
    """Moves the crate by a step of a simulation, of a tenth of a second."""
    draw.edit.advance(0.1)
    draw.place(["crate"], [draw.pose("crate") @ hg.Pose((0.2, 0, 0)).matrix])


def test_flow_and_tracks_of_a_draws_own_motion(scene, tmp_path):
    made(scene, hd.Middlebury(tmp_path / "flow"), push, time=0.0, count=1)
    flow = cv2.readOpticalFlow(str(tmp_path / "flow/other-gt-flow/000000/flow10.flo"))
    made(scene, hd.TapVid(tmp_path / "tracks", times=[0, 0.1], points=100), push, count=1)
    (video,) = pickle.loads((tmp_path / "tracks/tapvid.pkl").read_bytes()).values()
    first, second = (picture(tmp_path / f"flow/other-data/000000/frame{n}.png") for n in (10, 11))
    assert not np.array_equal(first, second)
    seen = ~video["occluded"][:, 0]
    here, there = (video["points"][seen, t] * (W, H) - 0.5 for t in (0, 1))
    columns, rows = np.rint(here).astype(int).T
    moved = np.linalg.norm(there - here, axis=1)
    assert (moved > 5).sum() > 3 and (moved < 0.01).sum() > 3
    apart = np.linalg.norm(flow[rows, columns] - (there - here), axis=1)
    assert (apart < 0.2).mean() > 0.9  # the others are at an edge of the crate


# ---------------------------------------------------------------- tracks


def test_tap_vid_follows_points(moving, tmp_path):
    times = [0.0, 0.25, 0.5]
    made(moving, hd.TapVid(tmp_path, times=times, points=40), still, count=2)
    videos = pickle.loads((tmp_path / "tapvid.pkl").read_bytes())
    assert list(videos) == ["000000", "000001"]
    for video in videos.values():
        assert video["video"].shape == (3, H, W, 3) and video["video"].dtype == np.uint8
        assert video["points"].shape == (40, 3, 2) and video["points"].dtype == np.float32
        assert video["occluded"].shape == (40, 3) and video["occluded"].dtype == bool
        assert (~video["occluded"]).any(1).all()
    video = videos["000000"]
    assert not np.array_equal(video["video"][0], video["video"][2])
    moved = 0
    for first, second in ((0, 1), (0, 2)):
        frame = moving.render(
            "cam",
            planes=["flow_forward", "depth"],
            time=0.0,
            frame_interval=times[second] - times[first],
            hold=True,
        )
        seen = ~video["occluded"][:, first]
        here, there = (video["points"][seen, t] * (W, H) - 0.5 for t in (first, second))
        columns, rows = np.rint(here).astype(int).T
        flow = frame["flow_forward"][rows, columns]
        apart = np.linalg.norm(here + flow - there, axis=1)
        assert np.median(apart) < 0.1
        moved += (np.linalg.norm(flow, axis=1) > 1).sum()
    assert moved > 20
    others = videos["000001"]["points"]
    assert not np.array_equal(others, video["points"])  # each draw has points of its own


# ---------------------------------------------------------------- views


def test_nerf_transforms_cast_the_pixels_rays(scene, tmp_path):
    frames = made(scene, hd.NerfTransforms(tmp_path), view, count=3, size=(W // 2, H // 2))
    content = load(tmp_path / "transforms.json")
    assert (content["w"], content["h"], content["fl_x"]) == (W // 2, H // 2, K[0, 0] / 2)
    assert content["cx"] == pytest.approx((K[0, 2] + 0.5) / 2)
    for number, (found, frame) in enumerate(zip(content["frames"], frames.values(), strict=True)):
        assert picture(tmp_path / found["file_path"]).shape == (H // 2, W // 2, 3)
        camera = np.array(found["transform_matrix"])
        raster = np.array([10.5, 20.5])
        ray = np.array(
            [
                (raster[0] - content["cx"]) / content["fl_x"],
                -(raster[1] - content["cy"]) / content["fl_y"],
                -1.0,
            ]
        )  # OpenGL
        again = scene.render(
            "cam",
            planes=["position", "depth"],
            size=(W // 2, H // 2),
            overlay=overlay_of(scene, view, number),
        )
        np.testing.assert_allclose(again.camera_from_world_cv, frame.camera_from_world_cv)
        point = camera[:3, 3] + camera[:3, :3] @ ray * again["depth"][20, 10]
        np.testing.assert_allclose(point, again["position"][20, 10], atol=1e-4)


def overlay_of(scene, randomizer, number):
    """Draw of generate() for an image of seed 0."""
    overlay = scene.overlay()
    with overlay:
        base = BasePoses(scene)
        draw = hd.Draw(base, [scene["cam"]], (0, number, 0), overlay)
        randomizer(draw)
    return overlay


def colmap_model(root):
    """cameras, images and points as COLMAP's own reader takes them from the text."""
    lines = {}
    for name in ("cameras", "images", "points3D"):
        text = (root / f"sparse/0/{name}.txt").read_text().splitlines()
        lines[name] = [line for line in text if not line.startswith("#")]
    cameras = {int(line.split()[0]): line.split()[1:] for line in lines["cameras"]}
    images, rows = {}, iter(lines["images"])
    for head in rows:
        number, *pose, camera, name = head.split()
        points = np.array(next(rows).split(), float).reshape(-1, 3)
        images[int(number)] = (np.array(pose, float), int(camera), name, points)
    points = {int(line.split()[0]): line.split()[1:] for line in lines["points3D"]}
    return cameras, images, points


def test_colmap_points_project_where_the_images_say(scene, tmp_path):
    frames = made(scene, hd.Colmap(tmp_path, points=3000), view, count=3)
    cameras, images, points = colmap_model(tmp_path)
    assert cameras == {1: ["PINHOLE", str(W), str(H), "88.0", "101.0", "44.2", "35.7"]}
    assert sorted(images) == [1, 2, 3] and len(points) > 50
    assert sorted(points) == list(range(1, len(points) + 1))
    fx, fy, cx, cy = (float(v) for v in cameras[1][3:])
    for number, (pose, camera, name, seen) in images.items():
        assert camera == 1 and (tmp_path / "images" / name).exists()
        w, x, y, z = pose[:4]
        turn = hg.Pose((0, 0, 0), wxyz=(w, x, y, z)).matrix[:3, :3]
        np.testing.assert_allclose(turn, frames[number - 1].camera_from_world_cv[:3, :3], atol=1e-6)
        world = np.array([points[int(i)][:3] for i in seen[:, 2]], float)
        local = world @ turn.T + pose[4:]
        image = np.c_[fx * local[:, 0] / local[:, 2] + cx, fy * local[:, 1] / local[:, 2] + cy]
        np.testing.assert_allclose(image, seen[:, :2], atol=0.01)
    for number, point in points.items():
        track = np.array(point[7:], int).reshape(-1, 2)
        assert len(track) >= 2 and len(set(track[:, 0])) == len(track)
        for image, row in track:
            assert images[image][3][row, 2] == number
        assert all(0 <= int(c) <= 255 for c in point[3:6]) and point[6] == "0"
    heights = np.array([point[2] for point in points.values()], float)
    assert (heights > 0.01).sum() > 200  # not on the floor, which has nearly all of the area


def test_colmap_needs_a_surface(client, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.entity("cam", camera=LENS)
        with pytest.raises(hg.InvalidArgument, match="no mesh"):
            made(scene, hd.Colmap(tmp_path), still, count=1)


def test_colmap_refuses_what_moves(scene, tmp_path):
    def push(draw):
        draw.place(["behind"], [hg.Pose((draw.rng.uniform(), 0.7, 0.2))])

    with pytest.raises(hg.InvalidArgument, match="behind: a draw moved it"):
        made(scene, hd.Colmap(tmp_path, points=2000), push)


def test_lenses_that_draws_change(scene, tmp_path):
    """Each image's own distortion, which only its overlay has."""

    def bend(draw):
        lens = hg.Camera.from_intrinsics(K, W, H, distortion=(-0.1 * (1 + draw.index), 0.01, 0, 0))
        draw.edit.entity("cam", camera=lens)

    nerf = hd.NerfTransforms(tmp_path / "nerf")
    hd.generate(
        scene,
        "cam",
        bend,
        count=2,
        spp=1,
        writer=[nerf, hd.Colmap(tmp_path / "colmap", points=500)],
    )
    content = load(tmp_path / "nerf/transforms.json")
    assert [frame["k1"] for frame in content["frames"]] == [-0.1, -0.2]
    assert content["k2"] == 0.01 and content["camera_model"] == "OPENCV"
    cameras, images, points = colmap_model(tmp_path / "colmap")
    assert [camera[7] for camera in cameras.values()] == ["-0.1", "-0.2"]
    for pose, camera, _, seen in images.values():
        fx, fy, cx, cy, *distortion = (float(v) for v in cameras[camera][3:])
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        turn = hg.Pose((0, 0, 0), wxyz=pose[:4]).matrix[:3, :3]
        world = np.array([points[int(i)][:3] for i in seen[:, 2]], float)
        image = cv2.projectPoints(world, cv2.Rodrigues(turn)[0], pose[4:], k, np.array(distortion))
        np.testing.assert_allclose(image[0][:, 0], seen[:, :2], atol=0.01)
    with pytest.raises(hg.InvalidArgument, match="cam: has the distortion .*BOP"):
        hd.generate(scene, "cam", bend, count=1, spp=1, writer=hd.Bop(tmp_path / "bop"))


WRITERS = [hd.Bop, hd.Colmap, hd.Kitti, hd.Ndds, hd.NerfTransforms]


@pytest.mark.parametrize("writer", [*WRITERS, lambda root: hd.TapVid(root, times=[0])])
def test_rolling_shutters_have_no_one_pose(writer, scene, tmp_path):
    def roll(draw):
        draw.edit.entity("cam", camera=hg.Camera.from_intrinsics(K, W, H, rolling=0.01))

    with pytest.raises(hg.InvalidArgument, match="cam: has a rolling shutter"):
        made(scene, writer(tmp_path), roll, count=1)
