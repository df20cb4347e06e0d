"""scene.export() of GLB files: arithmetic over what they hold, and scenes read back from them."""

import io
import math
from pathlib import Path

import exported
import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import scene_pb2 as pb
from heliograph.export.looks import look_of
from heliograph.export.world import World
from PIL import Image

REPOSITORY = Path(__file__).resolve().parents[2]
PLANES = ["beauty", "depth", "normal", "base_color"]
UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # file from world


def written(scene, tmp_path):
    path = tmp_path / "scene.glb"
    notes = exported.export(scene, path)
    glb = exported.Glb(path)
    glb.check()
    return glb, notes


def again(client, tmp_path, **options):
    """A fresh scene with the file, and the asset."""
    scene = client.create_scene()
    with scene.edit() as edit:
        asset = edit.import_file(tmp_path / "scene.glb", **options)
    return scene, asset


def test_nodes_are_where_entities_are_and_share_their_meshes(scene, tmp_path):
    with scene.edit() as edit:
        exported.furnish(edit)
    glb, notes = written(scene, tmp_path)
    assert notes == []
    worlds = glb.worlds()
    for name in ("group", "ball/0", "box", "floor", "lamp", "eye"):
        expected = UP @ scene[name].world_transform
        np.testing.assert_allclose(worlds[glb.node(name)], expected, atol=2e-6)
    inner = glb.json["nodes"][glb.node("ball/1")]["children"][0]
    np.testing.assert_allclose(worlds[inner], UP @ scene["ball/1"].world_transform, atol=2e-6)
    nodes = glb.json["nodes"]
    assert nodes[glb.node("ball/0")]["mesh"] == nodes[inner]["mesh"]
    assert nodes[glb.node("box")]["extras"] == {"category": "box", "instance": 3}


def test_vertices_are_those_of_the_mesh(scene, tmp_path):
    with scene.edit() as edit:
        exported.furnish(edit)
    glb, _ = written(scene, tmp_path)
    box = glb.json["meshes"][glb.json["nodes"][glb.node("box")]["mesh"]]
    mesh, (colors,) = scene["box/mesh"], scene.read(["box/mesh"], ["mesh.colors"])[0]
    names = [primitive["extras"]["part"] for primitive in box["primitives"]]
    assert names == ["a", "b", "c"]
    materials = [glb.json["materials"][p["material"]]["name"] for p in box["primitives"]]
    assert materials == ["red", "dull", "dull"]  # the last one serves the rest
    attributes = box["primitives"][0]["attributes"]
    assert all(primitive["attributes"] == attributes for primitive in box["primitives"])
    np.testing.assert_array_equal(glb.array(attributes["POSITION"]), mesh.positions)
    np.testing.assert_allclose(glb.array(attributes["NORMAL"]), mesh.normals, atol=1e-7)
    np.testing.assert_array_equal(glb.array(attributes["COLOR_0"]), colors)
    flipped = np.column_stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]])
    np.testing.assert_allclose(glb.array(attributes["TEXCOORD_0"]), flipped, atol=1e-7)
    faces = np.concatenate([glb.array(p["indices"]).reshape(-1, 3) for p in box["primitives"]])
    assert sorted(map(tuple, faces.tolist())) == sorted(map(tuple, mesh.indices.tolist()))


def test_the_scene_that_is_read_back_looks_the_same(client, scene, tmp_path):
    with scene.edit() as edit:
        exported.furnish(edit)
    written(scene, tmp_path)
    before = scene.render("eye", spp=32, planes=PLANES)
    back, asset = again(client, tmp_path)
    with back:
        (eye,) = asset.cameras
        after = back.render(eye, spp=32, planes=PLANES, size=(96, 72))
        exported.assert_alike(before, after)
        own = [n.replace("/", "_") for n in exported.seen(scene, "eye")]
        other = [n.rpartition("/")[2] for n in exported.seen(back, eye)]
        named = {"ball_1": "ball_1.turned", "lamp": "lamp.light_2"}
        same = [named.get(a, a) == b for a, b in zip(own, other, strict=True)]
        assert np.mean(same) > 0.998 and asset.warnings == []


