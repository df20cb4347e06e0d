"""USD files in a real daemon: against arithmetic, and against what pxr says of the same stage."""

import math

import heliograph as hg
import moving_stages
import numpy as np
import pytest
import stages
from PIL import Image

pytest.importorskip("pxr", reason="the extra `usd` is not installed")
from pxr import Usd, UsdGeom

RED, GREEN, BLUE = (0.8, 0.1, 0.1), (0.1, 0.7, 0.2), (0.1, 0.2, 0.9)


def color_at(frame, x, y):
    """The base colour that is seen at world x, y."""
    return frame["base_color"][31 - math.floor(y * 32), 32 + math.floor(x * 32)]


def test_poses_and_boxes_are_those_of_pxr(scene, tmp_path):
    path = stages.written(tmp_path, stages.NESTED, "metersPerUnit = 0.01", 'upAxis = "Y"')
    asset = stages.put(scene, path)
    stage = Usd.Stage.Open(str(path))
    from_stage = np.array([[0.01, 0, 0, 0], [0, 0, -0.01, 0], [0, 0.01, 0, 0], [0, 0, 0, 1]])
    cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
    assert len(asset.entities) == 4
    for prim_path, entity in asset.entities.items():
        world = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(prim_path))).T
        np.testing.assert_allclose(entity.world_transform, from_stage @ world, atol=1e-6)
    mesh = stage.GetPrimAtPath("/A/Between/M")
    matrix = cache.GetLocalToWorldTransform(mesh)
    points = [matrix.Transform(p) for p in UsdGeom.Mesh(mesh).GetPointsAttr().Get()]
    points = np.array(points) @ from_stage[:3, :3].T
    np.testing.assert_allclose(asset.root.aabb, [points.min(0), points.max(0)], atol=1e-6)
    assert (asset.metres_per_unit, asset.up, asset.warnings) == (0.01, "y", [])


def test_the_root_moves_all_of_it_and_placing_again_shares(client, scene, tmp_path):
    path = stages.written(tmp_path, stages.TILES)
    first = stages.put(scene, path)
    with scene.edit() as edit:
        second = edit.import_usd(first, name="again", transform=hg.Pose((10, 0, 0)))
    one, other = first.entities["/Tiles"], second.entities["/Tiles"]
    np.testing.assert_allclose(other.aabb - one.aabb, np.tile((10, 0, 0), (2, 1)), atol=1e-6)
    assert one.mesh == other.mesh and one.materials == other.materials
    with client.create_scene() as elsewhere:
        with elsewhere.edit() as edit:
            third = edit.import_usd(first)
        np.testing.assert_allclose(third.root.aabb, first.root.aabb)


def test_subsets_have_their_materials_and_the_rest_the_mesh_s(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, stages.TILES))
    frame = scene.render("above", spp=1, planes=["base_color", "part", "depth"])
    np.testing.assert_allclose(color_at(frame, -0.75, 0), RED, atol=1e-3)
    np.testing.assert_allclose(color_at(frame, 0.1, 0), GREEN, atol=1e-3)
    np.testing.assert_allclose(color_at(frame, 0.75, 0), BLUE, atol=1e-3)
    assert np.isfinite(frame["depth"]).sum() == 64 * 64 / 2  # y from -0.5 to 0.5
    np.testing.assert_allclose(frame["depth"][32], 2, atol=1e-5)
    assert asset.warnings == []


@pytest.mark.parametrize("kind", ["vertex", "faceVarying", "indexed", "uniform"])
def test_display_colors_of_each_interpolation(scene, tmp_path, kind):
    stages.put(scene, stages.written(tmp_path, stages.colored(kind, RED, BLUE)))
    frame = scene.render("above", spp=1, planes=["base_color"])
    left, right = color_at(frame, -0.99, 0.2), color_at(frame, 0.99, 0.2)
    np.testing.assert_allclose(left, RED, atol=0.03)
    np.testing.assert_allclose(right, BLUE, atol=0.03)
    middle = color_at(frame, -0.02, 0.2)
    expected = RED if kind == "uniform" else np.add(RED, BLUE) / 2
    np.testing.assert_allclose(middle, expected, atol=0.03)


def test_textures_st_transforms_wraps_and_scale(scene, tmp_path):
    """2 x 2 texels: red, green above; blue, white below."""
    texels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
    Image.fromarray(texels).save(tmp_path / "tex.png")
    stages.put(scene, stages.written(tmp_path, stages.textured()))
    frame = scene.render("above", spp=1, planes=["base_color"])
    corners = [(-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)]
    for (x, y), color in zip(corners, texels.reshape(4, 3) / 255, strict=True):
        np.testing.assert_allclose(color_at(frame, x, y), color, atol=0.04)
    more = stages.textured(
        transform="float inputs:rotation = 90", texture="float4 inputs:scale = (0.5, 0.25, 0.5, 1)"
    )
    with scene.edit() as edit:
        edit.remove("it", cascade=True)
        edit.prune()
    stages.put(scene, stages.written(tmp_path, more))
    frame = scene.render("above", spp=1, planes=["base_color"])
    # (u, v) becomes (-v, u): what was at (1/4, 3/4) shows (-3/4, 1/4), which repeats blue
    for at, texel in {(-0.5, 0.5): (0, 0, 1), (0.5, 0.5): (1, 0, 0)}.items():
        expected = np.multiply(texel, (0.5, 0.25, 0.5))
        np.testing.assert_allclose(color_at(frame, *at), expected, atol=0.04)


