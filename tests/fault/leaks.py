"""S14: no token, key, ticket or byte of an asset in the log at its most talkative, no path of the
host in an error, and no core dump of a daemon that holds keys.
"""

import os
import pathlib
import resource
import signal

import common
import heliograph as hg
import numpy as np
import served

MARK = "marked-bytes-of-an-asset"
NAME = "a-name"  # names are in the log: refusals have them


def session(daemon, tls, token, folder):
    """Does what a client does, right and wrong; the errors that it gets."""
    errors = []

    def wrong(call):
        try:
            call()
        except (hg.HeliographError, OSError) as error:
            errors.append(f"{error!r} {error} {getattr(error, 'field', '')}")

    with hg.connect(daemon.tcp, token=token, tls=tls) as client:
        scene = common.stage(client, 32, 32)
        scene.render("cam", spp=1)
        for name, data in files().items():
            path = folder / name
            path.write_bytes(data)
            with scene.edit() as edit:
                wrong(lambda path=path, edit=edit: edit.import_file(path))
        marked = np.frombuffer((MARK * 4000).encode(), "u1")[: 128 * 128 * 4]
        with scene.edit() as edit:
            edit.texture("marked", marked.reshape(128, 128, 4))
        wrong(lambda: client.open_scene(NAME))
        wrong(lambda: scene.render("nothing"))
        wrong(lambda: client.connection.call("Apply", broken(scene)))
        path = str(folder / "model.obj")
        for server_path in (path, "/etc/passwd", "../x"):
            wrong(lambda given=server_path: decode(client, given))
        info = str(client.info())
    wrong(lambda: hg.connect(daemon.tcp, token=token + "x", tls=tls))
    return errors, info


def files():
    """Whole, broken and strange models, all with the mark."""
    text = MARK.encode()
    obj = b"# " + text + b"\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    return {
        "model.obj": obj,
        "broken.obj": obj.replace(b"f 1 2 3", b"f 1 2 300 " + text),
        "broken.gltf": b'{"asset": {"version": "2.0"}, "buffers": "' + text + b'"',
        "broken.glb": b"glTF" + text * 3,
        "broken.png": b"\x89PNG\r\n\x1a\n" + text * 3,
        "broken.exr": b"\x76\x2f\x31\x01" + text * 3,
        "broken.ply": b"ply\nformat ascii 1.0\n" + text,
    }


def broken(scene):
    from heliograph._wire._proto import service_pb2 as service

    request = service.ApplyRequest(scene=scene.id, number=1 << 30)
    request.transaction.edits.add().target.name = NAME
    return request


def decode(client, path):
    from heliograph._wire._proto import service_pb2 as service

    list(client.connection.stream("DecodeAsset", service.DecodeAssetRequest(server_path=path)))


def dumps_core(daemon):
    """True if a crash leaves the daemon's memory behind; by a signal that no sanitizer reports."""
    os.kill(daemon.process.pid, signal.SIGABRT)
    status = os.waitpid(daemon.process.pid, 0)[1]
    daemon.process.returncode = -signal.SIGABRT
    return os.WCOREDUMP(status)


def main():
    with (
        common.Report("S14 secrets") as report,
        served.folder() as place,
        served.folder() as own,
    ):
        hard = resource.getrlimit(resource.RLIMIT_CORE)[1]
        resource.setrlimit(resource.RLIMIT_CORE, (hard, hard))
        os.chdir(place)  # where a core would go
        authority = served.Authority(place)
        cert, key = authority.sign("server")
        token = served.TOKENS["robots"]
        flags = ("--tenants", served.tenants_file(place), "--listen", "127.0.0.1:0")
        flags += ("--tls-cert", cert, "--tls-key", key, "--log-level", "debug", "--log-json")
        (place / "root").mkdir()
        with served.served(*flags, "--asset-root", place / "root") as daemon:
            tls = served.tls_of(authority.pem)
            errors, info = session(daemon, tls, token, own)
            report.figure("core dumps", dumps_core(daemon), 0)
            log = daemon.log()
        secrets = {
            "tokens": [token, token + "x"],
            "keys": pathlib.Path(key).read_text().splitlines()[1:-1],
            "bytes of assets": [MARK],
        }
        report.figure("lines of the log: none", not log, 0)
        for what, words in secrets.items():
            found = [line for line in log.splitlines() if any(word in line for word in words)]
            report.figure(f"{what} in the log", len(found), 0)
            for line in found:
                print("   ", line[:200])
        report.figure("errors: too few to judge", len(errors) < 8, 0)
        hosts = (
            str(place),
            str(served.ROOT),
            str(pathlib.Path(served.DAEMON).parent),
            "/proc/",
        )
        found = [text for text in (*errors, info) if any(path in text for path in hosts)]
        report.figure(f"paths of the host in {len(errors)} errors", len(found), 0)
        for text in found:
            print("   ", text[:300])


if __name__ == "__main__":
    main()
