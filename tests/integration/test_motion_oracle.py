"""Planes and labels of surfaces that change shape, against numpy arithmetic (oracle_motion.py)."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import at_hits, extent, facing_normals, pixel_rays, pose, rotation, trace
from oracle_motion import (
    HEIGHT,
    WIDTH,
    Arm,
    Cloth,
    Face,
    K,
    Nested,
    Shape,
    Stage,
    Wall,
    project,
)

PLANES = """
    depth position normal geometric_normal barycentric instance primitive object_coordinates nocs
""".split()
FORWARD = ["flow_forward", "flow_forward_valid", "flow_forward_visible", "scene_flow"]
BACKWARD = ["flow_backward", "flow_backward_valid", "flow_backward_visible"]
DT = 0.3


class View:
    """A camera's view of some shapes: the truth for each pixel."""

    def __init__(self, shapes: list[Shape], camera: np.ndarray) -> None:
        self.shapes, self.camera = shapes, camera
        rays = pixel_rays(K, WIDTH, HEIGHT).reshape(-1, 3)
        self.directions = rays @ camera[:3, :3]
        self.eye = -camera[:3, :3].T @ camera[:3, 3]
        self.hits = trace(shapes, self.eye, self.directions)
        self.sure = (self.hits.thing >= 0) & (self.hits.margin > 4e-3)
        reach = np.where(self.hits.thing >= 0, self.hits.t, 0)
        self.position = self.eye + reach[:, None] * self.directions

    def on(self, values: list[np.ndarray]) -> np.ndarray:
        """Vertex values of each shape, interpolated where its triangles were hit."""
        out = np.zeros((len(self.directions), 3))
        for index, (shape, value) in enumerate(zip(self.shapes, values, strict=True)):
            mine, there = at_hits(self.hits, index, shape, value)
            out[mine] = there
        return out

    def geometric_normals(self) -> np.ndarray:
        return facing_normals(self.hits, self.shapes, self.directions)


def flat(frame: hg.Frame, plane: str) -> np.ndarray:
    return np.asarray(frame[plane], float).reshape(WIDTH * HEIGHT, -1)


def check_surfaces(frame: hg.Frame, view: View) -> None:
    sure = view.sure
    assert sure.mean() > 0.5
    labels = np.array([s.label for s in view.shapes] + [0])[view.hits.thing]
    np.testing.assert_array_equal(flat(frame, "instance")[sure, 0], labels[sure])
    assert len(np.unique(labels[sure])) == len(view.shapes)
    np.testing.assert_array_equal(flat(frame, "primitive")[sure, 0], view.hits.triangle[sure])
    np.testing.assert_allclose(flat(frame, "depth")[sure, 0], view.hits.t[sure], rtol=3e-5)
    np.testing.assert_allclose(flat(frame, "position")[sure], view.position[sure], atol=2e-4)
    bary = np.stack([view.hits.u, view.hits.v], -1)
    np.testing.assert_allclose(flat(frame, "barycentric")[sure], bary[sure], atol=1e-3)
    geometric = view.geometric_normals()
    np.testing.assert_allclose(flat(frame, "geometric_normal")[sure], geometric[sure], atol=1e-4)
    for index, shape in enumerate(view.shapes):
        mine = sure & (view.hits.thing == index)
        normal = flat(frame, "normal")[mine]
        if shape.normals is None:
            np.testing.assert_allclose(normal, geometric[mine], atol=1e-4)
            continue
        smooth = view.on(
            [s.normals if s is shape else np.zeros((len(s.positions), 3)) for s in view.shapes]
        )[mine] @ np.linalg.inv(shape.world[:3, :3])
        smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
        inside = (smooth * geometric[mine]).sum(1, keepdims=True) < 0  # both face the viewer
        smooth = np.where(inside, -smooth, smooth)
        np.testing.assert_allclose(normal, smooth, atol=5e-4)


