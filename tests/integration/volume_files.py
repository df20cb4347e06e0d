"""Small .nvdb and .vdb files, written here from their layouts: what the decoder must read.

Both hold one brick of 8^3 samples at the origin of index space.
"""

import struct
import zlib

import numpy as np

# ---------------------------------------------------------------- NanoVDB 32

FLOAT, FP4, FP8, FP16, FPN = 1, 13, 14, 15, 16
_QUANTUM = 0.125  # of the coded types: values are multiples of it


def _padded(data: bytes, to: int = 32) -> bytes:
    return data + b"\0" * (-len(data) % to)


def _codes(brick, bits):
    codes = np.round(brick.reshape(-1) / _QUANTUM).astype(np.uint32)
    assert codes.max() < 1 << bits
    if bits == 16:
        return codes.astype("<u2").tobytes()
    out = np.zeros(512 * bits // 8, np.uint8)
    for i, code in enumerate(codes):
        out[i * bits // 8] |= code << (i * bits % 8)
    return out.tobytes()


def _nano_leaf(brick, kind, bits):
    flags = bits.bit_length() - 1 << 5 if kind == FPN else 0
    head = struct.pack("<3i3BB", 0, 0, 0, 7, 7, 7, flags) + b"\xff" * 64
    if kind == FLOAT:
        return _padded(head + bytes(16)) + brick.astype("<f4").tobytes()
    head += struct.pack("<2f4H", 0, _QUANTUM, 0, 0, 0, 0)
    return _padded(head) + _codes(brick, bits)


def _nano_internal(side, child_bytes):
    """A node whose first child follows it."""
    count = side**3
    mask = b"\1" + bytes(count // 8 - 1)
    head = _padded(bytes(32) + bytes(count // 8) + mask + bytes(16))
    table = np.zeros(count, "<i8")
    table[0] = len(head) + 8 * count
    return head + table.tobytes() + child_bytes


def nvdb(brick, scale, translation, kind=FLOAT, packed=False, name="density"):
    """The bytes. brick: (8, 8, 8) float32; index space to metres: scale, then translation."""
    bits = {FP4: 4, FP8: 8, FP16: 16, FPN: 8}.get(kind, 0)
    nodes = _nano_internal(32, _nano_internal(16, _nano_leaf(brick, kind, bits)))
    root = _padded(struct.pack("<6iI5f", *[0] * 6, 1, *[0.0] * 5))
    tile = _padded(struct.pack("<QqIf", 0, len(root) + 32, 0, 0.0))
    tree = struct.pack("<4Q3I3IQ", 0, 0, 0, 64, 1, 1, 1, 0, 0, 0, 512) + root + tile + nodes
    matrix = np.eye(3) * scale
    inverse = np.linalg.inv(matrix)
    grid_map = matrix.astype("<f4").tobytes() + inverse.astype("<f4").tobytes() + bytes(16)
    grid_map += matrix.astype("<f8").tobytes() + inverse.astype("<f8").tobytes()
    grid_map += np.asarray(translation, "<f8").tobytes() + bytes(8)
    head = struct.pack("<QQIIIIQ", 0x304244566F6E614E, 0, 32 << 21, 0, 0, 1, 672 + len(tree))
    grid = head + name.encode().ljust(256, b"\0") + grid_map + bytes(48 + 24)
    grid += struct.pack("<2IqI", 2, kind, 0, 0) + bytes(20) + tree
    stored = grid
    if packed:
        data = zlib.compress(grid)
        stored = struct.pack("<Q", len(data)) + data
    meta = struct.pack("<4Q2I", len(grid), len(stored), 0, 512, kind, 2) + bytes(48 + 24 + 24)
    meta += struct.pack("<I4I3IHHI", len(name) + 1, 1, 1, 1, 1, 0, 0, 0, int(packed), 0, 32 << 21)
    file = struct.pack("<QIHH", 0x304244566F6E614E, 32 << 21, 1, int(packed))
    return file + meta + name.encode() + b"\0" + stored


# ---------------------------------------------------------------- OpenVDB

ZIP, ACTIVE_MASK = 1, 2
OLD, NEW = 220, 224  # since 222 each grid has its compression, and nodes say what they leave out


def _text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def _values(values, active, compression, half, version=NEW):
    """A node's values: inactive ones are all background (0), which ACTIVE_MASK leaves out."""
    kept = values[active] if compression & ACTIVE_MASK else values
    data = kept.astype("<f2" if half else "<f4").tobytes()
    out = b"\0" if compression & ACTIVE_MASK else b"\6"
    if version == OLD:
        out = b""
    if compression & ZIP and not (half and not data):
        packed = zlib.compress(data)
        if len(packed) < len(data):
            return out + struct.pack("<q", len(packed)) + packed
        out += struct.pack("<q", -len(data))
    return out + data


def _bits(mask):
    return np.packbits(mask, bitorder="little").tobytes()


def vdb(
    brick,
    scale,
    translation,
    compression=0,
    half=False,
    kind="fog volume",
    background=0.0,
    version=NEW,
):
    """The file's bytes, as for nvdb()."""
    flat = brick.reshape(-1)
    active = flat != 0
    topology = b""
    for side in (32, 16):
        nothing = np.zeros(side**3, bool)
        first = nothing.copy()
        first[0] = True
        stored = nothing[1:] if version == OLD else nothing  # not those of children
        tiles = np.full(stored.size, background, "f4")
        topology += _bits(first) + _bits(nothing)
        topology += _values(tiles, stored, compression, half, version)
    topology += _bits(active)
    blocks = _bits(active) + (bytes(3 * 4) + b"\1" if version == OLD else b"")
    blocks += _values(flat, active, compression, half, version)
    transform = _text("UniformScaleTranslateMap") + struct.pack("<3d", *translation)
    transform += struct.pack("<3d", *[scale] * 3) + bytes(12 * 8)
    grid = struct.pack("<I", compression) if version == NEW else b""
    grid += struct.pack("<I", 2) + _text("class") + _text("string") + _text(kind)
    grid += _text("is_saved_as_half_float") + _text("bool") + struct.pack("<I?", 1, half)
    grid += transform + struct.pack("<IfII3i", 1, background, 0, 1, 0, 0, 0) + topology
    suffix = "_HalfFloat" if half else ""
    entry = _text("density") + _text("Tree_float_5_4_3" + suffix) + _text("")
    head = struct.pack("<qIII?", 0x56444220, version, 10, 0, True)
    if version == OLD:
        head += struct.pack("<?", bool(compression & ZIP))
    head += b"00000000-0000-0000-0000-000000000000"
    head += struct.pack("<II", 0, 1) + entry
    begin = len(head) + 24
    blocks_at = begin + len(grid)
    return head + struct.pack("<3q", begin, blocks_at, blocks_at + len(blocks)) + grid + blocks
