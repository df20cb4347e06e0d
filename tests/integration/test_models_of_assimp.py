"""FBX, 3DS, 3MF, X, OFF and AMF: what they become, beside arithmetic and beside the same model as
glTF."""

import pathlib
import struct
import zipfile

import heliograph as hg
import numpy as np
import pytest

ARM = pathlib.Path(__file__).parents[1] / "assets/fbx"
CUBE = np.array([[x, y, z] for z in (0, 3) for y in (0, 2) for x in (0, 1)], float)  # 1 x 2 x 3
QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]]
TRIANGLES = [[q[0], *pair] for q in QUADS for pair in (q[1:3], q[2:4])]
SIDE = 64


def imported(scene, path, **options):
    with scene.edit() as edit:
        return edit.import_file(path, **options)


def size_of(asset):
    return asset.bounds[1] - asset.bounds[0]


def seen(scene, planes, **view):
    """From a place that shows the arm and the box whole."""
    with scene.edit() as edit:
        lens = hg.Camera.from_fov(28, SIDE, SIDE, degrees=True)
        edit.entity("view", camera=lens, transform=hg.look_at((4, -5, 3), (0.5, 0.2, 0.8)))
    return scene.render("view", planes=planes, **view)


def material_of(asset, scene, name):
    return scene.read([asset.materials[name]], ["material"])[0][0].material


def vertices(numbers, between=" ", end="\n"):
    return "".join(between.join(f"{v:g}" for v in row) + end for row in numbers)


# ---------------------------------------------------------------- FBX


@pytest.fixture(scope="module")
def arms(client):
    """Blender's FBX and glTF of one scene, each in a scene of its own."""
    with client.create_scene() as a, client.create_scene() as b:
        out = []
        for scene, name in ((a, "arm.fbx"), (b, "arm.glb")):
            with scene.edit() as edit:
                out.append((edit.import_file(ARM / name, name="arm", animation=0), scene))
        yield out


def test_an_fbx_has_the_shape_of_the_same_gltf(arms):
    (fbx, _), (glb, _) = arms
    np.testing.assert_allclose(fbx.bounds, glb.bounds, atol=1e-4)
    assert set(fbx.materials) == {"skin", "tip", "metal"} == set(glb.materials)
    assert len(fbx.textures) == len(glb.textures) == 1
    assert len(fbx.cameras) == len(glb.cameras) == 1
    assert len(fbx.animations) == 1


@pytest.mark.parametrize("time", [0.0, 0.5, 1.0])
def test_an_fbx_moves_as_the_same_gltf(arms, time):
    """Skin, morph target and clip."""
    pictures = []
    for _, scene in arms:
        with scene.edit() as edit:
            edit.time(time)
        pictures.append(seen(scene, ["depth", "normal", "base_color", "instance"]))
    a, b = pictures
    inside = np.isfinite(a["depth"]) & np.isfinite(b["depth"])
    assert (np.isfinite(a["depth"]) != np.isfinite(b["depth"])).sum() <= 4
    off = np.abs(a["depth"][inside] / b["depth"][inside] - 1) > 1e-3
    assert off.sum() <= 4 and inside.sum() > 300
    colours = np.abs(a["base_color"][..., :3] - b["base_color"][..., :3]).max(-1)[inside]
    assert np.quantile(colours, 0.97) < 0.02


def test_an_fbx_has_metals_and_roughness_of_blender(arms):
    for name, metallic, roughness in (("metal", 1.0, 0.2), ("tip", 0.0, 0.3)):
        for each in arms:
            found = material_of(*each, name)
            assert found.metallic.value == pytest.approx(metallic)
            assert found.roughness.value == pytest.approx(roughness, abs=0.05)


def test_the_camera_of_an_fbx_is_that_of_the_gltf(arms):
    depths = [
        scene.render(asset.cameras[0], planes=["depth"], size=(64, 36))["depth"]
        for asset, scene in arms
    ]
    np.testing.assert_allclose(*depths, rtol=2e-3)