def check_rest_and_boxes(frame: hg.Frame, view: View) -> None:
    """Rest coordinates do not follow the deformation; 2D boxes and masks do."""
    labels = frame.labels
    rows = {int(label): row for row, label in enumerate(labels["label"])}
    rest = view.on([s.rest for s in view.shapes])
    for index, shape in enumerate(view.shapes):
        row, mine = rows[shape.label], view.sure & (view.hits.thing == index)
        world_from_object = labels["world_from_object"][row]
        np.testing.assert_allclose(
            world_from_object[:3, :3] @ world_from_object[:3, :3].T, np.eye(3), atol=1e-5
        )
        to_object = world_from_object[:3, :3].T @ shape.world[:3, :3]
        corners = shape.rest[np.unique(shape.triangles)] @ to_object.T
        low, high = corners.min(0), corners.max(0)
        np.testing.assert_allclose(labels["box_center"][row], (low + high) / 2, atol=1e-4)
        np.testing.assert_allclose(labels["box_half_extents"][row], (high - low) / 2, atol=1e-4)
        size = high - low
        here = rest[mine] @ to_object.T - low
        wide = size > 1e-5
        got = flat(frame, "object_coordinates")[mine]
        np.testing.assert_allclose(
            got[:, wide], (here / np.where(wide, size, 1))[:, wide], atol=2e-3
        )
        nocs = 0.5 + (here - size / 2) / np.linalg.norm(size)
        np.testing.assert_allclose(flat(frame, "nocs")[mine][:, wide], nocs[:, wide], atol=2e-3)

        seen = frame["instance"] == shape.label
        assert list(labels["bbox_visible"][row]) == extent(seen)
        assert labels["visible"][row] == seen.sum()
        alone = trace([shape], view.eye, view.directions)
        mask = frame.amodal_mask(shape.label)
        clear = (alone.margin > 4e-3).reshape(HEIGHT, WIDTH)
        assert mask[clear].all()
        assert abs(int(mask.sum()) - int((alone.thing >= 0).sum())) <= 3
        assert list(labels["bbox_amodal"][row]) == extent(mask)
        assert not (seen & ~mask).any()


def check_flow(frame: hg.Frame, view: View, there: View, name: str) -> None:
    """The same barycentric point of the same triangle, projected at the other time."""
    sure = view.sure
    moved = view.on([s.world_positions() for s in there.shapes])
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    expected = project(there.camera, moved) - pixels
    np.testing.assert_allclose(flat(frame, name)[sure], expected[sure], atol=0.02)
    assert frame[name + "_valid"].all()
    if name == "flow_forward":
        motion = (moved - view.position)[sure]
        np.testing.assert_allclose(flat(frame, "scene_flow")[sure], motion, atol=2e-4)
    blocked = trace(there.shapes, there.eye, moved - there.eye)
    raster = project(there.camera, moved) + 0.5
    inside = (raster >= 0).all(1) & (raster[:, 0] < WIDTH) & (raster[:, 1] < HEIGHT)
    seen = inside & (blocked.t > 1 - 1e-4)
    clear = sure & ((blocked.t < 0.99) | ((blocked.margin > 4e-3) & (blocked.t < 1 + 1e-4)))
    assert clear.sum() > 0.4 * sure.sum()
    assert (flat(frame, name + "_visible")[clear, 0] == seen[clear]).mean() > 0.998


def view_of(stage: Stage, t: float) -> View:
    return View(stage.shapes(t), stage.camera(t))


@pytest.fixture(scope="module")
def keyed(client: hg.Client) -> Stage:
    return Stage(client, [Cloth(), Face(), Arm(), Nested(), Wall()])


@pytest.mark.parametrize("t", [-1.0, 0.0, 0.35, 0.9, 1.0, 1.7, 2.85, 9.0])
def test_keyed_surfaces(keyed, t):
    """Before, between, at and after the keys; one key range ends where another begins."""
    frame = keyed.scene.render(
        "cam",
        planes=PLANES + FORWARD + BACKWARD,
        time=t,
        frame_interval=DT,
        labels=["boxes", "amodal_masks"],
    )
    view = view_of(keyed, t)
    check_surfaces(frame, view)
    check_rest_and_boxes(frame, view)
    check_flow(frame, view, view_of(keyed, t + DT), "flow_forward")
    check_flow(frame, view, view_of(keyed, t - DT), "flow_backward")
    if t in (-1.0, 9.0):
        assert not flat(frame, "scene_flow").any()


def test_the_scenes_time_is_the_default(keyed):
    with keyed.scene.branch() as branch:
        with branch.edit() as edit:
            edit.time(0.9)
        asked = keyed.scene.render("cam", planes=PLANES, time=0.9)
        own = branch.render("cam", planes=PLANES)
        other = branch.render("cam", planes=PLANES, time=0.2)
        earlier = keyed.scene.render("cam", planes=PLANES, time=0.2)
    assert own.time == 0.9
    for name in PLANES:
        assert np.array_equal(own[name], asked[name], equal_nan=True), name
        assert np.array_equal(other[name], earlier[name], equal_nan=True), name