PARAMETERS = {
    "metal": {"base_color": (0.9, 0.6, 0.3), "metallic": 0.8, "roughness": 0.35},
    "glass": {"transmission": 1.0, "ior": 1.33, "roughness": 0.1, "base_color": (1.0, 0.9, 0.9),
              "attenuation_color": (0.2, 0.5, 0.9), "attenuation_distance": 0.25},
    "sheet": {"transmission": 0.5, "thin_walled": True},
    "leaf": {"diffuse_transmission": 0.6, "diffuse_transmission_color": (0.3, 0.7, 0.1),
             "thin_walled": True},
    "wax": {"diffuse_transmission": 0.5, "attenuation_color": (0.9, 0.4, 0.2),
            "attenuation_distance": 0.1},
    "diamond": {"transmission": 1.0, "ior": 2.4, "dispersion": 0.36},
    "coat": {"clearcoat": 0.7, "clearcoat_roughness": 0.2},
    "cloth": {"sheen": 1.0, "sheen_color": (0.5, 0.25, 0.125), "sheen_roughness": 0.6},
    "brushed": {"anisotropic": 0.7, "anisotropic_rotation": 0.2, "roughness": 0.5,
                "metallic": 1.0},
    "film": {"iridescence": 0.9, "iridescence_ior": 1.8, "iridescence_thickness": 310.0},
    "lacquer": {"specular": 0.25, "specular_color": (0.9, 0.5, 0.1), "ior": 2.0},
    "lamp": {"emission": (1.0, 0.5, 0.25), "emission_strength": 12.0, "two_sided_emission": True},
    "veil": {"alpha": 0.25, "alpha_mode": "blend"},
    "holes": {"alpha": 0.75, "alpha_mode": "mask", "alpha_cutoff": 0.3},
    "sign": {"unlit": True, "base_color": (0.2, 0.7, 0.3)},
}  # fmt: skip


def test_materials_keep_their_parameters(client, scene, tmp_path):
    with scene.edit() as edit:
        mesh = edit.mesh("m", **hg.shapes.cube())
        for name, given in PARAMETERS.items():
            edit.entity(f"e/{name}", mesh=mesh, material=edit.material(name, **given))
    _, notes = written(scene, tmp_path)
    assert notes == []
    back, asset = again(client, tmp_path)
    with back:
        for name, given in PARAMETERS.items():
            found = asset.materials[name].parameters
            message = back.read([asset.materials[name]], ["material"])[0][0].material
            for key, value in given.items():
                if key in found:
                    np.testing.assert_allclose(
                        found[key], value, atol=1e-5, err_msg=f"{name} {key}"
                    )
            assert message.thin_walled == given.get("thin_walled", False)
            assert message.unlit == given.get("unlit", False)
            if "alpha_mode" in given:
                mode = f"ALPHA_MODE_{given['alpha_mode'].upper()}"
                assert message.AlphaMode.Name(message.alpha_mode) == mode
        lamp = back.read([asset.materials["lamp"]], ["material"])[0][0].material
        assert lamp.two_sided_emission


