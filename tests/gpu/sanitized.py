"""The test scenes under NVIDIA's compute-sanitizer: no access outside of what is allocated, no read
of what nobody wrote, no race.

usage: .venv/bin/python tests/gpu/sanitized.py [TOOL...]   (memcheck, initcheck, racecheck; needs a
GPU, and compute-sanitizer in the path or in /usr/local/cuda/bin)
"""

import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import heliograph as hg
import parity

TOOLS = ("memcheck", "initcheck", "racecheck")
PATIENCE = 120  # seconds until the daemon listens


def sanitizer():
    path = shutil.which("compute-sanitizer", path=os.environ["PATH"] + ":/usr/local/cuda/bin")
    return path or sys.exit("compute-sanitizer is not here")


def render_all(address):
    size = (48, 40)
    scenes = parity.SCENES | {"rays": lambda edit: parity.rays(edit, size)}
    with hg.connect(address) as client:
        for name, build in scenes.items():
            planes = parity.MEANS + parity.centres_of(name) + ["samples"]
            parity.render(client, build, planes, 3, size)


def check(tool):
    """True if the tool found nothing."""
    with tempfile.TemporaryDirectory() as folder:
        socket, log = pathlib.Path(folder) / "daemon.sock", pathlib.Path(folder) / "log"
        command = [sanitizer(), "--tool", tool, "--log-file", log, "--error-exitcode", "9"]
        # A program is looked for in one module after the other: not being there is no error.
        command += ["--report-api-errors", "no"]
        own = [os.environ.get("HELIOGRAPHD", "heliographd"), "--backend", "cuda"]
        own += ["--socket", socket, "--log-level", "error"]
        own += [f"--limit={name}=3600" for name in ("hang_seconds", "probe_seconds")]
        command += own
        daemon = subprocess.Popen(command)
        until = time.monotonic() + PATIENCE
        while not socket.exists() and daemon.poll() is None and time.monotonic() < until:
            time.sleep(0.1)
        try:
            render_all(f"unix:{socket}")
        finally:
            begins = " ".join(map(str, own[:5]))  # the sanitizer's own line begins otherwise
            subprocess.run(["pkill", "-TERM", "-f", f"^{begins}"], check=False)
            try:
                daemon.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                daemon.send_signal(signal.SIGKILL)
        text = log.read_text()
        summary = [line for line in text.splitlines() if "SUMMARY" in line]
        clean = bool(summary) and all(" 0 " in line for line in summary)
        print(f"{tool:10s} {'ok' if clean else 'FAILED'}: {'; '.join(summary) or 'no summary'}")
        if not clean:
            print("\n".join(text.splitlines()[:60]))
        return clean


if __name__ == "__main__":
    results = [check(tool) for tool in sys.argv[1:] or TOOLS]
    sys.exit(not all(results))