class Simulated:
    """The actors without keys, moved by edits on both sides of an advance()."""

    def __init__(self, client: hg.Client) -> None:
        self.cloth, self.face, self.arm, self.wall = Cloth(), Face(), Arm(), Wall()
        self.scene = client.create_scene()
        with self.scene.edit() as edit:
            for actor in (self.cloth, self.face, self.arm, self.wall):
                actor.build(edit)
            edit.mesh("cloth", positions=self.cloth.keys[1])
            edit.update("face/entity", morph_weights=self.face.weights[1])
            edit.update("wall/entity", transform=self.wall.world)
            self.pose_joints(edit, 0.0)
            camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
            edit.entity("cam", camera=camera, transform=hg.look_at((0, -7, 1.3), (0, 0, 1.1)))
        with self.scene.edit() as edit:
            edit.advance(DT)
            edit.mesh("cloth", positions=self.cloth.keys[2])
            edit.update("face/entity", morph_weights=self.face.weights[2])
            self.pose_joints(edit, 1.0)

    def pose_joints(self, edit: hg.Edits, t: float) -> None:
        hip, knee = self.arm.joints(t)
        edit.update("hip", transform=np.linalg.inv(self.arm.base) @ hip)
        edit.update("knee", transform=np.linalg.inv(hip) @ knee)

    def view(self, after: bool) -> View:
        k = 2 if after else 1
        cloth = Shape(
            self.cloth.keys[k],
            self.cloth.faces,
            self.cloth.world,
            label=self.cloth.label,
            rest=self.cloth.keys[2],
        )
        shapes = [cloth, self.face.shape(self.face.weights[k])]
        shapes += [self.arm.at(1.0 if after else 0.0), self.wall.at(0)]
        from oracle import look_at_cv

        return View(shapes, look_at_cv((0, -7, 1.3), (0, 0, 1.1)))


@pytest.fixture(scope="module")
def simulated(client: hg.Client) -> Simulated:
    return Simulated(client)


def test_flow_after_advance(simulated):
    scene, now, then = simulated.scene, simulated.view(True), simulated.view(False)
    labels = ["boxes", "amodal_masks"]
    frame = scene.render("cam", planes=PLANES + BACKWARD, labels=labels)
    check_surfaces(frame, now)
    check_rest_and_boxes(frame, now)
    check_flow(frame, now, then, "flow_backward")
    old = scene.render("cam", planes=PLANES + FORWARD, time=0, labels=labels)
    check_surfaces(old, then)
    check_rest_and_boxes(old, then)
    check_flow(old, then, now, "flow_forward")


def test_flow_after_save_and_load(client, simulated, tmp_path):
    planes = PLANES + BACKWARD + ["beauty"]
    frame = simulated.scene.render("cam", planes=planes, spp=2)
    old = simulated.scene.render("cam", planes=PLANES + FORWARD, time=0.1, hold=True)
    simulated.scene.save(tmp_path / "x.helio")
    with client.load_scene(tmp_path / "x.helio") as loaded:
        assert loaded.time == simulated.scene.time
        again = loaded.render("cam", planes=planes, spp=2)
        old_again = loaded.render("cam", planes=PLANES + FORWARD, time=0.1, hold=True)
    assert np.abs(frame["flow_backward"]).max() > 1
    for name in planes:
        assert frame[name].tobytes() == again[name].tobytes(), name
    for name in PLANES + FORWARD:
        assert old[name].tobytes() == old_again[name].tobytes(), name


def test_jumps_have_no_flow(simulated):
    """A joint that jumped, a topology that changed, a new entity; the rest keeps its flow."""
    arm, cloth, face, wall = (simulated.arm.label, simulated.cloth.label, simulated.face.label, 5)
    planes = ["instance", *BACKWARD]

    def invalid(scene):
        frame = scene.render("cam", planes=planes)
        bad = frame["flow_backward_valid"] == 0
        assert not frame["flow_backward"][bad].any()
        assert not frame["flow_backward_visible"][bad].any()
        labels = set(np.unique(frame["instance"]).tolist())
        assert {arm, cloth, face, wall} <= labels
        out = set(np.unique(frame["instance"][bad]).tolist())
        assert not out & set(np.unique(frame["instance"][~bad]).tolist())
        return out

    assert invalid(simulated.scene) == set()
    with simulated.scene.branch() as scene:
        with scene.edit() as edit:
            edit.update("hip", transform=scene["hip"].transform, teleport=True)
        assert invalid(scene) == {arm}
    with simulated.scene.branch() as scene:
        with scene.edit() as edit:
            edit.mesh("cloth", positions=simulated.cloth.rest, indices=simulated.cloth.faces)
            edit.entity("new", mesh="wall", transform=pose((2.4, 0, 1), scale=0.4), label=9)
        assert invalid(scene) == {cloth, 9}
    with simulated.scene.branch() as scene:
        with scene.edit() as edit:
            edit.update("cam", transform=scene["cam"].transform, teleport=True)
        assert invalid(scene) == {0, arm, cloth, face, wall}


