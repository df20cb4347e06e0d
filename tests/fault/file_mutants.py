"""Seeds of every format that the daemon decodes, and mutants of them. Used by fuzz_assets.py.

A new format is a line of SAMPLES: its seeds beneath tests/assets, or bundles made here.
"""

from __future__ import annotations

import json
import pathlib
import random
import re
import struct
from dataclasses import dataclass

ASSETS = pathlib.Path(__file__).parents[1] / "assets"
HEAD = 512  # bytes, where the claims are: half of the edits hit them
LARGEST = 200_000  # bytes of a seed


@dataclass(frozen=True)
class Seed:
    """Files by their names, the model first; `hit` are those that mutants change."""

    files: dict[str, bytes]
    hit: tuple[str, ...]


MTL = """newmtl paint
Kd 0.8 0.1 0.1
Ks 0.5 0.5 0.5
Ke 0.1 0.2 0.3
Ns 250
Ni 1.45
d 0.75
Tr 0.25
Pr 0.4
Pm 0.1
map_Kd -s 1 1 1 -o 0.5 0 0 -clamp on checker.png
map_d -imfchan m checker.png
map_bump -bm 0.3 checker.png
norm checker.png
"""
QUAD = "mtllib quad.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
QUAD += "vt 0 1\nvn 0 0 1\nusemtl paint\ng half\nf 1/1/1 2/2/1 3/3/1 4/4/1\nf -4 -3 -2\n"
SOLID = "solid quad\n" + 2 * (
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1e0 -0.0\nendloop\n"
    "endfacet\n"
)
ASCII_PLY = """ply
format ascii 1.0
comment TextureFile checker.png
element vertex 4
property float x
property double y
property float z
property uchar red
property uchar green
property uchar blue
property float s
property float t
element face 1
property list uchar int vertex_indices
property list uchar float texcoord
end_header
0 0 0 255 0 0 0 0
1 0 0 0 255 0 1 0
1 1 0 0 0 255 1 1
0 1 0 9 9 9 0 1
4 0 1 2 3 8 0 0 1 0 1 1 0 1
"""
STRIPS_PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element tristrips 1
property list int int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
1 1 0
9 0 1 2 3 -1 0 2 3 1
"""
BIG_PLY = (
    b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uint8 uint32 vertex_index\nend_header\n"
    + struct.pack(">9fB3I", 0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2)
)


def made(name: str, data: str | bytes, *, others: dict[str, bytes] | None = None) -> Seed:
    """A bundle that is written here; `others` are not changed."""
    raw = data.encode() if isinstance(data, str) else data
    return Seed({name: raw, **(others or {})}, (name,))


def checker() -> dict[str, bytes]:
    return {"checker.png": (ASSETS / "dae/checker.png").read_bytes()}


def material() -> Seed:
    return Seed({"quad.obj": QUAD.encode(), "quad.mtl": MTL.encode(), **checker()}, ("quad.mtl",))


def glb(path: str) -> Seed:
    """A glTF and its buffer as one file, so that edits of its lengths are among the mutants."""
    text = (ASSETS / path).read_text()
    document = json.loads(text)
    buffer = (ASSETS / path).with_name(document["buffers"][0].pop("uri")).read_bytes()
    head = json.dumps(document).encode()
    head, buffer = head + b" " * (-len(head) % 4), buffer + bytes(-len(buffer) % 4)
    chunks = struct.pack("<I4s", len(head), b"JSON") + head
    chunks += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    seed = made("model.glb", struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks)
    pictures = {p.name: p.read_bytes() for p in (ASSETS / path).parent.glob("*.png")}
    return Seed({**seed.files, **pictures}, seed.hit)


PACKED = ("meshopt", "meshopt_sequence", "meshopt_filters")
SKINNED = "gltf/03_skinned_cylinder/03_skinned_cylinder.gltf"
SAMPLES: dict[str, list[str | Seed]] = {
    "glb": ["gltf/simple-instancing.glb", "gltf/Lights.glb", glb(SKINNED)],
    "gltf": [
        "gltf/01_morphed_cube/01_morphed_cube.gltf",
        "gltf/03_all_animations/03_all_animations.gltf",
        "gltf/09_texture_transform/09_texture_transform.gltf",
        SKINNED,
    ],
    "draco": ["gltf/heart_draco.glb"],
    "meshopt": [f"gltf/packed/{kind}.gltf" for kind in PACKED],
    "dae": ["dae/bracket.dae", "dae/banner.dae", "dae/bones.dae"],
    "fbx": ["fbx/arm.fbx"],
    "obj": [
        made("quad.obj", QUAD, others={"quad.mtl": MTL.encode(), **checker()}),
        "mesh/spot_control_mesh.obj",
    ],
    "mtl": [material()],
    "ply": [
        "mesh/cube_blender_uv.ply",
        "mesh/points_emptyface.ply",
        made("ascii.ply", ASCII_PLY, others=checker()),
        made("big.ply", BIG_PLY),
        made("strips.ply", STRIPS_PLY),
    ],
    "stl": ["mesh/link_6.stl", made("solid.stl", SOLID + "endsolid quad\n")],
    "vdb": ["volume/smoke.vdb", "volume/sphere.vdb"],
    "nvdb": ["volume/torus.nvdb"],
    "ies": ["profile/batwing.ies"],
    "exr": ["picture/stripes.exr", "picture/windowed.exr", "picture/gradient_rec2020.exr"],
    "jpg": ["picture/gradient.jpg", "picture/gradient_cmyk.jpg"],
    "png": ["picture/gradient16.png", "picture/orm.png"],
    "tif": [f"picture/gradient_{kind}.tif" for kind in ("tiled", "palette", "planar", "float")],
}
PICTURES = "bmp dds dpx gif hdr ico iff jp2 jxl ppm psd rla sgi tga webp"
SAMPLES |= {ending: [f"mesh/box.{ending}"] for ending in "off x amf 3ds 3mf".split()}
SAMPLES |= {ending: [f"picture/gradient.{ending}"] for ending in PICTURES.split()}


def seed_of(path: pathlib.Path) -> Seed:
    """A file with those beside it that may be its own. Of these, pictures are not changed."""
    others = [other for other in sorted(path.parent.iterdir()) if belongs(other, path)]
    files = {each.name: each.read_bytes() for each in (path, *others)}
    return Seed(files, tuple(e.name for e in (path, *others) if e == path or not is_picture(e)))


def is_picture(path: pathlib.Path) -> bool:
    return path.suffix.lower() in (".png", ".jpg")


def belongs(other: pathlib.Path, path: pathlib.Path) -> bool:
    is_model = path.suffix.lower() in (".gltf", ".dae", ".obj")
    buffer = other.suffix.lower() in (".bin", ".mtl") and other.stem == path.stem
    return is_model and (buffer or is_picture(other))


def seeds(folder: pathlib.Path | None) -> dict[str, list[Seed]]:
    """By format; files of a folder go with those of their ending."""
    out = {
        kind: [s if isinstance(s, Seed) else seed_of(ASSETS / s) for s in listed]
        for kind, listed in SAMPLES.items()
    }
    for path in sorted(folder.rglob("*")) if folder else ():
        kind = path.suffix[1:].lower()
        if kind in out and path.stat().st_size <= LARGEST:
            out[kind].append(seed_of(path))
    return out


# ---------------------------------------------------------------- edits


WORDS = [0, 1, -1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**31 - 1, -(2**31), 2**63 - 1]
FLOATS = [0.0, -0.0, 1e-45, 3.4e38, -3.4e38, float("inf"), float("-inf"), float("nan")]
NUMBERS = b"0 -0 -1 1 255 256 65536 2147483647 2147483648 -2147483649 4294967295 4294967296"
NUMBERS = [*NUMBERS.split(), b"9" * 20, b"9" * 400, b"1e-400", b"1e999", b"-1e38", b"nan", b"inf"]
NUMBERS = [*NUMBERS, b"1e", b"0x7f", b"1.5", b"\xef\xbc\x91", b""]
SIGNS = [b"[", b"]", b"{", b"}", b'"', b"<", b">", b"/", b"\\", b"\n", b"\0", b"\xff", b"&", b"#"]
NUMBER = re.compile(rb"[-+]?\d[\d.]*(?:[eE][-+]?\d+)?")


def extreme(dice: random.Random) -> bytes:
    """A number in one of the ways that binary files have them."""
    order = dice.choice("<>")
    if dice.random() < 0.3:
        return struct.pack(order + dice.choice("fd"), dice.choice(FLOATS))
    size = dice.choice([1, 2, 4, 8])
    value = dice.choice(WORDS) & (256**size - 1)
    return value.to_bytes(size, "little" if order == "<" else "big")


def flip(out: bytearray, at: int, dice: random.Random) -> None:
    out[at] ^= 1 << dice.randrange(8)


def poke(out: bytearray, at: int, dice: random.Random) -> None:
    out[at] = dice.randrange(256)


def word(out: bytearray, at: int, dice: random.Random) -> None:
    made = extreme(dice)
    out[at : at + len(made)] = made


def run(out: bytearray, at: int, dice: random.Random) -> None:
    """A stretch of one byte."""
    length = min(1 + dice.randrange(64), len(out) - at)
    out[at : at + length] = bytes([dice.choice([0, 1, 0x7F, 0x80, 0xFF, 32])]) * length


def cut(out: bytearray, at: int, dice: random.Random) -> None:
    del out[at : at + 1 + dice.randrange(32)]


def repeat(out: bytearray, at: int, dice: random.Random) -> None:
    part = out[at : at + 1 + dice.randrange(64)]
    out[at:at] = part * dice.choice([1, 1, 1, 2, 40])


def sign(out: bytearray, at: int, dice: random.Random) -> None:
    out[at : at + dice.randrange(2)] = dice.choice(SIGNS)


def number(out: bytearray, at: int, dice: random.Random) -> None:
    """The next number of a text becomes an extreme one; in a binary file a word does."""
    found = NUMBER.search(out, at, at + 200)
    if found is None:
        return word(out, at, dice)
    out[found.start() : found.end()] = dice.choice(NUMBERS)


def length(out: bytearray, at: int, dice: random.Random) -> None:
    """The next word that may be a length or an offset is a little or a lot off."""
    order = dice.choice("<>")
    for place in range(at, min(at + 64, len(out) - 4)):
        (value,) = struct.unpack_from(order + "I", out, place)
        if 0 < value <= 2 * len(out):
            other = dice.choice([value - 1, value + 1, 2 * value, value ^ 4, len(out), 2**31, 0])
            struct.pack_into(order + "I", out, place, other)
            return
    word(out, at, dice)


TIMES = [1, 1, 1, 2, 2, 3, 5, 8]
EDITS = [flip, poke, word, run, cut, repeat, sign, number, number, length]


def edited(data: bytes, dice: random.Random) -> bytearray:
    out = bytearray(data)
    for _ in range(dice.choice(TIMES)):
        if len(out) >= 16:
            end = len(out) - 8
            at = dice.randrange(min(end, HEAD) if dice.random() < 0.5 else end)
            dice.choice(EDITS)(out, at, dice)
    return out


def mutant(listed: list[Seed], trial: int, kind: str) -> dict[str, bytes]:
    """The files of a mutant: the same for the same seeds, number and format."""
    dice = random.Random(f"{kind} {trial}")
    seed = dice.choice(listed)
    name = seed.hit[0] if dice.random() < 0.7 else dice.choice(seed.hit)
    data = seed.files[name]
    if dice.random() < 0.06:  # a splice: the head of one, the tail of another
        other = dice.choice(listed)
        tail = other.files[dice.choice(other.hit)]
        data = data[: dice.randrange(len(data) + 1)] + tail[dice.randrange(len(tail) + 1) :]
    if dice.random() < 0.8:
        data = bytes(edited(data, dice))
    if dice.random() < 0.05:
        data = data[: dice.randrange(len(data) + 1)]
    return {**seed.files, name: data}