def _square(edit, name, x, **parameters):
    mesh = edit.mesh(f"{name}/mesh", **hg.shapes.plane(1.0))
    edit.entity(name, mesh=mesh, material=edit.material(f"{name}/material", **parameters),
                transform=hg.Pose((x, 0, 0)))  # fmt: skip


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_textures_show_the_same_colours_wherever_they_lie(client, scene, tmp_path, wrap):
    rng = np.random.default_rng(1)
    turn = ((1.5 * math.cos(0.5), -0.8 * math.sin(0.5), 0.2),
            (1.5 * math.sin(0.5), 0.8 * math.cos(0.5), 0.3))  # fmt: skip
    with scene.edit() as edit:
        made = {"wrap": wrap, "filter": "nearest"}
        color = edit.texture("color", rng.integers(0, 255, (8, 8, 4)).astype("u1"), **made)
        deep = edit.texture("deep", rng.integers(0, 65535, (8, 4, 3)).astype("u2"), **made)
        raw = edit.texture("raw", rng.integers(0, 255, (4, 4, 3)).astype("u1"),
                           encoding="linear", **made)  # fmt: skip
        grey = edit.texture("grey", rng.integers(0, 255, (8, 8)).astype("u1"), **made)
        _square(edit, "a", -2, base_color=hg.Tex(color, factor=(0.9, 0.5, 0.2), uv=turn))
        _square(edit, "b", -1, base_color=hg.Tex(deep))
        _square(edit, "c", 0, base_color=hg.Tex(raw, scale=0.5, offset=0.25))
        _square(edit, "d", 1, base_color=hg.Tex(grey), metallic=1.0)
        _square(edit, "e", 2, base_color=hg.Tex(color), alpha=hg.Tex(raw, channel=1),
                alpha_mode="mask", alpha_cutoff=0.4)  # fmt: skip
        above = hg.look_at((0, 0, 3), (0, 0, 0), up=(0, 1, 0))
        edit.entity("above", camera=hg.Camera.orthographic(40, 200, 40), transform=above)
    glb, _ = written(scene, tmp_path)
    back, asset = again(client, tmp_path)
    with back:
        frames = [s.render(c, spp=1, planes=["base_color", "depth"], size=(200, 40))
                  for s, c in ((scene, "above"), (back, asset.cameras[0]))]  # fmt: skip
        off = np.abs(frames[0]["base_color"] - frames[1]["base_color"]).max(-1) > 0.004
        assert off.mean() < 0.02
        holes = [~np.isfinite(frame["depth"]) for frame in frames]
        assert (holes[0] != holes[1]).mean() < 0.01 and 0.05 < holes[0].mean() < 0.5
    names = {image["name"] for image in glb.json["images"]}
    assert {"color", "grey"} <= names  # as they are


def test_metal_and_roughness_lie_where_gltf_has_them(scene, tmp_path):
    """Roughness in green, metal in blue, whatever channels they come from."""
    rng = np.random.default_rng(2)
    texels = rng.integers(0, 255, (4, 4, 3)).astype("u1")
    with scene.edit() as edit:
        orm = edit.texture("orm", texels, encoding="linear")
        rough = {"roughness": hg.Tex(orm, channel=1), "metallic": hg.Tex(orm, channel=2)}
        _square(edit, "same", 0, **rough)
        _square(edit, "other", 1, roughness=hg.Tex(orm, channel=0, factor=0.5),
                metallic=hg.Tex(orm, channel=0, scale=-1, offset=1))  # fmt: skip
    glb, _ = written(scene, tmp_path)

    def pixels(name):
        metal = glb.material(f"{name}/material")["pbrMetallicRoughness"]
        assert (metal["metallicFactor"], metal["roughnessFactor"]) == (1, 1)
        texture = glb.json["textures"][metal["metallicRoughnessTexture"]["index"]]
        image = glb.json["images"][texture["source"]]
        return np.asarray(Image.open(io.BytesIO(glb.view(image["bufferView"]))))

    np.testing.assert_array_equal(pixels("same"), texels)
    made = pixels("other").astype(int)
    np.testing.assert_allclose(made[..., 1], texels[..., 0] * 0.5, atol=0.51)
    np.testing.assert_allclose(made[..., 2], 255 - texels[..., 0], atol=0.51)


