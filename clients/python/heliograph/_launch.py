"""Starts a private heliographd and watches over it. Called by connect() before anything heavy is
imported, so that the daemon starts while Python imports."""

from __future__ import annotations

import atexit
import collections
import json
import logging
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .errors import Unavailable

_LEVELS = {
    "trace": logging.DEBUG,
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warning": logging.WARNING,
    "warn": logging.WARNING,
    "error": logging.ERROR,
    "critical": logging.CRITICAL,
}
_LOG_LINES = 20


def find_program() -> str:
    """Path of heliographd: $HELIOGRAPHD, beside the package, the source tree's build, the package
    heliograph-server, PATH."""
    named = os.environ.get("HELIOGRAPHD")
    if named:
        if os.access(named, os.X_OK):
            return named
        raise Unavailable(f"HELIOGRAPHD={named} is not a program; unset it or correct it")
    for candidate in _near_package():
        if os.access(candidate, os.X_OK):
            return str(candidate)
    on_path = shutil.which("heliographd")
    if on_path:
        return on_path
    raise Unavailable(
        "no heliographd found: pip install heliograph-server, build it (cmake --preset cpu && "
        "cmake --build --preset cpu), put it on PATH, or set HELIOGRAPHD to its path"
    )


def _near_package() -> list[Path]:
    """Where heliographd may be: beside the package, in the source tree's build, in the packages
    that scripts/wheel makes, that for GPUs first."""
    import importlib.util

    package = Path(__file__).resolve().parent
    folders = [package / "_bin", package.parents[2] / "build" / "cpu" / "bin"]
    for name in ("heliograph_server_cuda", "heliograph_server"):
        server = importlib.util.find_spec(name)
        if server is not None and server.origin is not None:
            folders.append(Path(server.origin).parent / "bin")
    return [folder / "heliographd" for folder in folders]


def find_beside(name: str) -> Path | None:
    """A file that is installed with heliographd: in the first of its places that has it."""
    programs = os.environ.get("HELIOGRAPHD"), *_near_package(), shutil.which("heliographd")
    files = (Path(program).resolve().with_name(name) for program in programs if program)
    return next((file for file in files if file.is_file()), None)


class PrivateDaemon:
    """A daemon that lives as long as this process.

    Owns: the process, its socket directory, the thread that reads its log. The daemon watches the
    owner by pidfd and ends with it, whatever the owner's children do.
    """

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        if not hasattr(os, "pidfd_open"):
            raise Unavailable(
                "a private daemon needs Linux 5.3 and Python 3.9: start heliographd on a Linux "
                "machine and pass its address to connect()"
            )
        self._owner = os.getpid()
        self._program = find_program()
        self._lines: collections.deque[str] = collections.deque(maxlen=_LOG_LINES)
        runtime = os.environ.get("XDG_RUNTIME_DIR", "")
        parent = runtime if os.access(runtime, os.W_OK) else None
        self._folder = tempfile.mkdtemp(prefix="heliograph-", dir=parent)
        self._socket = ""
        self._start(arguments)
        atexit.register(self.stop)

    def _start(self, arguments: Sequence[str]) -> None:
        owner = os.pidfd_open(self._owner)
        self._ready, ready_end = os.pipe()
        command = [self._program, "--private", "--socket-dir", self._folder]
        command += ["--owner-pidfd", str(owner), "--ready-fd", str(ready_end), *arguments]
        if "--denoiser" not in arguments:
            command += _denoiser()
        try:
            self._process: subprocess.Popen[bytes] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=(owner, ready_end),
                start_new_session=True,  # Ctrl-C is for the client, which cancels its job
            )
        except OSError as error:
            os.close(self._ready)
            shutil.rmtree(self._folder, ignore_errors=True)
            raise Unavailable(f"cannot start {self._program}: {error}") from error
        finally:
            os.close(owner)
            os.close(ready_end)
        self._reader = threading.Thread(target=self._read_log, name="heliograph-log", daemon=True)
        self._reader.start()

    def _read_log(self) -> None:
        log = logging.getLogger("heliograph")
        assert self._process.stdout
        for raw in self._process.stdout:
            line = raw.decode(errors="replace").rstrip()
            if line:
                self._lines.append(line)
                log.log(level_of(line), "%s", line)

    def address(self, timeout: float) -> str:
        """Waits until the daemon listens; "unix:///path"."""
        if self._socket:
            return self._socket
        text = self._read_ready(timeout)
        os.close(self._ready)
        try:
            self._socket = "unix://" + str(json.loads(text)["socket"])
        except (ValueError, KeyError):
            raise self.death(f"heliographd gave no socket (it said {text!r})") from None
        return self._socket

    def _read_ready(self, timeout: float) -> str:
        import select

        deadline = time.monotonic() + timeout
        text = b""
        while not text.endswith(b"\n"):
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([self._ready], [], [], left)[0]:
                self.stop()
                raise self.death(f"heliographd did not listen within {timeout:g} s")
            piece = os.read(self._ready, 4096)
            if not piece:
                break
            text += piece
        return text.decode(errors="replace")

    def exit_code(self) -> int | None:
        """None while it runs (and in a forked child, which is not its parent)."""
        return self._process.poll() if os.getpid() == self._owner else None

    def death(self, message: str) -> Unavailable:
        """The error that tells how it ended."""
        code: int | None = None
        if os.getpid() == self._owner:
            try:
                code = self._process.wait(2)
                self._reader.join(1)
            except subprocess.TimeoutExpired:
                code = None
        lines = list(self._lines)
        how = "" if code is None else f" ({describe_exit(code)})"
        tail = "\n  ".join(["", *lines]) if lines else " and logged nothing"
        return Unavailable(f"{message}{how}; its last lines:{tail}", exit_code=code, log=lines)

    def cpu_seconds(self) -> float:
        """What it has used so far, with its children that have ended."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> None:
        """Ends the daemon: SIGTERM, after 5 s SIGKILL. Nothing in a forked child."""
        if os.getpid() != self._owner:
            return
        atexit.unregister(self.stop)
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._reader.join(1)
        shutil.rmtree(self._folder, ignore_errors=True)

    def __getstate__(self) -> Any:
        raise TypeError("a private daemon belongs to its process; pickle the client instead")


def _denoiser() -> list[str]:
    """The flag that names Open Image Denoise where the package pyoidn has brought it."""
    import importlib.util

    package = importlib.util.find_spec("pyoidn")
    if package is None or package.origin is None:
        return []
    library = Path(package.origin).parent / "oidn/lib/libOpenImageDenoise.so.2"
    return ["--denoiser", str(library)] if library.exists() else []


def level_of(line: str) -> int:
    """Level of a log line by the first level's name in brackets; INFO without one."""
    for word in line.lower().replace("[", " ").replace("]", " ").split()[:6]:
        for name in (word, word.partition("level=")[2]):
            if name in _LEVELS:
                return _LEVELS[name]
    return logging.INFO


def describe_exit(code: int) -> str:
    """ "exit code 1" or "killed by SIGSEGV"."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