def test_a_usdz_has_its_textures_and_those_outside_the_folder_are_refused(scene, tmp_path):
    from pxr import UsdUtils

    inside = tmp_path / "inside"
    inside.mkdir()
    Image.new("RGB", (4, 4), (0, 255, 0)).save(inside / "tex.png")
    path = stages.written(inside, stages.textured())
    packed = tmp_path / "packed.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(path), str(packed))
    asset = stages.put(scene, packed)
    frame = scene.render("above", spp=1, planes=["base_color"])
    np.testing.assert_allclose(color_at(frame, 0, 0), (0, 1, 0), atol=1e-3)
    assert asset.warnings == []

    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "tex.png")
    outside = stages.written(inside, stages.textured(file="../tex.png"))
    with scene.edit() as edit:
        refused = edit.import_usd(outside, name="refused")
        read = edit.import_usd(outside, name="read", folders=[tmp_path])
    assert "outside the stage's folder" in refused.warnings[0] and read.warnings == []


def test_polygons_that_are_not_convex_and_handedness(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, stages.ARROW))
    frame = scene.render("above", spp=1, planes=["normal", "instance"])
    seen = frame["instance"] > 0
    assert abs(seen.sum() - stages.ARROW_AREA * 32**2) < 64  # of 1300
    mesh = asset.entities["/Arrow"].mesh
    a, b, c = (mesh.positions[mesh.indices[:, i]] for i in range(3))
    up = np.cross(b - a, c - a)[:, 2]
    assert (up > 0).all()  # leftHanded: clockwise in the file
    assert up.sum() / 2 == pytest.approx(stages.ARROW_AREA, rel=1e-5)


def test_subdivision_is_that_of_catmull_and_clark(scene, tmp_path):
    """A cube: faces' middles, (edge's + 2 faces') / 4, and (F + 2 R + 0 P) / 3 at corners."""
    with scene.edit() as edit:
        path = stages.written(tmp_path, stages.cage(""))
        smooth = edit.import_usd(path, name="smooth", subdivision=1)
        finer = edit.import_usd(path, name="finer", subdivision=4)
        creased = "int[] creaseLengths = [5]\nint[] creaseIndices = [0, 2, 3, 1, 0]"
        path = stages.written(tmp_path, stages.cage(f"{creased}\nfloat[] creaseSharpnesses = [9]"))
        base = edit.import_usd(path, name="base", subdivision=4)
    faces = [sign * axis for axis in np.eye(3) for sign in (-1, 1)]
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    edges = [0.75 * s * (1 - a) for a in np.eye(3) for s in signs]
    expected = np.unique(np.round([*faces, *edges, *(signs * 5 / 9)], 5), axis=0)
    found = np.unique(np.round(smooth.entities["/Cage"].mesh.positions, 5), axis=0)
    np.testing.assert_allclose(found, expected, atol=2e-5)
    assert len(found) == 26 and smooth.warnings == []
    radii = np.linalg.norm(finer.entities["/Cage"].mesh.positions, axis=1)
    assert 0.84 < radii.min() and radii.max() < 0.88  # nearly a ball
    below = base.entities["/Cage"].mesh.positions
    on_floor = below[
        below[:, 2] < -0.999
    ]  # the ring of creases keeps it flat, and its border sharp
    assert len(on_floor) == 17**2 and np.ptp(on_floor[:, 0]) < 2 and below[:, 2].max() < 0.9