def test_lights_are_in_candela_and_lux(scene, tmp_path):
    sun = hg.Light(irradiance=2.0, color=(1, 0.5, 0), sun_angle=0.0093)
    small = hg.Light(radiance=30, shape="sphere", radius=0.01)
    cone = {"outer_cone_angle": 0.5, "inner_cone_angle": 0.2}
    wide = hg.Light(candela=900, shape="disc", radius=0.3, **cone)
    flat = hg.Light(power=8, shape="rectangle", width=2, height=0.5)
    globe = hg.Light(lumen=1000, exposure=1, shape="sphere", radius=0.2)
    with scene.edit() as edit:
        for name, light in {"sun": sun, "small": small, "flat": flat, "globe": globe}.items():
            edit.entity(name, light=light)
        edit.entity("wide", light=wide, transform=np.diag([2, 2, 2, 1.0]))
        edit.entity("mesh", mesh=edit.mesh("m", **hg.shapes.plane(2)), light=hg.Light(power=50))
    glb, notes = written(scene, tmp_path)
    lights = {light["name"]: light for light in
              glb.json["extensions"]["KHR_lights_punctual"]["lights"]}  # fmt: skip
    assert lights["sun"]["intensity"] == pytest.approx(683 * 2)
    assert lights["sun"]["color"] == [1, 0.5, 0]
    assert lights["small"]["intensity"] == pytest.approx(683 * 30 * math.pi * 1e-4)
    assert lights["wide"]["intensity"] == pytest.approx(900)
    assert lights["wide"]["spot"] == pytest.approx(
        {"innerConeAngle": 0.2, "outerConeAngle": 0.5}, rel=1e-6
    )

    def radiance(name):
        extensions = glb.material(name)["extensions"]
        return extensions["KHR_materials_emissive_strength"]["emissiveStrength"]

    assert radiance("flat.light") == pytest.approx(8 / math.pi)  # of 1 m^2
    assert radiance("globe.light") == pytest.approx(2000 / 683 / (math.pi * 4 * math.pi * 0.04))
    assert radiance("default") == pytest.approx(50 / (4 * math.pi))
    assert notes == [f"{tmp_path / 'scene.glb'}: wide: a spot light is written as a point with a "
                     "cone"]  # fmt: skip


def test_what_gltf_cannot_say_is_named(scene, tmp_path):
    with scene.edit() as edit:
        edit.dome(color=1.0)
        lens = hg.Camera.from_fov(60, 64, 48, degrees=True, distortion=(0.1, 0, 0, 0))
        edit.entity("bent", camera=lens)
        edit.entity("round", camera=hg.Camera.fisheye(3, 64, 64))
        edit.entity("window", portal=hg.Portal(1, 1))
        edit.entity("smoke", volume=edit.volume("v", density=np.ones((4, 4, 4), "f4")))
        mesh = edit.mesh("m", **hg.shapes.plane())
        edit.entity("away", mesh=mesh, visible=False)
        edit.entity("ghost", mesh=mesh, visibility=hg.Visibility(shadow=False),
                    material=edit.material("wax", subsurface=0.5, priority=2))  # fmt: skip
    _, notes = written(scene, tmp_path)
    found = "\n".join(notes)
    for text in ("dome: glTF has none", "bent: the lens's distortion", "round: fisheye cameras",
                 "window: portals", "smoke: volumes", "away: is hidden by KHR_node_visibility",
                 "ghost: visibility by kind of ray", "wax: subsurface is",
                 "wax: priority"):  # fmt: skip
        assert text in found


def test_a_file_that_cannot_be_written_leaves_the_old_one(scene, tmp_path):
    with pytest.raises(hg.InvalidArgument, match=r"neither in \.glb nor in \.usdz"):
        scene.export(tmp_path / "scene.obj")
    with pytest.raises(hg.NotFound, match="there is no folder"):
        scene.export(tmp_path / "nowhere" / "scene.glb")
    path = tmp_path / "scene.glb"
    path.write_bytes(b"old")
    with pytest.raises(hg.OutOfRange):
        scene.export(path, revision=10**6)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_an_earlier_revision_and_an_empty_scene(scene, tmp_path):
    empty = scene.revision
    with scene.edit() as edit:
        edit.entity("late", mesh=edit.mesh("m", **hg.shapes.plane()))
    path = tmp_path / "scene.glb"
    scene.export(path, revision=empty)
    assert b'"late"' not in path.read_bytes()
    scene.export(path)
    assert b'"late"' in path.read_bytes()


def test_defaults_are_those_of_the_contract(client):
    """docs/materials.md lists them, too."""
    defaults = client.info().default_material
    look = look_of(World("", {}, defaults), "it", pb.Material())
    page = (REPOSITORY / "docs/materials.md").read_text()
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| `")]
    documented = {row[1].strip().strip("`"): row[3].strip() for row in rows if len(row) > 4}
    checked = 0
    for name, field in look.fields.items():
        if name in documented and documented[name].replace(".", "").isdigit():
            np.testing.assert_allclose(field.value, float(documented[name]), err_msg=name)
            checked += 1
    assert checked > 20
