"""Files that are truncated, mutated, of another kind than their name says, or far larger than they
look; and paths that leave their folder: refused by the file's name, and the next file loads."""

import json
import random
import struct
import zlib
from pathlib import Path

import heliograph as hg
import pytest
from refusals import check, edited

ASSETS = Path(__file__).resolve().parents[1] / "assets"
SAMPLES = {
    "glb": ASSETS / "gltf/Fox.glb",
    "gltf": ASSETS / "gltf/01_morphed_cube/01_morphed_cube.gltf",
    "obj": ASSETS / "mesh/link_6.obj",
    "ply": ASSETS / "mesh/cube_blender_uv.ply",
    "stl": ASSETS / "mesh/link_6.stl",
    "vdb": ASSETS / "volume/sphere.vdb",
    "nvdb": ASSETS / "volume/torus.nvdb",
    "exr": ASSETS / "picture/stripes.exr",
    "hdr": ASSETS / "picture/gradient.hdr",
    "png": ASSETS / "picture/cube_depth.png",
    "jpg": ASSETS / "picture/gradient.jpg",
    "tif": ASSETS / "picture/gradient_tiled.tif",
    "ies": ASSETS / "profile/batwing.ies",
}
PICTURES = {"exr", "hdr", "png", "jpg", "tif", "ies"}
MODELS = set(SAMPLES) - PICTURES
REFUSALS = (hg.InvalidArgument, hg.NotFound, hg.Unimplemented, hg.ResourceExhausted)


def load(path):
    """A row's call: the file in a transaction behind a good edit."""
    if path.suffix[1:] in PICTURES:
        return edited(lambda edit: edit.texture("thing", path))
    return edited(lambda edit: edit.import_file(path))


def written(folder, name, data):
    path = folder / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("kind", SAMPLES)
def test_whole_files_load(world, kind):
    load(SAMPLES[kind])(world)
    assert world.revision == 2


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.95])
@pytest.mark.parametrize("kind", SAMPLES)
def test_a_truncated_file_is_refused(world, tmp_path, kind, share):
    data = SAMPLES[kind].read_bytes()
    if kind == "obj":  # its lines are complete anywhere; a cut number is not
        data = data[: data.rindex(b"/")]
    path = written(tmp_path, f"cut.{kind}", data[: int(share * len(data))])
    if kind == "obj" and share > 0.02:
        pytest.skip("what is left of an OBJ file is an OBJ file")
    check(world, load(path), (hg.InvalidArgument, f"cut.{kind}"))


@pytest.mark.parametrize("content", SAMPLES)
@pytest.mark.parametrize("kind", SAMPLES)
def test_a_file_of_another_kind_is_refused(world, tmp_path, kind, content):
    if {kind, content} <= MODELS:
        return  # they are known by their content
    if {kind, content} <= PICTURES - {"ies"}:
        return  # so are pictures: test_picture_files.py
    if kind == content:
        return
    path = written(tmp_path, f"mistyped.{kind}", SAMPLES[content].read_bytes())
    check(world, load(path), (hg.InvalidArgument, f"mistyped.{kind}"))


@pytest.mark.parametrize("content", sorted(MODELS - {"gltf"}))  # which names its buffer
@pytest.mark.parametrize("kind", sorted(MODELS))
def test_a_model_is_known_by_its_content(scene, tmp_path, kind, content):
    path = written(tmp_path, f"mistyped.{kind}", SAMPLES[content].read_bytes())
    with scene.edit() as edit:
        warnings = " ".join(edit.import_file(path).warnings)
    is_named = kind == content or {kind, content} == {"glb", "gltf"}
    assert (f"the file is {content}" in warnings) == (not is_named)


@pytest.mark.parametrize("kind", SAMPLES)
def test_mutants_load_or_are_refused_by_name(world, tmp_path, kind):
    data = SAMPLES[kind].read_bytes()
    for seed in range(12):
        dice = random.Random(seed)
        mutant = bytearray(data)
        for _ in range(1 + seed):
            mutant[dice.randrange(min(len(mutant), 1000))] = dice.randrange(256)
        path = written(tmp_path, f"mutant.{kind}", bytes(mutant))
        before = world.revision
        try:
            with world.branch() as branch:
                load(path)(branch)
        except REFUSALS as error:
            assert f"mutant.{kind}" in str(error) or "the model refers to" in str(error), str(error)
        assert world.revision == before
    assert world.render("cam", planes=["instance"])["instance"].max() > 0


def png(width, height, rows=b""):
    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


def exr(width, height):
    def attribute(name, kind, data):
        return name + b"\0" + kind + b"\0" + struct.pack("<I", len(data)) + data

    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"R\0" + struct.pack("<IB3x2I", 2, 0, 1, 1) + b"\0"
    return b"".join(
        [
            struct.pack("<2I", 20000630, 2),
            attribute(b"channels", b"chlist", channel),
            attribute(b"compression", b"compression", b"\0"),
            attribute(b"dataWindow", b"box2i", box),
            attribute(b"displayWindow", b"box2i", box),
            attribute(b"lineOrder", b"lineOrder", b"\0"),
            attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
            attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
            attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)),
            b"\0" + bytes(64),
        ]
    )


def tiff(width, height):
    tags = [
        (256, 4, width),
        (257, 4, height),
        (258, 3, 8),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 4, height),
        (279, 4, 1),
    ]
    entries = b"".join(struct.pack("<2H2I", tag, kind, 1, value) for tag, kind, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4)