def test_flow_needs_another_end_or_hold(client):
    face, wall = Face(), Wall()
    with client.create_scene() as scene:
        with scene.edit() as edit:
            face.build(edit)
            edit.mesh("wall", positions=wall.points, indices=wall.faces)
            edit.entity("back", mesh="wall", transform=wall.world, label=5)
            camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
            edit.entity("cam", camera=camera, transform=hg.look_at((0, -7, 1.3), (0, 0, 1.1)))
        with pytest.raises(hg.FailedPrecondition, match=r"'cam'.*hold"):
            scene.render("cam", planes=["flow_forward"], frame_interval=DT, time=0.5)
        with scene.edit() as edit:
            edit.update("cam", keys={t: scene["cam"].transform for t in (0, 1)})
        with pytest.raises(hg.FailedPrecondition, match=r"'back'.*hold"):
            scene.render("cam", planes=["flow_forward"], frame_interval=DT, time=0.5)
        held = scene.render(
            "cam", planes=["instance", *FORWARD], frame_interval=DT, time=0.5, hold=True
        )
    motion = np.abs(held["scene_flow"]).max(axis=2)
    assert held["flow_forward_valid"].all()
    assert not motion[held["instance"] == 5].any() and motion[held["instance"] == 2].max() > 0.05


def baked(scene, name: str, mesh: str, positions: np.ndarray, **more) -> None:
    """Replaces what an entity shows by a mesh of its own without morph targets."""
    with scene.edit() as edit:
        shape = edit.mesh(mesh + "/baked", positions=positions.astype("<f4"), **more)
        edit.update(name, morph_weights=None)
        edit.update(name, mesh=shape)


def test_shading_follows_the_deformation(client):
    """A shutter that a morph target pushes before a lamp, which a morph target makes wider."""
    points, faces = grid_of_lamp()
    away, wider = np.tile((3.0, 0, 0), (4, 1)), points * (1.0, 0, 0)
    with client.create_scene() as scene:
        with scene.edit() as edit:
            lamp = edit.mesh("lamp", positions=points, indices=faces, morph_positions=wider[None])
            shutter = edit.mesh(
                "shutter", positions=points, indices=faces, morph_positions=away[None]
            )
            floor = edit.mesh("floor", **hg.shapes.plane(4.0))
            down = pose((0, 0, 2), rotation((1, 0, 0), np.pi))
            light = hg.Light(radiance=5.0)
            edit.entity("lamp/e", mesh=lamp, transform=down, light=light, morph_weights=[0.0])
            edit.entity(
                "shutter/e",
                mesh=shutter,
                transform=pose((0, 0, 1.9), scale=2.5),
                morph_weights=[0.0],
            )
            edit.entity("floor/e", mesh=floor)
            lens = hg.Camera.from_fov(1.0, 24, 24)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -1.5, 1.5), (0, 0, 0)))

        def picture(shutter_weight, lamp_weight):
            with scene.edit() as edit:
                edit.update("shutter/e", morph_weights=[shutter_weight])
                edit.update("lamp/e", morph_weights=[lamp_weight])
            return scene.render("cam", spp=64)["beauty"][..., :3].copy()

        shut, opened, wide = picture(0, 0), picture(1, 0), picture(1, 1)
        assert shut.mean() < 0.02 * opened.mean()
        # Twice the area of a far lamp: twice the light, less what a wider lamp loses to cosines.
        assert 1.7 < wide.mean() / opened.mean() < 2.02
        baked(scene, "lamp/e", "lamp", points + wider, indices=faces)
        baked(scene, "shutter/e", "shutter", points + away, indices=faces)
        assert np.array_equal(scene.render("cam", spp=64)["beauty"][..., :3], wide)


def grid_of_lamp() -> tuple[np.ndarray, np.ndarray]:
    points = np.array([[-0.25, -0.25, 0], [0.25, -0.25, 0], [0.25, 0.25, 0], [-0.25, 0.25, 0]])
    return points, np.array([[0, 1, 2], [0, 2, 3]])
