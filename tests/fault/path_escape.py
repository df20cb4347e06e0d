"""S7: no path leads out of the asset root, neither a client's nor one inside a model; what is
outside is answered like what is not there.
"""

import json
import os

import common
import heliograph as hg
import served
from heliograph._wire._proto import service_pb2 as service

SECRET = b"the-secret-beside-the-root"


def make_root(place):
    """A root with a model in it, ways out of it, and a secret beside it."""
    root = place / "root"
    (root / "models").mkdir(parents=True)
    outside = place / "secret.obj"
    outside.write_bytes(b"# " + SECRET + b"\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (root / "good.obj").write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (root / "link.obj").symlink_to(outside)
    (root / "inner.obj").symlink_to("good.obj")
    (root / "up").symlink_to("..")
    (root / "proc").symlink_to("/proc/self/cwd")
    os.link(outside, root / "hard.obj")
    os.mkfifo(root / "pipe.obj")
    (root / "folder.obj").mkdir()
    if os.geteuid() == 0:
        os.mknod(root / "device.obj", 0o600 | 0o020000, os.makedev(1, 5))
    return root


def escapes(place):
    """Paths that name something that exists, all but the last."""
    secret = str(place / "secret.obj")
    return [
        "../secret.obj",
        "models/../../secret.obj",
        "./../secret.obj",
        "up/secret.obj",
        secret,
        f"file:{secret}",
        f"file://{secret}",
        "file:good.obj",
        "%2e%2e/secret.obj",
        "..%2fsecret.obj",
        "..\\secret.obj",
        "link.obj",
        "inner.obj",
        "hard.obj",
        "pipe.obj",
        "folder.obj",
        "device.obj",
        "good.obj\0.png",
        "good.obj/",
        "/proc/self/environ",
        "/proc/self/fd/0",
        "proc/secret.obj",
        "/dev/zero",
        ".",
        "/",
        "x" * 5000,
        "not-there.obj",
    ]


def decode(client, path):
    """The last reply, or the error."""
    request = service.DecodeAssetRequest(server_path=path)
    try:
        return list(client.connection.stream("DecodeAsset", request, timeout=20))[-1]
    except hg.HeliographError as error:
        return error


def gltf(uri):
    """A triangle whose positions are in another file."""
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "buffers": [{"uri": uri, "byteLength": 36}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                 "min": [0, 0, 0], "max": [1, 1, 1]}
            ],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "nodes": [{"mesh": 0}],
            "scenes": [{"nodes": [0]}],
        }
    )  # fmt: skip


def check_models(report, client, place, root):
    """Files that a model names."""
    (place / "outside.bin").write_bytes(bytes(36))
    (root / "models/beside.bin").write_bytes(bytes(36))
    (root / "models/linked.bin").symlink_to("../../outside.bin")
    uris = [
        "../../outside.bin",
        str(place / "outside.bin"),
        f"file://{place}/outside.bin",
        "%2e%2e/%2e%2e/outside.bin",
        "linked.bin",
        "/proc/self/environ",
        "/dev/zero",
    ]
    (root / "models/good.gltf").write_text(gltf("beside.bin"))
    good = decode(client, "models/good.gltf")
    report.figure("a file beside its model: not read", not getattr(good, "asset", None), 0)
    read = 0
    for i, uri in enumerate(uris):
        (root / f"models/{i}.gltf").write_text(gltf(uri))
        answer = decode(client, f"models/{i}.gltf")
        is_read = not isinstance(answer, Exception) and answer.HasField("asset")
        read += is_read
        if is_read:
            print("    read:", uri)
    report.figure(f"of {len(uris)} files that a model names, read", read, 0)


def main():
    with common.Report("S7 paths") as report, served.folder() as place:
        root = make_root(place)
        with common.daemon("--asset-root", str(root)) as client:
            good = decode(client, "good.obj")
            report.figure("a file beneath the root: not read", not getattr(good, "asset", None), 0)
            missing = decode(client, "not-there.obj")
            paths = escapes(place)
            answers = {path: decode(client, path) for path in paths}
            wrong = [p for p, a in answers.items() if not isinstance(a, hg.NotFound)]
            report.figure(f"of {len(paths)} paths, not NOT_FOUND", len(wrong), 0)
            differing = [
                p for p, a in answers.items() if str(a) != str(missing) or a.field != missing.field
            ]
            report.figure("told apart from a missing file", len(differing), 0)
            for path in {*wrong, *differing}:
                print("   ", repr(path[:60]), repr(answers[path])[:200])
            check_models(report, client, place, root)
        with common.daemon() as client:
            refused = [decode(client, path) for path in ("good.obj", "/etc/passwd", "not-there")]
            words = {(type(error).__name__, str(error)) for error in refused}
            report.figure("without a root: told apart", len(words) - 1, 0)


if __name__ == "__main__":
    main()
