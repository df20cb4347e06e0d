"""Edits, reads, queries and frames of the Python client against the real daemon."""

import asyncio
from pathlib import Path

import heliograph as hg
import heliograph.aio
import numpy as np
import pytest
from heliograph.datasets import bundled_domes

ASSETS = Path(__file__).resolve().parents[2] / "examples/assets"
INTERIOR = next(path for path in bundled_domes() if path.stem == "interior")


def build(scene, count=3):
    """A studio, a row of balls and a camera."""
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("ball/mesh", **hg.shapes.sphere(0.4))
        gold = edit.material("gold", **hg.materials.gold)
        poses = np.tile(np.eye(4), (count, 1, 1))
        poses[:, 0, 3] = np.arange(count) - (count - 1) / 2
        poses[:, 2, 3] = 0.4
        balls = edit.instances("ball", mesh=mesh, material=gold, transforms=poses, category="ball")
        lens = hg.Camera.from_fov(50, 160, 120, degrees=True)
        cam = edit.entity("cam", camera=lens, transform=hg.look_at((0, -4, 1.5), (0, 0, 0.4)))
    return balls, cam


def test_what_is_written_is_read(scene):
    balls, cam = build(scene)
    assert scene.revision == 1
    assert np.allclose(scene.transforms(balls)[:, 0, 3], [-1, 0, 1])
    assert np.allclose(balls[2].world_transform[:3, 3], (1, 0, 0.4))
    assert np.allclose(balls[1].aabb, [[-0.4, -0.4, 0], [0.4, 0.4, 0.8]], atol=2e-3)
    assert balls[0].material == scene["gold"] and balls[0].mesh == scene["ball/mesh"]
    assert balls[0].visible and balls[0].parent is None
    mesh = scene["ball/mesh"]
    shape = hg.shapes.sphere(0.4)
    for name in ("positions", "indices", "normals", "uvs"):
        assert np.array_equal(getattr(mesh, name), shape[name])
    k = hg.Camera.from_fov(50, 160, 120, degrees=True).K
    assert np.array_equal(cam.K, k)
    parameters = scene["gold"].parameters
    assert parameters["metallic"] == 1 and parameters["base_color"] == pytest.approx(
        (1, 0.77, 0.34)
    )
    assert [b.name for b in scene.find("ball/[0-9]")] == ["ball/0", "ball/1", "ball/2"]
    assert "entity ball/1" in scene.tree() and scene.categories == {1: "ball"}
    assert scene.memory()["arrays"] > 0


def test_none_clears(scene):
    balls, _ = build(scene)
    with scene.edit() as edit:
        edit.update(balls[0], material=None, transform=None)
        edit.update("ball/1", visible=False)
    assert balls[0].material is None and np.array_equal(balls[0].transform, np.eye(4))
    assert not scene["ball/1"].visible


def test_errors_list_who_was_meant_and_who_uses(scene):
    build(scene)
    with pytest.raises(hg.NotFound) as refused, scene.edit() as edit:
        edit.update("bal/1", visible=False)
    assert "ball/1" in refused.value.nearest
    with pytest.raises(hg.FailedPrecondition) as refused, scene.edit() as edit:
        edit.remove("gold")
    assert "entity 'ball/0'" in refused.value.users


def test_expected_revision(scene):
    build(scene)
    with pytest.raises(hg.Aborted) as aborted, scene.edit(expected_revision=7) as edit:
        edit.entity("x")
    assert aborted.value.expected == 1
    with scene.edit(expected_revision=1) as edit:
        edit.entity("x")
    assert scene.revision == 2


def test_large_meshes_travel(scene):
    side = 500
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    positions = np.column_stack([x.ravel(), y.ravel(), 0.1 * np.sin(9 * x.ravel())])
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    indices = np.concatenate(
        [np.column_stack([a, a + 1, a + side + 1]), np.column_stack([a, a + side + 1, a + side])]
    )
    for lift in (0, 1):
        with scene.edit() as edit:
            mesh = edit.mesh("m", positions=positions + (0, 0, lift), indices=indices)
        assert np.allclose(mesh.positions, positions + (0, 0, lift), atol=1e-6)
    with scene.edit() as edit:
        edit.mesh("m", positions=positions * 2)
    assert np.allclose(mesh.positions, positions * 2, atol=1e-6)
    assert np.array_equal(mesh.indices, indices)


