"""S6: small files that claim to be large are refused before memory is taken for them, or their
decoder ends at its limits; the daemon grows by 50 MB at most."""

import json
import pathlib
import struct
import tempfile
import threading
import time
import zlib

import common
import heliograph as hg

ASSETS = pathlib.Path(__file__).parents[1] / "assets"
PLY = "ply\nformat {} 1.0\nelement vertex {}\n"
PLY += "property float x\nproperty float y\nproperty float z\n"
PLY += "element face {}\nproperty list uchar int vertex_index\nend_header\n"


def png(width, height, rows=b""):
    def chunk(kind, data):
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    header = struct.pack(">2I5B", width, height, 8, 6, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def zipped_png(side):
    """Rows of zeros, a thousand times smaller than they are."""
    packer = zlib.compressobj(9)
    row = bytes(1 + 4 * side)
    rows = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    return png(8 * side, 8 * side, rows)


def exr(width, height):
    def attribute(name, kind, data):
        return name + b"\0" + kind + b"\0" + struct.pack("<I", len(data)) + data

    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"R\0" + struct.pack("<IB3x2I", 2, 0, 1, 1) + b"\0"
    return b"".join(
        [
            struct.pack("<2I", 20000630, 2),
            attribute(b"channels", b"chlist", channel),
            attribute(b"compression", b"compression", b"\3"),
            attribute(b"dataWindow", b"box2i", box),
            attribute(b"displayWindow", b"box2i", box),
            attribute(b"lineOrder", b"lineOrder", b"\0"),
            attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
            attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
            attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)),
            b"\0" + bytes(4096),
        ]
    )


def gltf(count, **more):
    accessor = {"componentType": 5126, "count": count, "type": "VEC3", **more}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [accessor],
        }
    ).encode()


def nested_gltf(levels, width):
    """Nodes that each have all of the next level as children: width ** levels of them."""
    nodes = [{"children": [i * width + 1 + k for k in range(width)]} for i in range(levels * width)]
    nodes += [{"mesh": 0}] * width * 2
    model = json.loads(gltf(3))
    model["nodes"] = nodes
    return json.dumps(model).encode()


def vdb(sample, words):
    """A volume whose sizes were made huge, word by word."""
    data = bytearray((ASSETS / "volume" / sample).read_bytes())
    for at in words:
        data[at : at + 8] = struct.pack("<Q", 1 << 40)
    return bytes(data)


def bombs():
    """Name -> bytes, 1 MB at most."""
    made = {
        "wide.exr": exr(2**27, 2**27),
        "tall.exr": exr(1, 2**31 - 2),
        "wide.png": png(2**31 - 1, 2**31 - 1),
        "zip.png": zipped_png(common.size(16_000, 4_000)),
        "zeros.gltf": gltf(8_000_000_000),
        "sparse.gltf": gltf(
            8_000_000_000,
            sparse={
                "count": 1,
                "indices": {"bufferView": 0, "componentType": 5125},
                "values": {"bufferView": 0},
            },
        ),
        "tree.gltf": nested_gltf(300, 20),
        "vertices.ply": PLY.format("binary_little_endian", 2**40, 1).encode(),
        "faces.ply": PLY.format("ascii", 3, 2**40).encode() + b"0 0 0\n" * 3,
        "facets.stl": bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50),
        "index.obj": b"v 0 0 0\nf 1 999999999 4000000000\n",
        "deep.gltf": b'{"asset":' + b"[" * 900_000,
    }
    length = (ASSETS / "volume/smoke.vdb").stat().st_size
    for at in range(64, min(length, 12_000), common.size(64, 2000)):
        made[f"claim{at}.vdb"] = vdb("smoke.vdb", [at])
    for at in range(0, 2000, common.size(32, 500)):
        made[f"claim{at}.nvdb"] = vdb("torus.nvdb", [at])
    return made


class Peak(threading.Thread):
    """The largest resident size of a process while it runs."""

    def __init__(self, pid):
        super().__init__(daemon=True)
        self.pid, self.bytes, self.over = pid, 0, threading.Event()
        self.start()

    def run(self):
        while not self.over.wait(0.002):
            self.bytes = max(self.bytes, common.resident(self.pid))

    def end(self):
        self.over.set()
        self.join()
        return self.bytes


def take(scene, path):
    """ "refused", or "loaded"; anything else is an error."""
    try:
        with scene.overlay() as overlay:
            if path.suffix in (".exr", ".png"):
                overlay.texture("thing", path)
            else:
                overlay.import_file(path)
    except (
        hg.InvalidArgument,
        hg.ResourceExhausted,
        hg.NotFound,
        hg.Unimplemented,
    ) as error:
        assert path.name in str(error) or "the model refers to" in str(error), error
        return "refused"
    return "loaded"


def main():
    with common.Report("S6 bombs") as report, common.daemon() as client:
        scene, pid = common.stage(client, 32, 24), common.pid_of(client)
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            for path, data in bombs().items():
                assert len(data) <= 1 << 20 or "zip" in path, path
                (folder / path).write_bytes(data)
            take(scene, ASSETS / "mesh/cube_blender_uv.ply")
            before, peak, slow = common.resident(pid), Peak(pid), 0.0
            for path in sorted(folder.iterdir()):
                start = time.perf_counter()
                what = take(scene, path)
                slow = max(slow, time.perf_counter() - start)
                if "claim" not in path.name:
                    report.figure(f"{path.name}: not refused", what != "refused", 0)
            grown = (peak.end() - before) / 1e6
            report.figure(f"peak growth over {len(bombs())} bombs", grown, 50, "MB", slack=False)
            report.figure("slowest", slow, 5, "s", slack=False)
        report.figure("crashes", client.connection.daemon.exit_code() is not None, 0, slack=False)
        assert scene.render("cam", planes=["instance"])["instance"].max() > 0


if __name__ == "__main__":
    main()
