"""S5: mutants of files of every format, through DecodeAsset: each loads or is refused with its name
and a reason, soon; the daemon lives, and the next request is answered as before."""

import collections
import hashlib
import pathlib
import random
import time

import common
import heliograph as hg
import numpy as np
from heliograph._wire._proto import service_pb2 as service

ASSETS = pathlib.Path(__file__).parents[1] / "assets"
SAMPLES = {
    "glb": "gltf/simple-instancing.glb",
    "gltf": "gltf/01_morphed_cube/01_morphed_cube.gltf",
    "dae": "dae/bracket.dae",
    "obj": "mesh/spot_control_mesh.obj",
    "ply": "mesh/cube_blender_uv.ply",
    "stl": "mesh/link_6.stl",
    "vdb": "volume/smoke.vdb",
    "nvdb": "volume/torus.nvdb",
    "exr": "picture/stripes.exr",
    "hdr": "picture/gradient.hdr",
    "png": "picture/gradient16.png",
    "jpg": "picture/gradient.jpg",
    "tif": "picture/gradient_tiled.tif",
    "ies": "profile/batwing.ies",
}
PICTURES = "bmp dds dpx gif ico iff jp2 jxl ppm psd rla sgi tga webp"
SAMPLES |= {ending: f"picture/gradient.{ending}" for ending in PICTURES.split()}
REFUSALS = (hg.InvalidArgument, hg.NotFound, hg.Unimplemented, hg.ResourceExhausted)
SECONDS = 5.0
TOKENS = [b"0", b"-1", b"1e999", b"nan", b"4294967295", b"99999999999", b"[", b"{", b'"', b"\0"]

WORDS = [b"\xff" * 4, bytes(4), b"\x7f\xff\xff\xff", b"\0\0\0\x80"]


def mutate(data, dice):
    """One to eight edits: bytes, numbers, stretches, the end."""
    out = bytearray(data)
    for _ in range(1 + dice.randrange(8)):
        if len(out) < 16:
            break
        # half of the edits hit the head, where the claims are
        at = dice.randrange(min(len(out) - 8, 512) if dice.random() < 0.5 else len(out) - 8)
        kind = dice.randrange(7)
        if kind == 0:
            out[at] = dice.randrange(256)
        elif kind == 1:
            out[at] ^= 1 << dice.randrange(8)
        elif kind == 2:
            out[at : at + 4] = dice.choice(WORDS)
        elif kind == 3:
            out[at : at + 1] = dice.choice(TOKENS)
        elif kind == 4:
            del out[at : at + 1 + dice.randrange(16)]
        elif kind == 5:
            out[at:at] = out[at : at + 1 + dice.randrange(64)]
        elif dice.random() < 0.3:
            del out[at:]
    return bytes(out)


class Files:
    """Decodes files of one client."""

    def __init__(self, client):
        self.connection = client.connection

    def upload(self, data):
        digest = hashlib.sha256(data).digest()
        request = service.UploadBlobRequest(sha256=digest, size=len(data), chunk=data)
        self.connection.push("UploadBlob", iter([request]))
        return digest

    def decode(self, files):
        bundle = [service.BundleFile(path=n, sha256=self.upload(data)) for n, data in files.items()]
        request = service.DecodeAssetRequest(files=bundle)
        for reply in self.connection.stream("DecodeAsset", request, timeout=4 * SECONDS):
            last = reply
        return last


def bundle(kind):
    """Name -> bytes of a sample; the model is first, its companions come along."""
    path = ASSETS / SAMPLES[kind]
    files = {path.name: path.read_bytes()}
    for companion in (path.with_suffix(".bin"), path.parent / "checker.png"):
        if companion.exists():
            files[companion.name] = companion.read_bytes()
    return files


def fuzz(client, kind, count, report):
    """What became of the mutants of one format."""
    sample, dice = bundle(kind), random.Random(kind)
    name, data = next(iter(sample.items()))
    seen, slow, unnamed = collections.Counter(), 0.0, []
    own = None
    for trial in range(count):
        if trial % 500 == 0:  # blobs live as long as their session
            if own is not None:
                own.close()
            own = hg.connect(client.address)
            files = Files(own)
        start = time.perf_counter()
        try:
            files.decode({**sample, name: mutate(data, dice)})
            seen["loaded"] += 1
        except REFUSALS as error:
            seen["died" if "its decoder" in str(error) else "refused"] += 1
            if name not in str(error) and "the model refers to" not in str(error):
                unnamed.append(str(error))
        slow = max(slow, time.perf_counter() - start)
    own.close()
    shown = ", ".join(f"{n} {what}" for what, n in sorted(seen.items()))
    report.figure(f"{kind}: slowest of {shown}", slow, SECONDS, "s", slack=False)
    if unnamed:
        report.figure(f"{kind}: refused without its name, e.g. {unnamed[0]}", len(unnamed), 0)


def main():
    count = common.size(10_000, 40)
    with common.Report("S5 malformed assets") as report, common.daemon("--grace", "0") as client:
        with hg.connect(client.address) as own:
            scene = common.stage(own, 32, 24)
            before = scene.render("cam", planes=["beauty"], spp=2)["beauty"]
            size = common.resident(common.pid_of(client))
            for kind in SAMPLES:
                fuzz(client, kind, count, report)
            after = scene.render("cam", planes=["beauty"], spp=2)["beauty"]
            report.figure("the next request differs", not np.array_equal(before, after), 0)
            with scene.edit() as edit:
                edit.import_file(ASSETS / SAMPLES["glb"])
        report.figure("crashes", client.connection.daemon.exit_code() is not None, 0, slack=False)
        grown = (common.resident(common.pid_of(client)) - size) / 1e6
        report.figure("growth of the daemon's memory", grown, 100, "MB", slack=False)


if __name__ == "__main__":
    main()
