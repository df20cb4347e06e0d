"""Every centre plane and label column against numpy arithmetic on the same scene (oracle.py)."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from oracle import CV_FROM_GL, Thing, icosphere, look_at_cv, pixel_rays, pose, rotation, trace

WIDTH, HEIGHT = 96, 64
K = np.array([[88.0, 0, 43.7], [0, 101.0, 35.2], [0, 0, 1]])
PLANES = """
    depth distance position position_camera normal normal_camera geometric_normal uv
    barycentric base_color roughness metallic instance semantic part material primitive
    object_coordinates nocs flow_forward flow_backward flow_forward_valid flow_backward_valid
    flow_forward_visible flow_backward_visible scene_flow
""".split()
DT = 0.1


class World:
    """A plane, a squashed turning sphere, a box with a lid as its child; moved once."""

    def __init__(self, client: hg.Client) -> None:
        points, faces = icosphere(2)
        sphere_uv = np.stack([np.arctan2(points[:, 1], points[:, 0]), points[:, 2]], -1)
        quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
        quad_uv = quad[:, :2] * 0.5 + 0.5
        quad_faces = np.array([[0, 1, 2], [0, 2, 3]])
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        box_faces = np.array(
            [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
        )  # fmt: skip
        box_parts = (np.arange(12) >= 6).astype(np.uint32)

        self.eye, self.target = (
            [(0.2, -5.0, 2.6), (0.25, -4.9, 2.6)],
            [(0, 0, 0.6), (0.05, 0, 0.62)],
        )
        squash = (0.9, 0.5, 0.7)
        sphere = [
            pose((-0.9, 0.1, 0.8), rotation((0, 0, 1), 0.3), squash),
            pose((-0.8, 0.0, 0.85), rotation((0.2, 0, 1), 0.5), squash),
        ]
        box = [
            pose((0.9, 0.2, 0.5), rotation((0, 0, 1), 0.4), 0.4),
            pose((0.8, 0.15, 0.5), rotation((0, 0, 1), 0.6), 0.4),
        ]
        lid = pose((0, 0, 1.3), rotation((0, 0, 1), 0.2), (1.2, 1.2, 0.1))
        floor = pose(scale=4.0)
        self.states = [
            [
                Thing(quad, quad_faces, floor, None, quad_uv, None, 7, 1),
                Thing(points, faces, sphere[k], points, sphere_uv, None, 3, 2),
                Thing(corners, box_faces, box[k], None, None, box_parts, 5, 3),
                Thing(corners, box_faces, box[k] @ lid, None, None, box_parts, 5, 3, first_part=3),
            ]
            for k in range(2)
        ]
        self.scene = client.create_scene()
        with self.scene.edit() as edit:
            meshes = [
                edit.mesh("quad", positions=quad, indices=quad_faces, uvs=quad_uv),
                edit.mesh("sphere", positions=points, indices=faces, normals=points, uvs=sphere_uv),
                edit.mesh("box", positions=corners, indices=box_faces, parts=box_parts),
            ]
            grey = edit.material("grey", base_color=(0.5, 0.4, 0.3), roughness=0.25)
            steel = edit.material("steel", base_color=(0.7, 0.7, 0.6), metallic=1, roughness=0.125)
            edit.entity(
                "floor", mesh=meshes[0], material=grey, transform=floor, label=7, category="ground"
            )
            edit.entity(
                "ball",
                mesh=meshes[1],
                material=steel,
                transform=sphere[0],
                label=3,
                category="ball",
            )
            edit.entity(
                "crate",
                mesh=meshes[2],
                materials=[grey, steel],
                transform=box[0],
                label=5,
                category="crate",
            )
            edit.entity(
                "lid", parent="crate", mesh=meshes[2], materials=[steel, grey], transform=lid
            )
            camera = hg.Camera.from_intrinsics(K, WIDTH, HEIGHT)
            edit.entity("cam", camera=camera, transform=self.world_from_camera(0))
            edit.dome(color=(1, 1, 1))
        with self.scene.edit() as edit:
            edit.advance(DT)
            edit.entity("ball", transform=sphere[1])
            edit.entity("crate", transform=box[1])
            edit.entity("cam", transform=self.world_from_camera(1))
        # At the new time only backward flow is defined; at the old time only forward flow.
        self.frames = [
            self.scene.render(
                "cam", planes=[p for p in PLANES if "backward" not in p], time=0, frame_interval=DT
            ),
            self.scene.render(
                "cam",
                planes=[p for p in PLANES if "forward" not in p and p != "scene_flow"],
                labels=["boxes", "amodal", "amodal_masks"],
            ),
        ]

    def world_from_camera(self, k: int) -> np.ndarray:
        return np.linalg.inv(look_at_cv(self.eye[k], self.target[k])) @ CV_FROM_GL

    def camera_from_world(self, k: int) -> np.ndarray:
        return look_at_cv(self.eye[k], self.target[k])


@pytest.fixture(scope="module")
def world(client: hg.Client) -> World:
    return World(client)


class Truth:
    """What every pixel of one state should show."""

    def __init__(self, world: World, k: int) -> None:
        self.things = world.states[k]
        self.camera = world.camera_from_world(k)
        rays = pixel_rays(K, WIDTH, HEIGHT).reshape(-1, 3)
        r, t = self.camera[:3, :3], self.camera[:3, 3]
        self.origin = -r.T @ t
        self.directions = rays @ r
        self.hits = trace(self.things, self.origin, self.directions)
        self.hit = self.hits.thing >= 0
        self.sure = self.hit & (
            self.hits.margin > 2e-3
        )  # not on an edge, where either side is right
        reach = np.where(self.hit, self.hits.t, 0)
        self.position = self.origin + reach[:, None] * self.directions

    def corner_values(self, name: str, size: int) -> np.ndarray:
        """An attribute interpolated at the hits, (N, size); zeros where it is absent."""
        out = np.zeros((len(self.hit), size))
        for index, thing in enumerate(self.things):
            values = getattr(thing, name)
            if values is None:
                continue
            mine = np.flatnonzero(self.hits.thing == index)
            corner = values[thing.triangles[self.hits.triangle[mine]]]
            u, v = self.hits.u[mine, None], self.hits.v[mine, None]
            out[mine] = corner[:, 0] * (1 - u - v) + corner[:, 1] * u + corner[:, 2] * v
        return out

    def per_thing(self, values: list) -> np.ndarray:
        return np.array([*values, 0])[self.hits.thing]

    def geometric_normals(self) -> np.ndarray:
        out = np.zeros((len(self.hit), 3))
        for index, thing in enumerate(self.things):
            mine = np.flatnonzero(self.hits.thing == index)
            a, b, c = np.moveaxis(
                thing.world_positions()[thing.triangles[self.hits.triangle[mine]]], 1, 0
            )
            out[mine] = np.cross(b - a, c - a)
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-30)
        return np.where((out * self.directions).sum(1, keepdims=True) > 0, -out, out)


@pytest.fixture(scope="module", params=[0, 1], ids=["old", "new"])
def pair(request: pytest.FixtureRequest, world: World) -> tuple[hg.Frame, Truth]:
    return world.frames[request.param], Truth(world, request.param)


def flat(frame: hg.Frame, plane: str) -> np.ndarray:
    return np.asarray(frame[plane]).reshape(WIDTH * HEIGHT, -1)


def project(camera_from_world: np.ndarray, p: np.ndarray) -> np.ndarray:
    q = p @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    return q[:, :2] / q[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]


def test_ids(pair):
    frame, truth = pair
    sure = truth.sure | ~truth.hit & ~np.isfinite(flat(frame, "depth")[:, 0])
    assert sure.mean() > 0.95
    expected = {
        "instance": truth.per_thing([t.label for t in truth.things]),
        "semantic": truth.per_thing([t.category for t in truth.things]),
        "primitive": np.where(truth.hit, truth.hits.triangle, 0xFFFFFFFF),
    }
    mesh_part = np.zeros(len(truth.hit), int)
    for index, thing in enumerate(truth.things):
        mine = truth.hits.thing == index
        mesh_part[mine] = thing.first_part + (
            thing.parts[truth.hits.triangle[mine]] if thing.parts is not None else 0
        )
    expected["part"] = mesh_part
    for name, value in expected.items():
        assert frame[name].dtype == np.uint32
        np.testing.assert_array_equal(flat(frame, name)[sure, 0], value[sure], err_msg=name)


def test_geometry(pair):
    frame, truth = pair
    sure = truth.sure
    length = np.linalg.norm(truth.directions, axis=1)
    camera = truth.position @ truth.camera[:3, :3].T + truth.camera[:3, 3]
    normal = truth.geometric_normals()
    close = dict(rtol=2e-5, atol=2e-5)
    np.testing.assert_allclose(flat(frame, "depth")[sure, 0], truth.hits.t[sure], **close)
    np.testing.assert_allclose(
        flat(frame, "distance")[sure, 0], (truth.hits.t * length)[sure], **close
    )
    np.testing.assert_allclose(flat(frame, "position")[sure], truth.position[sure], **close)
    np.testing.assert_allclose(flat(frame, "position_camera")[sure], camera[sure], **close)
    np.testing.assert_allclose(flat(frame, "geometric_normal")[sure], normal[sure], **close)
    uv = truth.corner_values("uvs", 2)
    np.testing.assert_allclose(flat(frame, "uv")[sure], uv[sure], rtol=0, atol=2e-4)
    bary = np.stack([truth.hits.u, truth.hits.v], -1)
    np.testing.assert_allclose(flat(frame, "barycentric")[sure], bary[sure], rtol=0, atol=2e-4)


def test_shading_normals(pair):
    frame, truth = pair
    ball = truth.sure & (truth.hits.thing == 1)
    assert ball.sum() > 100
    thing = truth.things[1]
    smooth = truth.corner_values("normals", 3)[ball] @ np.linalg.inv(thing.world[:3, :3])
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
    got = flat(frame, "normal")[ball]
    np.testing.assert_allclose(got, smooth, atol=1e-4)
    np.testing.assert_allclose(
        flat(frame, "normal_camera")[ball], got @ truth.camera[:3, :3].T, atol=1e-5
    )
    rest = truth.sure & (truth.hits.thing != 1)
    np.testing.assert_allclose(
        flat(frame, "normal")[rest], flat(frame, "geometric_normal")[rest], atol=1e-6
    )


def test_material_parameters(pair):
    frame, truth = pair
    steel = np.zeros(len(truth.hit), bool)
    for index, swap in ((1, None), (2, False), (3, True)):
        mine = truth.hits.thing == index
        part = 1 if swap is None else truth.things[index].parts[truth.hits.triangle[mine]]
        steel[mine] = np.asarray(part) != (1 if swap else 0)
    sure = truth.sure
    np.testing.assert_allclose(flat(frame, "metallic")[sure, 0], steel[sure])
    np.testing.assert_allclose(
        flat(frame, "roughness")[sure, 0], np.where(steel, 0.125, 0.25)[sure]
    )
    base = np.where(steel[:, None], (0.7, 0.7, 0.6), (0.5, 0.4, 0.3))
    np.testing.assert_allclose(flat(frame, "base_color")[sure], base[sure], rtol=1e-6)


def test_object_coordinates(pair):
    frame, truth = pair
    ball = truth.sure & (truth.hits.thing == 1)
    points = truth.things[1].positions
    rest = truth.corner_values("positions", 3)[ball] * np.array([0.9, 0.5, 0.7])
    low, high = points.min(0) * [0.9, 0.5, 0.7], points.max(0) * [0.9, 0.5, 0.7]
    np.testing.assert_allclose(
        flat(frame, "object_coordinates")[ball], (rest - low) / (high - low), atol=1e-4
    )
    nocs = 0.5 + (rest - (low + high) / 2) / np.linalg.norm(high - low)
    np.testing.assert_allclose(flat(frame, "nocs")[ball], nocs, atol=1e-4)


@pytest.mark.parametrize(("k", "name"), [(0, "flow_forward"), (1, "flow_backward")])
def test_flow_is_reprojection(world, k, name):
    frame, truth = world.frames[k], Truth(world, k)
    moved = np.zeros_like(truth.position)
    for index, thing in enumerate(truth.things):
        mine = truth.hits.thing == index
        there = world.states[1 - k][index].world @ np.linalg.inv(thing.world)
        moved[mine] = truth.position[mine] @ there[:3, :3].T + there[:3, 3]
    other = world.camera_from_world(1 - k)
    here = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), -1).reshape(-1, 2)
    expected = project(other, moved) - here
    sure = truth.sure
    np.testing.assert_allclose(flat(frame, name)[sure], expected[sure], atol=0.01)
    assert flat(frame, name + "_valid").all()
    if name == "flow_forward":
        np.testing.assert_allclose(
            flat(frame, "scene_flow")[sure], (moved - truth.position)[sure], atol=1e-5
        )

    # The background moves as points at infinity do.
    away = ~truth.hit
    assert away.sum() > 50
    turned = truth.directions[away] @ other[:3, :3].T
    infinity = turned[:, :2] / turned[:, 2:] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]
    np.testing.assert_allclose(flat(frame, name)[away], infinity - here[away], atol=0.01)

    # Visible there: the other camera's ray to the moved point meets nothing on its way.
    eye = -other[:3, :3].T @ other[:3, 3]
    blocked = trace(world.states[1 - k], eye, moved - eye)
    raster = project(other, moved) + 0.5
    inside = (raster >= 0).all(1) & (raster[:, 0] < WIDTH) & (raster[:, 1] < HEIGHT)
    seen = inside & (blocked.t > 1 - 1e-4)
    clear = sure & (blocked.margin > 2e-3) & (np.abs(blocked.t - 1) < 1e-4) | sure & (
        blocked.t < 0.99
    )
    assert (flat(frame, name + "_visible")[clear, 0] == seen[clear]).mean() > 0.998


def test_empty_pixels(pair):
    frame, truth = pair
    away = ~truth.hit & (flat(frame, "instance")[:, 0] == 0)
    assert away.sum() > 50
    assert np.isposinf(flat(frame, "depth")[away]).all()
    assert np.isposinf(flat(frame, "distance")[away]).all()
    for name in ("position", "position_camera", "object_coordinates", "nocs"):
        assert np.isnan(flat(frame, name)[away]).all(), name
    for name in ("normal", "geometric_normal", "uv", "base_color", "instance", "semantic", "part"):
        assert (flat(frame, name)[away] == 0).all(), name
    for name in ("material", "primitive"):
        assert (flat(frame, name)[away] == 0xFFFFFFFF).all(), name


def rows(world: World) -> dict[int, int]:
    return {int(label): i for i, label in enumerate(world.frames[1].labels["label"])}


def test_label_rows(world):
    labels = world.frames[1].labels
    assert list(labels["label"]) == [3, 5, 7]
    frame = world.frames[1]
    assert [frame.categories[int(c)] for c in labels["category"]] == ["ball", "crate", "ground"]
    camera = world.camera_from_world(1)
    for label, root in ((7, 0), (3, 1), (5, 2)):
        row = rows(world)[label]
        m = world.states[1][root].world
        scale = np.linalg.norm(m[:3, :3], axis=0)
        rigid = m.copy()
        rigid[:3, :3] /= scale
        np.testing.assert_allclose(labels["world_from_object"][row], rigid, atol=1e-5)
        np.testing.assert_allclose(labels["camera_from_object_cv"][row], camera @ rigid, atol=1e-5)
        np.testing.assert_allclose(labels["scale"][row], scale, atol=1e-5)
        assert labels["rigid"][row]


def test_boxes_3d(world):
    labels = world.frames[1].labels
    row = rows(world)[5]
    crate, lid = world.states[1][2], world.states[1][3]
    m = labels["world_from_object"][row].astype(float)
    local = [(t.world_positions() - m[:3, 3]) @ m[:3, :3] for t in (crate, lid)]
    points = np.concatenate(local)
    low, high = points.min(0), points.max(0)
    np.testing.assert_allclose(labels["box_center"][row], (low + high) / 2, atol=1e-5)
    np.testing.assert_allclose(labels["box_half_extents"][row], (high - low) / 2, atol=1e-5)
    corners = labels["corners_camera"][row].astype(float)
    np.testing.assert_allclose(labels["corners_image"][row], project(np.eye(4), corners), atol=0.01)
    back = np.linalg.inv(labels["camera_from_object_cv"][row])
    local_corners = corners @ back[:3, :3].T + back[:3, 3]
    np.testing.assert_allclose(np.sort(local_corners, 0)[[0, -1]], [low, high], atol=1e-4)


def extent(mask: np.ndarray) -> list[int]:
    y, x = np.nonzero(mask)
    return [x.min(), y.min(), x.max() + 1, y.max() + 1] if len(x) else [0, 0, 0, 0]


def test_masks_boxes_and_counts(world):
    frame = world.frames[1]
    labels = frame.labels
    truth = Truth(world, 1)
    masks = [frame.amodal_mask(int(label)) for label in labels["label"]]
    total = 0
    for label, members in ((7, [0]), (3, [1]), (5, [2, 3])):
        row = rows(world)[label]
        visible = frame["instance"] == label
        total += visible.sum()
        assert labels["visible"][row] == visible.sum()
        assert list(labels["bbox_visible"][row]) == extent(visible)
        alone = trace([truth.things[i] for i in members], truth.origin, truth.directions)
        expected = (alone.thing >= 0).reshape(HEIGHT, WIDTH)
        sure = (alone.margin.reshape(HEIGHT, WIDTH) > 2e-3) | ~expected & ~masks[row]
        assert (masks[row] == expected)[sure].all()
        assert (visible <= masks[row]).all()
        assert labels["inside"][row] == masks[row].sum()
        assert list(labels["bbox_amodal"][row]) == extent(masks[row])

        wide = K + np.array([[0, 0, WIDTH], [0, 0, HEIGHT], [0, 0, 0]])
        rays = pixel_rays(wide, 3 * WIDTH, 3 * HEIGHT).reshape(-1, 3) @ truth.camera[:3, :3]
        canvas = trace([truth.things[i] for i in members], truth.origin, rays).thing >= 0
        assert abs(int(labels["canvas"][row]) - canvas.sum()) <= 3
        box = np.array(extent(canvas.reshape(3 * HEIGHT, 3 * WIDTH))) - [
            WIDTH,
            HEIGHT,
            WIDTH,
            HEIGHT,
        ]
        assert np.abs(labels["bbox_amodal_canvas"][row] - box).max() <= 1
        assert labels["visibility"][row] == pytest.approx(
            labels["visible"][row] / labels["canvas"][row]
        )
        assert labels["occlusion"][row] == pytest.approx(
            1 - labels["visible"][row] / labels["inside"][row]
        )
        assert labels["truncation"][row] == pytest.approx(
            1 - labels["inside"][row] / labels["canvas"][row]
        )
    assert total == (frame["instance"] != 0).sum()