def test_ids_of_many_travel_once(scene):
    count = 9000
    places = np.tile(np.eye(4, dtype="f4"), (count, 1, 1))
    with scene.edit() as edit:
        group = edit.instances("p", transforms=places)
    sources = []
    for k in range(4):
        places[:, 0, 3] = np.arange(count) + k
        with scene.edit() as edit:
            edit.set_transforms(group, places)
            sources.append(edit.transaction.edits[0].poses.ids.WhichOneof("source"))
        assert np.array_equal(scene.transforms(group[::500]), places[::500])
    assert sources == ["buffer", "blob", "blob", "blob"]
    overlay = scene.overlay()
    with overlay as edit:
        edit.set_transforms(group, places)
    assert overlay.transaction.edits[0].poses.ids.WhichOneof("source") == "blob"


def test_frames_and_their_labels(scene):
    balls, cam = build(scene)
    planes = ["beauty", "depth", "normal", "instance", "position", "semantic"]
    frame = scene.render(cam, spp=8, planes=planes, seed=3, labels=True)
    assert frame.planes == planes and frame["beauty"].shape == (120, 160, 4)
    assert frame.camera == "cam" and frame.revision == 1 and frame.samples == 8
    assert frame.categories == {1: "ball"} and len(frame.instances) == 3
    assert sorted(frame.instances.values()) == [f"ball/{i}" for i in range(3)]
    for label, box in zip(frame.labels["label"], frame.labels["bbox_visible"], strict=True):
        ys, xs = np.nonzero(frame["instance"] == label)
        assert box.tolist() == [xs.min(), ys.min(), xs.max() + 1, ys.max() + 1]
    v, u = np.nonzero(frame["instance"] > 0)
    local = frame["position"][v, u] @ frame.camera_from_world_cv[:3, :3].T
    local = local + frame.camera_from_world_cv[:3, 3]
    image = local @ frame.K.T
    assert np.abs(image[:, 0] / image[:, 2] - u).max() < 0.01
    assert np.allclose(local[:, 2], frame["depth"][v, u], atol=1e-4)
    again = scene.render(cam, spp=8, planes=planes, seed=3)
    assert all(np.array_equal(frame[p], again[p], equal_nan=True) for p in planes)
    assert frame["beauty"][..., :3].mean() > 0.05 and frame.annotated().shape == (120, 160, 3)


def test_several_cameras_sizes_and_progress(scene):
    _, cam = build(scene)
    seen = []
    frames = scene.render([cam, "cam"], seconds=0.4, size=(320, 240), progress=seen.append)
    assert len(frames) == 2 and frames[1]["beauty"].shape == (240, 320, 4)
    assert frames[0].K[0, 0] == pytest.approx(2 * 160 / 2 / np.tan(np.radians(25)))
    assert seen and all(0 <= p.done <= 1 for p in seen)
    passes = []
    scene.render(cam, spp=8, on_pass=passes.append)
    assert [f.samples for f in passes] == sorted({f.samples for f in passes})
    assert passes[-1].samples == 8 and passes[-1].is_final and len(passes) > 1


def test_overlays_change_nothing(scene):
    balls, cam = build(scene)
    before = scene.render(cam, spp=1, planes=["instance"])
    with scene.overlay() as overlay:
        overlay.remove(balls[0])
    without = scene.render(cam, spp=1, planes=["instance"], overlay=overlay)
    after = scene.render(cam, spp=1, planes=["instance"])
    assert np.array_equal(before["instance"], after["instance"]) and scene.revision == 1
    assert len(np.unique(without["instance"])) == 3


def test_branches(scene):
    balls, _ = build(scene)
    with scene.branch() as worker:
        with worker.edit() as edit:
            edit.update(balls[0], transform=hg.Pose((0, 0, 9)))
        assert worker["ball/0"].transform[2, 3] == 9
    assert balls[0].transform[2, 3] == pytest.approx(0.4)


def test_flow_needs_its_other_end(scene):
    balls, cam = build(scene)
    with pytest.raises(hg.FailedPrecondition, match="hold|advance|interval"):
        scene.render(cam, planes=["flow_backward"])
    moved = np.array(scene.transforms(balls))
    moved[:, 0, 3] += 0.1
    with scene.edit() as edit:
        edit.advance(1 / 30)
        edit.set_transforms(balls, moved)
    frame = scene.render(cam, planes=["flow_backward", "flow_backward_valid", "instance"])
    ball = frame["instance"] > 0
    assert (frame["flow_backward"][ball][:, 0] < -1).mean() > 0.9
    assert frame["flow_backward_valid"].dtype == np.uint8


