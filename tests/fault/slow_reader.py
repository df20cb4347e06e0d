"""R8: readers that take nothing cost at most 2.5 frames each and at most 10 % of the others' rate;
after stall_seconds they are closed."""

import threading
import time

import common
import heliograph as hg
from heliograph._wire._proto import service_pb2 as service

SIDE = 512  # a beauty of 4 MiB
FRAME = SIDE * SIDE * 16
STALL = common.size(30, 4)
TRIM = 1.5  # seconds, until the heap's holes went back to the system


def stalled(scene, over):
    """A stream of 4 MiB frames that nobody reads. The connection may swallow the first one; the
    refined one waits for its credit."""
    from heliograph.render import call

    request = call.make_request(scene, ["cam"], {"spp": 2, "size": (SIDE, SIDE)})
    request.progressive = True
    link = scene.client.connection.link
    first = service.StreamRequest(settings=request, credits=1)
    return link.method("Stream", raw=True)(open_ended(first, over), metadata=link.metadata)


def open_ended(first, over):
    """The client's side stays open until it is over."""
    yield first
    over.wait()


def rate(scene, seconds):
    """Frames a second of a reader that reads, while the scene is edited."""
    count, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        scene.render("cam", spp=4, size=(256, 256), seed=count)
        count += 1
    return count / (time.perf_counter() - start)


def main():
    count, seconds = 20, common.size(8, 1)
    limits = {"stall_seconds": STALL}
    with common.Report("R8 slow readers") as report, common.daemon(**limits) as client:
        scene = common.stage(client)
        pid = common.pid_of(client)
        for _ in range(3):
            scene.render("cam", spp=2, size=(SIDE, SIDE))
        alone = rate(scene, seconds)
        before = common.resident(pid)
        with hg.connect(client.address) as slow:
            other = hg.Scene(slow, scene.id)
            over = threading.Event()
            streams = [stalled(other, over) for _ in range(count)]
            common.seconds_until(lambda: common.used(client, "tenant_streams") == count)
            common.seconds_until(lambda: common.used(client, "tenant_jobs") == 0)
            begin = time.perf_counter()
            beside = rate(scene, seconds)
            time.sleep(TRIM)
            each = (common.resident(pid) - before) / count / FRAME
            report.figure("memory of each stalled reader", each, 2.5, "frm", slack=False)
            report.figure("rate lost by others", 100 * (1 - beside / alone), 10, "%")
            common.seconds_until(lambda: common.used(client, "tenant_streams") == 0, STALL + 30)
            closed = time.perf_counter() - begin
            report.figure("closed after", closed, STALL + 5, "s")
            over.set()
            for stream in streams:
                stream.cancel()


if __name__ == "__main__":
    main()