def test_options_go_before_what_an_fbx_says(scene):
    metres = size_of(imported(scene, ARM / "arm.fbx", name="a"))
    tall = size_of(imported(scene, ARM / "arm.fbx", name="b", units=1.0))
    assert tall[2] == pytest.approx(100 * metres[2], rel=1e-3)
    lying = size_of(imported(scene, ARM / "arm.fbx", name="c", up="z"))
    assert lying[1] == pytest.approx(metres[2], rel=1e-3)


# ---------------------------------------------------------------- the others


def off():
    faces = "".join("4 " + " ".join(map(str, quad)) + "\n" for quad in QUADS)
    return f"OFF\n8 6 12\n{vertices(CUBE)}{faces}".encode()


def directx():
    corners = vertices(CUBE[:, [0, 2, 1]], ";", ";,\n").rstrip(",\n") + ";"
    faces = ",\n".join(f"4;{','.join(map(str, quad[::-1]))};" for quad in QUADS) + ";"
    paint = "1;6;0,0,0,0,0,0;Material red {1;0;0;1;;10;0;0;0;;0;0;0;;}"
    mesh = f"8;\n{corners}\n6;\n{faces}\nMeshMaterialList {{{paint}}}"
    return f"xof 0303txt 0032\nMesh cube {{\n{mesh}\n}}\n".encode()


def amf(unit="meter"):
    corners = "".join(
        f"<vertex><coordinates><x>{x}</x><y>{y}</y><z>{z}</z></coordinates></vertex>"
        for x, y, z in CUBE
    )
    faces = "".join(
        f"<triangle><v1>{a}</v1><v2>{b}</v2><v3>{c}</v3></triangle>" for a, b, c in TRIANGLES
    )
    return f"""<?xml version="1.0" encoding="utf-8"?><amf unit="{unit}" version="1.1">
        <object id="1"><mesh><vertices>{corners}</vertices><volume>{faces}</volume></mesh></object>
        </amf>""".encode()


def threemf(path, unit="meter", transform="1 0 0 0 1 0 0 0 1 0 0 0"):
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CUBE)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in TRIANGLES)
    model = f"""<?xml version="1.0" encoding="UTF-8"?><model unit="{unit}" xml:lang="en-US"
        xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>
        <basematerials id="5"><base name="red" displaycolor="#FF0000"/></basematerials>
        <object id="1" type="model" pid="5" pindex="0"><mesh><vertices>{corners}</vertices>
        <triangles>{faces}</triangles></mesh></object></resources>
        <build><item objectid="1" transform="{transform}"/></build></model>"""
    rels = """<?xml version="1.0" encoding="UTF-8"?><Relationships
        xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="rel0"
        Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
        Target="/3D/3dmodel.model"/></Relationships>"""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("_rels/.rels", rels)
        archive.writestr("3D/3dmodel.model", model)
    return path


def chunk(kind, *parts):
    body = b"".join(parts)
    return struct.pack("<HI", kind, 6 + len(body)) + body


def threeds():
    red = chunk(0xAFFF, chunk(0xA000, b"red\0"), chunk(0xA020, chunk(0x0011, bytes([255, 0, 0]))))
    corners = struct.pack("<H", 8) + CUBE.astype("<f4").tobytes()
    faces = b"".join(struct.pack("<4H", *t, 7) for t in TRIANGLES)
    painted = chunk(0x4130, b"red\0", struct.pack("<13H", 12, *range(12)))
    mesh = chunk(
        0x4100, chunk(0x4110, corners), chunk(0x4120, struct.pack("<H", 12), faces, painted)
    )
    return chunk(0x4D4D, chunk(0x3D3D, red, chunk(0x4000, b"cube\0", mesh)))


MADE = {"off": off, "x": directx, "amf": amf, "3ds": threeds}


