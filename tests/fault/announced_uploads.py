"""Uploads and imports that announce much and send nothing: others' edits and uploads have room, a
window of bytes is all that is charged, and after stall_seconds they are ended and give it back; so
are exports that nobody reads."""

import threading

import common
import grpc
import heliograph as hg
import numpy as np
import served
from heliograph._wire._proto import service_pb2 as service

STALL = common.size(10, 2)
COUNT = 8
WINDOW = 1 << 20
STORE = 64 << 20
SILENT = 40 << 20  # each alone fits, two do not


def silent(first, over):
    """A stream with one message, whose end never comes."""
    yield first
    over.wait()


def end_of(call):
    """The status code with which a call ended, and its message."""
    try:
        for _ in call:
            pass
    except grpc.RpcError as error:
        return error.code().name, error.details()
    return "OK", ""


def announce(client, over):
    """Uploads that send nothing."""
    link, calls = client.connection.link, []
    for i in range(COUNT):
        first = service.UploadBlobRequest(request_id=f"upload {i}", size=SILENT)
        call = link.channel.stream_stream(
            "/heliograph.v1.Renderer/UploadBlob",
            request_serializer=service.UploadBlobRequest.SerializeToString,
        )
        calls.append(call(silent(first, over), metadata=link.metadata))
    return calls


def stalled_import(client, over):
    link = client.connection.link
    call = link.channel.stream_stream("/heliograph.v1.Renderer/ImportScene")

    def nothing():
        over.wait()
        yield from ()

    return call(nothing(), metadata=link.metadata)


def unread_export(client, scene):
    """Many megabytes, of which nobody takes one."""
    link = client.connection.link
    call = link.channel.unary_stream(
        "/heliograph.v1.Renderer/ExportScene",
        request_serializer=service.ExportSceneRequest.SerializeToString,
    )
    return call(service.ExportSceneRequest(scene=scene.id), metadata=link.metadata)


def check_uploads(report, daemon):
    """Room for another tenant meanwhile, and the end of the silent ones."""
    robots = hg.connect(daemon.socket, token=served.TOKENS["robots"])
    vision = hg.connect(daemon.socket, token=served.TOKENS["vision"])
    over = threading.Event()
    with robots, vision:
        before = common.used(robots, "tenant_bytes")
        calls = announce(robots, over)
        all_of_them = before + COUNT * WINDOW
        common.seconds_until(lambda: common.used(robots, "tenant_bytes") >= all_of_them)
        held = common.used(robots, "tenant_bytes") - before
        report.figure("charged for each silent upload", held / COUNT / WINDOW, 1.01, slack=False)
        scene = vision.create_scene()
        with scene.edit() as edit:
            image = np.zeros((1024, 1024, 4), np.uint8)
            edit.texture("another tenant's", image)
        refused = {end_of(call)[0] for call in calls} - {"RESOURCE_EXHAUSTED"}
        report.figure("silent uploads not ended so", len(refused), 0, slack=False)
        took = common.seconds_until(lambda: common.used(robots, "tenant_bytes") == before)
        report.figure("their bytes are back after", took, 2, "s")
        code, message = end_of(stalled_import(robots, over))
        wrong = code != "RESOURCE_EXHAUSTED" or "stall_seconds" not in message
        report.figure("silent imports not ended so", int(wrong), 0, slack=False)
        over.set()


def check_export(report, daemon):
    """An export that nobody reads is cancelled."""
    with hg.connect(daemon.socket, token=served.TOKENS["robots"]) as client:
        scene = client.create_scene()
        noise = np.random.default_rng(1).integers(0, 255, (2048, 2048, 4), np.uint8)
        with scene.edit() as edit:
            edit.texture("noise", noise)
        call = unread_export(client, scene)
        labels = 'code="CANCELLED",method="ExportScene"'
        took = common.seconds_until(
            lambda: daemon.scrape("heliograph_calls_total").get(labels, 0) > 0, STALL + 20
        )
        call.cancel()
        report.figure("an unread export ends after", took, STALL + 3, "s")


def main():
    limits = {
        "stall_seconds": STALL,
        "blob_store_bytes": STORE,
        "tenant_bytes": STORE,
        "upload_window_bytes": WINDOW,
    }
    flags = [flag for name, value in limits.items() for flag in ("--limit", f"{name}={value}")]
    with common.Report("uploads that send nothing") as report, served.folder() as folder:
        flags += ["--tenants", str(served.tenants_file(folder))]
        with served.served(*flags, "--metrics", "127.0.0.1:0") as daemon:
            check_uploads(report, daemon)
            check_export(report, daemon)


if __name__ == "__main__":
    main()
