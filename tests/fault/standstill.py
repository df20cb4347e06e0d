"""An event loop that stands still: readiness and then liveness fail on connections that are open,
calls go on, and SIGTERM ends the daemon within the drain's time."""

import os
import pathlib
import signal
import time

import common
import health
import heliograph as hg
import served

FAULTY = pathlib.Path(served.DAEMON).with_name("heliographd-faulty")
LIMITS = ("--limit", "hang_seconds=1", "--limit", "stuck_seconds=3")


def main():
    with common.Report("a loop that stands still") as report, served.folder() as folder:
        freeze = folder / "freeze"
        os.environ["HELIOGRAPH_TEST_FREEZE"] = str(freeze)
        served.DAEMON = str(FAULTY)
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
        told = [text for text in ("it stands still", "it moves again") if text in daemon.log()]
        report.figure("lines that the log lacks", 2 - len(told), 0, slack=False)


if __name__ == "__main__":
    main()