@pytest.fixture(params=["off", "x", "amf", "3ds", "3mf"])
def box(request, tmp_path):
    path = tmp_path / f"box.{request.param}"
    if request.param == "3mf":
        return threemf(path)
    path.write_bytes(MADE[request.param]())
    return path


def test_a_box_is_a_box_in_every_format(scene, box):
    asset = imported(scene, box)
    np.testing.assert_allclose(size_of(asset), (1, 2, 3), atol=1e-5)
    (mesh,) = asset.meshes.values()
    positions, indices = scene.read([mesh], ["mesh.positions", "mesh.indices"])[0]
    corners = np.asarray(positions, float)[np.asarray(indices)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(indices) == 12 and np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(22)
    outward = corners.mean(1) - np.asarray(positions, float).mean(0)
    assert ((normals * outward).sum(1) > 0).all()


def test_boxes_with_a_material_are_red(scene, box):
    asset = imported(scene, box)
    if box.suffix in (".off", ".amf"):
        assert set(asset.materials) <= {"vertex_colors"}
        return
    (name,) = asset.materials
    red = material_of(asset, scene, name).base_color.value
    assert (red.x, red.y, red.z) == (1, 0, 0)


@pytest.mark.parametrize(
    ("unit", "metres"), [("micron", 1e-6), ("millimeter", 1e-3), ("inch", 0.0254), ("meter", 1.0)]
)
def test_printing_formats_say_their_unit(scene, tmp_path, unit, metres):
    (tmp_path / "box.amf").write_bytes(amf(unit))
    for path in (tmp_path / "box.amf", threemf(tmp_path / "box.3mf", unit)):
        np.testing.assert_allclose(
            size_of(imported(scene, path, name=path.suffix[1:])),
            metres * np.array([1, 2, 3]),
            rtol=1e-5,
        )


def test_a_3mf_places_its_items(scene, tmp_path):
    path = threemf(tmp_path / "box.3mf", transform="0 1 0 -1 0 0 0 0 1 10 20 30")
    asset = imported(scene, path)
    np.testing.assert_allclose(asset.bounds, [[8, 20, 30], [10, 21, 33]], atol=1e-5)


@pytest.mark.parametrize("transform", ["1 0 0", "x", "1 0 0 0 1 0 0 0 1 0 0 0 5 6"])
def test_a_broken_3mf_is_refused_or_read(scene, tmp_path, transform):
    path = threemf(tmp_path / "box.3mf", transform=transform)
    try:
        imported(scene, path)
    except hg.InvalidArgument as refusal:
        assert "box.3mf" in str(refusal)


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n4294967295 4294967295 0\n0 0 0\n",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
        "OFF\n",
    ],
)
def test_an_off_that_lies_is_refused_or_read(scene, tmp_path, text):
    (tmp_path / "bad.off").write_text(text)
    try:
        imported(scene, tmp_path / "bad.off")
    except (hg.InvalidArgument, hg.ResourceExhausted) as refusal:
        assert "bad.off" in str(refusal)


def test_a_model_is_known_by_what_is_in_it(scene, tmp_path):
    path = tmp_path / "box.obj"
    path.write_bytes((ARM / "arm.fbx").read_bytes())
    assert any("the file is fbx" in warning for warning in imported(scene, path).warnings)


def test_textures_beside_a_model_are_found(scene, tmp_path):
    text = (
        directx().decode().replace(";0;0;0;;}", ';0;0;0;;TextureFilename {"C:\\\\a\\\\wood.png";}}')
    )
    (tmp_path / "box.x").write_text(text)
    assert any("wood.png" in w for w in imported(scene, tmp_path / "box.x", name="a").warnings)
    (tmp_path / "wood.png").write_bytes((ARM.parent / "dae/checker.png").read_bytes())
    assert len(imported(scene, tmp_path / "box.x", name="b").textures) == 1
