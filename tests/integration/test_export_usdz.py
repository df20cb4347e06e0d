"""scene.export() of USDZ files: what pxr says of them, and scenes read back from them."""

import math

import exported
import heliograph as hg
import numpy as np
import pytest

pytest.importorskip("pxr", reason="the extra `usd` is not installed")
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade

PLANES = ["beauty", "depth", "normal", "base_color"]


def written(scene, tmp_path):
    path = tmp_path / "scene.usdz"
    notes = exported.export(scene, path)
    check(path)
    return Usd.Stage.Open(str(path)), notes


def check(path):
    """Checks of usdchecker, where this pxr has it for Python."""
    try:
        from pxr import UsdValidation
    except ImportError:
        return
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 20
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    assert [error.GetMessage() for error in found] == []


def again(client, tmp_path, **options):
    scene = client.create_scene()
    with scene.edit() as edit:
        asset = edit.import_usd(tmp_path / "scene.usdz", **options)
    return scene, asset


def world_of(stage, path):
    cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
    return np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(path))).T


def test_prims_are_where_entities_are(scene, tmp_path):
    with scene.edit() as edit:
        exported.furnish(edit)
    stage, notes = written(scene, tmp_path)
    assert notes == []
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert str(stage.GetDefaultPrim().GetPath()) == "/World"
    names = {"ball/0": "ball_0", "ball/1": "group/ball_1", "box": "box", "eye": "eye",
             "lamp": "lamp"}  # fmt: skip
    for name, path in names.items():
        found = world_of(stage, f"/World/{path}")
        np.testing.assert_allclose(found, scene[name].world_transform, atol=1e-6)
    ball = stage.GetPrimAtPath("/World/ball_0")
    assert ball.GetDisplayName() == "ball/0"
    assert list(ball.GetAttribute("semantics:labels:class").Get()) == ["ball"]
    other = stage.GetPrimAtPath("/World/group/ball_1")
    assert ball.IsInstance() and ball.GetPrototype() == other.GetPrototype()


