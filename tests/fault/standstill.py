"""An event loop that stands still: readiness and then liveness fail on connections that are open,
calls go on, and SIGTERM ends the daemon within the drain's time. An asset root whose disk stands
still holds up its readers alone."""

import concurrent.futures
import os
import pathlib
import signal
import time

import common
import health
import heliograph as hg
import served
from heliograph.scene import assets

READS = 24  # more than the daemon has threads in its pool
FAULTY = pathlib.Path(served.DAEMON).with_name("heliographd-faulty")
LIMITS = ("--limit", "hang_seconds=1", "--limit", "stuck_seconds=3")


def main():
    served.DAEMON = str(FAULTY)
    with common.Report("what stands still") as report:
        asset_root(report)
        loop(report)


def asset_root(report):
    with served.folder() as folder:
        for i in range(READS):
            (folder / f"{i}.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n# {i}\n")
        disk = folder / "disk"
        os.environ["HELIOGRAPH_TEST_DISK"] = str(disk)
        daemon = served.Served(folder, "--asset-root", folder)
        threads = concurrent.futures.ThreadPoolExecutor(READS + 1)
        with hg.connect(daemon.socket) as client:
            scene = common.stage(client)
            before = common.used(client, "tenant_bytes")
            disk.touch()
            sources = [assets.Source(None, f"{i}.obj") for i in range(READS)]
            reads = [threads.submit(assets.decode_bundle, client, each) for each in sources]
            common.seconds_until(lambda: common.used(client, "tenant_bytes") > before)
            time.sleep(0.5)  # the others, too
            start = time.perf_counter()
            threads.submit(common.furnish, scene, 64, 64).result(60)
            report.figure("edit beside slow files", time.perf_counter() - start, 2, "s")
            done = sum(read.done() for read in reads)
            report.figure("reads that did not wait for the disk", done, 0, slack=False)
            disk.unlink()
            came = sum(bool(read.result(60)) for read in reads)
            report.figure("decodes that did not come then", READS - came, 0, slack=False)
        daemon.stop()


def loop(report):
    with served.folder() as folder:
        freeze = folder / "freeze"
        os.environ["HELIOGRAPH_TEST_FREEZE"] = str(freeze)
        daemon = served.Served(folder, *LIMITS, "--drain", "2", "--log-level", "info")
        with hg.connect(daemon.socket) as client:
            scene = common.stage(client)
            asked = health.Health(daemon.socket)
            common.seconds_until(lambda: asked.check() and asked.check(""))
            freeze.touch()
            report.figure(
                "not ready after", common.seconds_until(lambda: not asked.check()), 2, "s"
            )
            scene.render("cam", spp=1)
            reason = client.info().not_ready
            report.figure("the reason is missing", int("loop" not in reason), 0, slack=False)
            report.figure(
                "not live after", common.seconds_until(lambda: not asked.check("")), 5, "s"
            )
            freeze.unlink()
            back = common.seconds_until(lambda: asked.check() and asked.check(""))
            report.figure("ready and live again after", back, 2, "s")
            freeze.touch()
            common.seconds_until(lambda: not asked.check())
            start = time.perf_counter()
            daemon.process.send_signal(signal.SIGTERM)
            code = daemon.process.wait(60)
            report.figure("SIGTERM ends it after", time.perf_counter() - start, 6, "s")
            report.figure("exit code, 70 as for a bug", abs(code - 70), 0, slack=False)
        lines = [text for text in ("it stands still", "it moves again") if text in daemon.log()]
        report.figure("lines that the log lacks", 2 - len(lines), 0, slack=False)


if __name__ == "__main__":
    main()