def jpeg(width, height):
    data = bytearray(SAMPLES["jpg"].read_bytes())
    frame = data.index(b"\xff\xc0")
    data[frame + 5 : frame + 9] = struct.pack(">2H", height, width)
    return bytes(data)


def gltf(**parts):
    model = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}],
    }
    return json.dumps({**model, **parts}).encode()


BILLIONS = [{"componentType": 5126, "count": 4_000_000_000, "type": "VEC3"}]
CYCLE = [{"children": [1]}, {"children": [0]}]
PLY = (
    "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
)
PLY += "property float z\nelement face {}\nproperty list uchar int vertex_index\nend_header\n"
# A file's name -> its bytes and the error. Each is small, and claims to be large.
BOMBS = {
    "wide.png": (png(60_000, 60_000), hg.ResourceExhausted),
    "zip.png": (
        png(16_000, 16_000, zlib.compress(bytes(16_000 * 48_001 // 8), 9)),
        hg.ResourceExhausted,
    ),
    "wide.exr": (exr(100_000, 100_000), hg.ResourceExhausted),
    "wide.hdr": (
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n",
        hg.ResourceExhausted,
    ),
    "many.ies": (
        b"IESNA91\nTILT=NONE\n1 -1 1 65000 65000 1 2 0 0 0\n1 1 0\n0 90",
        hg.InvalidArgument,
    ),
    "wide.tif": (tiff(1_000_000, 1_000_000), hg.ResourceExhausted),
    "wide.jpg": (jpeg(65_000, 65_000), hg.ResourceExhausted),
    "zeros.gltf": (gltf(accessors=BILLIONS), hg.ResourceExhausted),
    "deep.gltf": (b'{"asset":' + b"[" * 1_000_000, hg.InvalidArgument),
    "cycle.gltf": (gltf(nodes=CYCLE), hg.InvalidArgument),
    "vertices.ply": (PLY.format(4_000_000_000, 1).encode(), hg.ResourceExhausted),
    "faces.ply": (PLY.format(0, 4_000_000_000).encode(), hg.ResourceExhausted),
    "facets.stl": (bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(50), hg.InvalidArgument),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_before_it_goes_off(world, tmp_path, name):
    data, error = BOMBS[name]
    assert len(data) < 2_000_000
    check(world, load(written(tmp_path, name, data)), (error, name))


PATHS = ["../secret.bin", "/etc/passwd", "%2e%2e/secret.bin", "file:///etc/passwd"]


@pytest.mark.parametrize("uri", PATHS)
def test_a_model_reads_beneath_its_folder_only(world, tmp_path, uri):
    (tmp_path / "in").mkdir()
    written(tmp_path, "secret.bin", bytes(36))
    model = gltf(buffers=[{"uri": uri, "byteLength": 36}])
    path = written(tmp_path / "in", "out.gltf", model)
    check(world, load(path), (hg.InvalidArgument, "path"), "out.gltf")


def test_a_link_out_of_the_folder_is_not_followed(world, tmp_path):
    (tmp_path / "in").mkdir()
    secret = written(tmp_path, "secret.bin", bytes(36))
    (tmp_path / "in/link.bin").symlink_to(secret)
    model = gltf(buffers=[{"uri": "link.bin", "byteLength": 36}])
    path = written(tmp_path / "in", "out.gltf", model)
    check(world, load(path), (hg.NotFound, "link.bin"), "there is no file")


def test_what_is_not_there_is_named(world, tmp_path):
    check(world, load(tmp_path / "none.glb"), (hg.NotFound, "none.glb"))
    model = gltf(buffers=[{"uri": "gone.bin", "byteLength": 36}])
    check(world, load(written(tmp_path, "m.gltf", model)), (hg.NotFound, "gone.bin"))
    blend = written(tmp_path, "model.blend", b"BLENDER-v300")
    check(world, load(blend), (hg.Unimplemented, "model.blend"), "gltf, glb, obj")


def test_a_volume_and_a_mesh_do_not_go_together(world):
    with world.edit() as edit:
        asset = edit.import_file(SAMPLES["nvdb"])
    volume = next(o for o in world.find("*") if isinstance(o, hg.Handle) and o.kind == "volume")
    assert asset.root
    both = edited(lambda edit: edit.entity("thing", mesh="tri", volume=volume))
    check(world, both, (hg.InvalidArgument, "volume"), "mesh")


def test_paths_of_the_daemon_are_refused_outside_its_root(world):
    check(
        world,
        edited(lambda edit: edit.import_file(server_path="/etc/passwd")),
        (hg.PermissionDenied, "server_path"),
        "--asset-root",
    )


def test_limits_of_decoding_are_settings(tmp_path):
    limits = {"decode_texels": 100, "decode_triangles": 5, "decode_json_bytes": 1000}
    flags = [f"--limit={name}={value}" for name, value in limits.items()]
    with hg.connect(arguments=flags) as client, client.create_scene() as scene:
        for kind in ("png", "ply", "gltf"):
            with pytest.raises(hg.ResourceExhausted, match="decode_ limit") as refused:
                load(SAMPLES[kind])(scene)
            assert refused.value.needed > refused.value.available > 0
        assert scene.revision == 0 and client.info().limits["decode_texels"] == 100


def test_models_count_among_the_stored_bytes():
    arguments = ["--limit=blob_store_bytes=500000"]
    with hg.connect(arguments=arguments) as client, client.create_scene() as scene:
        with pytest.raises(hg.ResourceExhausted, match="blob_store_bytes") as refused:
            load(SAMPLES["glb"])(scene)
        assert refused.value.needed > refused.value.available
        load(SAMPLES["ply"])(scene)