def test_shapes_have_the_boxes_and_areas_of_their_formulae(scene, tmp_path):
    path = stages.written(tmp_path, stages.SHAPES)
    asset = stages.put(scene, path)
    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    for prim_path, entity in asset.entities.items():
        box = cache.ComputeWorldBound(stage.GetPrimAtPath(prim_path)).ComputeAlignedRange()
        expected = np.array([box.GetMin(), box.GetMax()])
        np.testing.assert_allclose(entity.aabb, expected, atol=0.003, err_msg=prim_path)
        mesh = entity.mesh
        a, b, c = (mesh.positions[mesh.indices[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1).sum() / 2
        assert area == pytest.approx(stages.AREAS[prim_path], rel=0.005), prim_path
        middle = (a + b + c) / 3
        if "Plane" not in prim_path:
            assert (np.einsum("ij,ij->i", normal, middle) > 0).all(), (
                prim_path
            )  # they face outwards
        shading = mesh.normals[mesh.indices[:, 0]]
        assert (np.einsum("ij,ij->i", normal, shading) > 0).all(), prim_path


def test_instances_share_meshes_and_are_where_pxr_has_them(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, stages.INSTANCES))
    left, right = asset.entities["/Left/Ball"], asset.entities["/Right/Ball"]
    assert left.mesh == right.mesh and len(asset.meshes) == 5
    [other] = asset.instances["/Many/Cube'"]  # a prototype of the same name
    np.testing.assert_allclose(other.aabb, [(3.9, -0.1, 0.9), (4.1, 0.1, 1.1)], atol=1e-6)
    group = asset.instances["/Many/Cube"]
    expected = [(0, 0, 1), (2, 0, 1)]  # of three cubes the invisible one is left out
    np.testing.assert_allclose([e.world_transform[:3, 3] for e in group], expected, atol=1e-6)
    pair = asset.entities["/Many/3/Upper"]
    np.testing.assert_allclose(pair.world_transform[:3, 3], (3, 0, 1.5), atol=1e-6)


def test_prims_with_equal_arrays_share_a_mesh(scene, tmp_path):
    cubes = "".join(
        f'def Cube "{name}"\n{{\ndouble size = {size}\n}}\n'
        for name, size in (("A", 1), ("B", 1), ("C", 2))
    )
    asset = stages.put(scene, stages.written(tmp_path, cubes))
    a, b, c = (asset.entities[f"/{name}"].mesh for name in "ABC")
    assert a == b and a != c and list(asset.meshes) == ["/A", "/B", "/C"]
    np.testing.assert_allclose(np.abs(c.positions).max(0), 1, atol=1e-6)


def test_purposes_visibility_variants_and_payloads(scene, tmp_path):
    (tmp_path / "far.usda").write_text('#usda 1.0\n(\ndefaultPrim = "F"\n)\ndef Cube "F"\n{\n}\n')
    path = stages.written(tmp_path, stages.CHOICES)
    asset = stages.put(scene, path)
    frame = scene.render("above", spp=1, planes=["base_color"])
    np.testing.assert_allclose(color_at(frame, -0.5, 0.5), RED, atol=1e-3)  # the file's variant
    np.testing.assert_allclose(color_at(frame, 0.5, 0.5), 0, atol=1e-3)  # invisible
    np.testing.assert_allclose(color_at(frame, -0.5, -0.5), 0, atol=1e-3)  # proxy
    assert asset.entities["/Far"].mesh is not None
    with scene.edit() as edit:
        edit.remove("it", cascade=True)
        edit.prune()
    chosen = {"/Choice": {"look": "blue"}}
    asset = stages.put(scene, path, variants=chosen, payloads=False, purposes=("default", "proxy"))
    frame = scene.render("above", spp=1, planes=["base_color"])
    np.testing.assert_allclose(color_at(frame, -0.5, 0.5), BLUE, atol=1e-3)
    np.testing.assert_allclose(color_at(frame, -0.5, -0.5), GREEN, atol=1e-3)
    assert "/Far: its payload is left out, as payloads=False asks" in asset.warnings
    with pytest.raises(hg.NotFound, match="has no 'pink'; it has blue, red"), scene.edit() as edit:
        edit.import_usd(path, name="no", variants={"/Choice": {"look": "pink"}})


def test_semantics_become_categories(scene, tmp_path):
    stages.put(scene, stages.written(tmp_path, stages.SEMANTICS))
    frame = scene.render("above", spp=1, planes=["instance"], labels=True)
    rows = dict(zip(frame.labels["name"], frame.labels["category"], strict=True))
    named = {name: frame.categories[number] for name, number in rows.items() if number}
    assert named == {"it/New": "bolt", "it/Old": "nut"}


# ---------------------------------------------------------------- time


def test_keys_are_what_pxr_says_at_each_frame(scene, tmp_path):
    path = stages.written(tmp_path, moving_stages.TURNING, "timeCodesPerSecond = 24")
    still = stages.put(scene, path)
    assert still.warnings == ['/Turn: it moves, and is taken as at one time: give times="all"']
    with scene.edit() as edit:
        moving = edit.import_usd(path, name="moving", times="all")
    stage = Usd.Stage.Open(str(path))
    for code in (0, 5, 11, 24):
        with scene.edit() as edit:
            edit.time(code / 24)
        local = UsdGeom.Xformable(stage.GetPrimAtPath("/Turn")).GetLocalTransformation(code)
        found = moving.entities["/Turn"].world_transform
        np.testing.assert_allclose(found, np.array(local).T, atol=1e-5)  # a whole turn in 24 frames


def test_skins_and_blend_shapes_move_points_as_their_formulae_say(scene, tmp_path):
    path = stages.written(tmp_path, moving_stages.SKINNED, "timeCodesPerSecond = 24")
    asset = stages.put(scene, path, times="all")
    body = asset.entities["/Arm/Body"]
    np.testing.assert_allclose(body.aabb, [(0.9, 0, 0), (1.1, 0, 2)], atol=1e-5)
    with scene.edit() as edit:
        edit.time(1.0)
    np.testing.assert_allclose(body.aabb, [(0.9, 0, 0), (2.0, 0, 1.1)], atol=1e-5)  # 90 degrees
    face = asset.entities["/Arm/Face"]
    np.testing.assert_allclose(face.aabb[1], (1, 1 + 0.5, 0), atol=1e-5)  # half of 1 along y
    assert asset.warnings == []