def test_vertices_parts_and_materials_of_a_mesh(scene, tmp_path):
    with scene.edit() as edit:
        exported.furnish(edit)
    stage, _ = written(scene, tmp_path)
    box, mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/box")), scene["box/mesh"]
    np.testing.assert_array_equal(np.array(box.GetPointsAttr().Get()), mesh.positions)
    indices = np.array(box.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
    np.testing.assert_array_equal(indices, mesh.indices)
    primvars = UsdGeom.PrimvarsAPI(box)
    np.testing.assert_array_equal(np.array(primvars.GetPrimvar("st").Get()), mesh.uvs)
    np.testing.assert_allclose(np.array(primvars.GetPrimvar("normals").Get()), mesh.normals)
    subsets = UsdShade.MaterialBindingAPI(box).GetMaterialBindSubsets()
    assert [subset.GetPrim().GetName() for subset in subsets] == ["b", "c"]
    (parts,) = scene.read(["box/mesh"], ["mesh.parts"])[0]
    for part, subset in enumerate(subsets, 1):
        assert list(subset.GetIndicesAttr().Get()) == np.flatnonzero(parts == part).tolist()
        bound = UsdShade.MaterialBindingAPI(subset).ComputeBoundMaterial()[0]
        assert bound.GetPrim().GetDisplayName() == "dull"


def test_the_scene_that_is_read_back_looks_the_same(client, scene, tmp_path):
    rng = np.random.default_rng(5)
    with scene.edit() as edit:
        exported.furnish(edit)
        edit.dome(rng.random((8, 16, 3)).astype("f4"), rotation=0.7, intensity=0.5)
    stage, _ = written(scene, tmp_path)
    assert UsdLux.DomeLight(stage.GetPrimAtPath("/World/dome")).GetIntensityAttr().Get() > 0
    before = scene.render("eye", spp=32, planes=[*PLANES, "semantic"])
    back, asset = again(client, tmp_path, camera_width=96)
    with back:
        after = back.render(asset.cameras["/World/eye"], spp=32, planes=[*PLANES, "semantic"])
        assert after["depth"].shape == (72, 96)
        exported.assert_alike(before, after)
        named = [np.array([f.categories.get(i, "") for i in range(9)]) for f in (before, after)]
        seen = [names[f["semantic"]] for names, f in zip(named, (before, after), strict=True)]
        assert (seen[0] == seen[1]).mean() > 0.998 and len(np.unique(seen[0])) == 3
        far = ~np.isfinite(before["depth"])
        sky = [frame["beauty"][far][:, :3] for frame in (before, after)]
        assert far.any()
        np.testing.assert_allclose(sky[0], sky[1], atol=0.02)
        assert asset.warnings == []


def test_lights_are_in_nits(scene, tmp_path):
    cone = {"outer_cone_angle": 0.5, "inner_cone_angle": 0.2}
    lights = {
        "sun": hg.Light(illuminance=900, color=(1, 0.5, 0), sun_angle=0.02),
        "spot": hg.Light(candela=100, shape="sphere", radius=0.1, **cone),
        "panel": hg.Light(power=8, shape="rectangle", width=2, height=0.5),
        "plate": hg.Light(luminance=50, shape="disc", radius=0.25),
    }
    with scene.edit() as edit:
        for name, light in lights.items():
            edit.entity(name, light=light)
        edit.entity("lit", mesh=edit.mesh("m", **hg.shapes.plane(2)), light=hg.Light(power=50))
    stage, notes = written(scene, tmp_path)
    assert notes == []

    def level(name):
        light = UsdLux.LightAPI(stage.GetPrimAtPath(f"/World/{name}"))
        return light.GetIntensityAttr().Get()

    sun = UsdLux.DistantLight(stage.GetPrimAtPath("/World/sun"))
    assert level("sun") == pytest.approx(900) and sun.GetNormalizeAttr().Get()
    assert sun.GetColorAttr().Get() == Gf.Vec3f(1, 0.5, 0)
    assert sun.GetAngleAttr().Get() == pytest.approx(math.degrees(0.02))
    assert level("spot") == pytest.approx(100 / (math.pi * 0.01))
    shaping = UsdLux.ShapingAPI(stage.GetPrimAtPath("/World/spot"))
    assert shaping.GetShapingConeAngleAttr().Get() == pytest.approx(math.degrees(0.5))
    assert shaping.GetShapingConeSoftnessAttr().Get() == pytest.approx(0.6)
    assert level("panel") == pytest.approx(683 * 8 / math.pi)
    assert level("plate") == pytest.approx(50)
    assert level("lit") == pytest.approx(683 * 50 / (4 * math.pi))


PARAMETERS = {
    "metal": {"base_color": (0.9, 0.6, 0.3), "metallic": 0.8, "roughness": 0.35},
    "coat": {"clearcoat": 0.7, "clearcoat_roughness": 0.2, "ior": 1.8},
    "lamp": {"emission": (3.0, 1.5, 0.75)},
    "veil": {"alpha": 0.25},
    "holes": {"alpha": 0.75},
    "tinted": {"specular_color": (0.9, 0.5, 0.1), "ior": 2.0},
}
MODES = {"veil": {"alpha_mode": "blend"}, "holes": {"alpha_mode": "mask", "alpha_cutoff": 0.3}}


def test_materials_keep_their_parameters(client, scene, tmp_path):
    with scene.edit() as edit:
        mesh = edit.mesh("m", **hg.shapes.cube())
        for name, given in PARAMETERS.items():
            material = edit.material(name, **given, **MODES.get(name, {}))
            edit.entity(f"e/{name}", mesh=mesh, material=material)
    _, notes = written(scene, tmp_path)
    assert notes == []
    back, asset = again(client, tmp_path)
    with back:
        for name, given in PARAMETERS.items():
            material = asset.materials[f"/World/Materials/{name}"]
            found = dict(material.parameters)
            found["emission"] = np.multiply(found["emission"], found["emission_strength"])
            for key, value in given.items():
                np.testing.assert_allclose(found[key], value, atol=1e-5, err_msg=f"{name} {key}")
            message = back.read([material], ["material"])[0][0].material
            mode = f"ALPHA_MODE_{MODES.get(name, {}).get('alpha_mode', 'opaque').upper()}"
            assert message.AlphaMode.Name(message.alpha_mode) == mode


def test_textures_show_the_same_colours(client, scene, tmp_path):
    rng = np.random.default_rng(1)
    turn = ((1.5 * math.cos(0.5), -0.8 * math.sin(0.5), 0.2),
            (1.5 * math.sin(0.5), 0.8 * math.cos(0.5), 0.3))  # fmt: skip
    planes = ["base_color", "roughness", "normal"]
    with scene.edit() as edit:
        color = edit.texture("color", rng.integers(0, 255, (8, 8, 4)).astype("u1"))
        sharp = edit.texture("sharp", rng.integers(0, 255, (8, 8)).astype("u1"), filter="nearest")
        hdr = edit.texture("hdr", rng.random((4, 4, 3)).astype("f2"), wrap="clamp")
        bumps = np.full((8, 8, 3), (90, 150, 230), "u1")
        bumps = edit.texture("bumps", bumps, encoding="linear")
        looks = [
            {"base_color": hg.Tex(color, factor=(0.9, 0.5, 0.2), uv=turn)},
            {"base_color": hg.Tex(sharp), "roughness": hg.Tex(color, channel=3, scale=0.5)},
            {"base_color": hg.Tex(hdr, scale=0.5, offset=0.25)},
            {"normal_map": hg.Tex(bumps, scale=0.5), "base_color": 0.3},
        ]
        for place, look in enumerate(looks):
            mesh = edit.mesh(f"m{place}", **hg.shapes.plane(1))
            edit.entity(f"square{place}", mesh=mesh, material=edit.material(f"l{place}", **look),
                        transform=hg.Pose((place - 1.5, 0, 0)))  # fmt: skip
        above = hg.look_at((0, 0, 3), (0, 0, 0), up=(0, 1, 0))
        edit.entity("above", camera=hg.Camera.orthographic(40, 160, 40), transform=above)
    known = [name for name in planes if name != "roughness"]
    before = scene.render("above", spp=1, planes=known)
    _, notes = written(scene, tmp_path)
    assert len(notes) == 1 and "not filtered" in notes[0]
    back, asset = again(client, tmp_path, camera_width=160)
    with back:
        after = back.render(asset.cameras["/World/above"], spp=1, planes=known)
    for name in known:
        off = np.abs(before[name] - after[name]).max(-1) > 0.004
        assert off.mean() < 0.02, name
    assert asset.warnings == []


def test_cameras_keep_their_lenses(client, scene, tmp_path):
    lens = hg.Camera(120, 80, 100.0, 110.0, 50.0, 45.0, near=0.5, far=40.0, aperture=0.01,
                     focus_distance=3.0, shutter=(-0.01, 0.02))  # fmt: skip
    with scene.edit() as edit:
        edit.entity("lens", camera=lens)
        edit.entity("flat", camera=hg.Camera.orthographic(25.0, 120, 80))
    _, notes = written(scene, tmp_path)
    assert notes == []
    back, asset = again(client, tmp_path, camera_width=120)
    with back:
        found = asset.cameras["/World/lens"].camera
        for name in ("fx", "cx", "near", "far", "aperture", "focus_distance"):
            assert getattr(found, name) == pytest.approx(getattr(lens, name), rel=1e-5), name
        # USD's pixels are square: the picture is higher instead
        assert found.fy / found.height == pytest.approx(110 / 80, rel=0.01)
        assert (found.cy + 0.5) / found.height == pytest.approx(45.5 / 80, rel=1e-5)
        np.testing.assert_allclose(found.shutter, lens.shutter, rtol=1e-5)
        flat = asset.cameras["/World/flat"].camera
        assert flat.projection == "orthographic" and flat.fx == pytest.approx(25, rel=1e-5)


def test_what_usd_cannot_say_is_named(scene, tmp_path):
    with scene.edit() as edit:
        edit.entity("round", camera=hg.Camera.fisheye(3, 64, 64))
        edit.entity("smoke", volume=edit.volume("v", density=np.ones((4, 4, 4), "f4")))
        edit.entity("window", portal=hg.Portal(1, 2))
        mesh = edit.mesh("m", **hg.shapes.plane())
        for name, given in {"wax": {"subsurface": 0.5}, "silk": {"sheen": 1},
                            "glass": hg.materials.glass}.items():  # fmt: skip
            edit.entity(f"e/{name}", mesh=mesh, material=edit.material(name, **given))
        edit.entity("away", mesh=mesh, visible=False)
    stage, notes = written(scene, tmp_path)
    found = "\n".join(notes)
    for text in ("round: fisheye cameras", "smoke: volumes", "wax: subsurface is", "silk: sheen is",
                 "glass: transmission is written as opacity"):  # fmt: skip
        assert text in found
    portal = UsdLux.PortalLight(stage.GetPrimAtPath("/World/window"))
    assert portal.GetHeightAttr().Get() == 2
    away = UsdGeom.Imageable(stage.GetPrimAtPath("/World/away"))
    assert away.ComputeVisibility() == "invisible"