def test_queries(scene):
    balls, cam = build(scene)
    hits = scene.cast_rays([[-1, -5, 0.4], [0, -5, 9]], (0, 1, 0))
    assert hits.t[0] == pytest.approx(4.6, abs=1e-3) and np.isinf(hits.t[1])
    assert hits["entity"][0] == balls[0].id and hits.normal[0] == pytest.approx(
        (0, -1, 0), abs=0.05
    )
    any_hit = scene.cast_rays([[-1, -5, 0.4], [0, -5, 9]], (0, 1, 0), any_hit=True)
    assert any_hit.t[0] == 0 and np.isinf(any_hit.t[1])
    frame = scene.render(cam, planes=["depth", "instance"])
    v, u = np.nonzero(frame["instance"] == 2)
    picked = scene.pick(cam, np.column_stack([u, v]))
    assert (picked.instance == 2).all()
    assert scene.visible(cam, balls).visible.all()
    assert scene.overlaps(balls, balls).shape == (3, 3)
    points = scene.sample_surface(balls, 1000, seed=1)
    assert points.position.shape == (1000, 3) and set(points.entity) == {b.id for b in balls}


def test_scene_files(client, scene, tmp_path):
    _, cam = build(scene)
    frame = scene.render(cam, spp=4, seed=5)
    scene.save(tmp_path / "x.helio")
    with client.load_scene(tmp_path / "x.helio", name="again") as loaded:
        assert np.array_equal(loaded.render("cam", spp=4, seed=5)["beauty"], frame["beauty"])
        assert np.array_equal(loaded.rerender(frame.manifest)["beauty"], frame["beauty"])
        assert "again" in [s.name for s in client.scenes()]


def test_imports(scene):
    with scene.edit() as edit:
        asset = edit.import_file(ASSETS / "FlightHelmet/FlightHelmet.gltf", category="helmet")
    assert len(asset.materials) == 6 and asset.root.name == "FlightHelmet"
    names = [o.name for o in scene.find("*")]
    for thing in (*asset.entities, *asset.materials.values(), *asset.meshes.values()):
        assert thing.name in names and scene[thing.name].id == thing.id
    assert asset.bounds.shape == (2, 3) and np.allclose(asset.root.aabb, asset.bounds, atol=1e-3)
    with scene.edit() as edit:
        red = edit.material("red", base_color=(1, 0, 0))
        first = next(iter(asset.materials))
        copy = edit.instance(asset, transform=hg.Pose((1, 0, 0)), materials={first: red})
    assert copy.name == "FlightHelmet/1" and len(scene.find("FlightHelmet/1*")) > 1
    with pytest.raises(hg.InvalidArgument, match="picture"), scene.edit() as edit:
        edit.import_file(INTERIOR)


def test_images(scene, tmp_path):
    from PIL import Image

    Image.fromarray(np.full((4, 4, 3), 128, np.uint8)).save(tmp_path / "grey.png")
    with scene.edit() as edit:
        grey = edit.texture("grey", tmp_path / "grey.png")
        edit.material("m", base_color=grey, roughness=hg.Tex(grey, channel=1))
        edit.dome(INTERIOR, intensity=2, rotation=1.0)
        edit.dome(INTERIOR)
    assert len(scene.find("dome/*")) == 1
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n\x1a\nnonsense")
    with pytest.raises(hg.InvalidArgument, match=r"bad\.png"), scene.edit() as edit:
        edit.texture("bad", tmp_path / "bad.png")


def test_async(client):
    async def work():
        async with await hg.aio.connect(client.address) as twin:
            async with await twin.create_scene() as scene:
                build(scene.sync)
                for k in range(5):
                    async with scene.edit() as edit:
                        edit.update("ball/0", transform=hg.Pose((0, 0, k)))
                jobs = [scene.render("cam", spp=1, seed=s) for s in range(4)]
                frames = await asyncio.gather(*jobs)
                return await scene.revision(), [f.seed for f in frames]

    assert asyncio.run(work()) == (6, [0, 1, 2, 3])
