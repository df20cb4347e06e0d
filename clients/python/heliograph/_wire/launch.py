"""Starts a private heliographd and watches over it. Called by connect() before anything heavy is
imported, so that the daemon starts while Python imports."""

from __future__ import annotations

import atexit
import collections
import contextlib
import json
import logging
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import Unavailable
from .start import Deadline

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
_PATIENCE = 5.0  # seconds that a daemon gets for its end
_PATH_BYTES = 107  # of a socket, at most
_LONGER_SOCKET = "heliograph.sock.fd.sock"  # of the two in a daemon's folder


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
    """Paths where heliographd may be: beside the package, in the source tree's build, in the
    packages that scripts/wheel makes, that for GPUs first."""
    import importlib.util

    package = Path(__file__).resolve().parents[1]
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


def private_folder() -> str:
    """A new folder that only this user may enter, where the paths of sockets are short enough."""
    refused = []
    for parent in dict.fromkeys(_parents()):
        try:
            folder = tempfile.mkdtemp(prefix="heliograph-", dir=parent)
        except OSError as error:
            refused.append(f"{parent}: {error.strerror}")
            continue
        why = _unfit(f"{folder}/{_LONGER_SOCKET}")
        if not why:
            return folder
        os.rmdir(folder)
        refused.append(f"{parent}: {why}")
    raise Unavailable(
        "no folder for the sockets of a private daemon; set TMPDIR to one with a short path where "
        f"this user may write ({'; '.join(refused)})"
    )


def _parents() -> Iterator[str]:
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        yield os.path.abspath(runtime)
    with contextlib.suppress(FileNotFoundError):  # there is none that can be written
        yield os.path.abspath(tempfile.gettempdir())
    yield from (f"/run/user/{os.getuid()}", "/tmp", "/var/tmp", "/dev/shm")


def _unfit(path: str) -> str:
    """Reason why a socket cannot have this path; "": it can."""
    data = os.fsencode(path)
    if len(data) > _PATH_BYTES:
        return f"a socket's path would have {len(data)} bytes, {_PATH_BYTES} is the most"
    try:
        data.decode()
    except UnicodeDecodeError:
        return "its path is no UTF-8"
    return ""


class PrivateDaemon:
    """A daemon that lives as long as this object, and no longer than this process.

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
        self._folder = private_folder()
        self._socket = ""
        self._start(arguments)
        self._end = weakref.finalize(self, _let_go, self._process, self._owner)
        self._end.atexit = False  # _stop_all waits for it
        _running.add(self)

    def _start(self, arguments: Sequence[str]) -> None:
        owner = os.pidfd_open(self._owner)
        self._ready, ready_end = os.pipe()
        self._log, log_end = os.pipe()
        command = [self._program, "--private", "--socket-dir", self._folder]
        command += ["--owner-pidfd", str(owner), "--ready-fd", str(ready_end), *arguments]
        if "--denoiser" not in arguments:
            command += _denoiser()
        try:
            self._process: subprocess.Popen[bytes] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log_end,
                stderr=log_end,
                pass_fds=(owner, ready_end),
                start_new_session=True,  # Ctrl-C is for the client, which cancels its job
            )
        except OSError as error:
            self._close_ready()
            os.close(self._log)
            shutil.rmtree(self._folder, ignore_errors=True)
            raise Unavailable(f"cannot start {self._program}: {error}") from error
        finally:
            for fd in (owner, ready_end, log_end):
                os.close(fd)
        self._reader = threading.Thread(
            target=_read_log,
            args=(self._log, self._process, self._lines, self._folder),
            name="heliograph-log",
            daemon=True,
        )
        self._reader.start()
        _readers.add(self._reader)

    def _close_ready(self) -> None:
        fd, self._ready = self._ready, -1
        if fd >= 0:
            os.close(fd)

    def address(self, deadline: Deadline) -> str:
        """Waits until the daemon listens; "unix:///path"."""
        if self._socket:
            return self._socket
        try:
            text = self._read_ready(deadline)
        except TimeoutError:
            raise self.death(
                f"heliographd did not listen within {deadline.seconds:g} s: raise timeout=, or "
                f"start {self._program} by hand to see what it waits for",
                patience=0,
            ) from None
        finally:
            self._close_ready()
        try:
            self._socket = "unix://" + str(json.loads(text)["socket"])
        except (ValueError, KeyError, TypeError):
            patience = min(2.0, deadline.left())
            message = f"{self._program} gave no socket (it said {text!r}); is it a heliographd?"
            raise self.death(message, patience) from None
        return self._socket

    def _read_ready(self, deadline: Deadline) -> str:
        """The line with the address it listens on, or as much of it as came before it ended."""
        import select

        text = b""
        while not text.endswith(b"\n"):
            if deadline.is_over or not select.select([self._ready], [], [], deadline.left())[0]:
                raise TimeoutError
            piece = os.read(self._ready, 4096)
            if not piece:
                break
            text += piece
        return text.decode(errors="replace")

    def exit_code(self) -> int | None:
        """None while it runs (and in a forked child, which is not its parent)."""
        return self._process.poll() if os.getpid() == self._owner else None

    def death(self, message: str, patience: float = 2.0) -> Unavailable:
        """The error that describes how it ended, if it does so within `patience` seconds."""
        code: int | None = None
        if os.getpid() == self._owner:
            try:
                code = self._process.wait(patience)
                self._reader.join(1)
            except subprocess.TimeoutExpired:
                code = None
        lines = list(self._lines)
        how = "" if code is None else f" ({describe_exit(code)})"
        tail = "\n  ".join(["", *lines]) if lines else " and logged nothing"
        return Unavailable(f"{message}{how}; its last lines:{tail}", exit_code=code, log=lines)

    def cpu_seconds(self) -> float:
        """CPU seconds of the daemon so far, with its children that have ended."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")

    def disown(self) -> None:
        """Marks the process as ended, in a forked child: it is the parent's, so no warning is
        due."""
        self._process.returncode = 0

    def give_up(self) -> None:
        """Kills a daemon that has no client yet, with its children."""
        self._put_away(0)

    def stop(self) -> None:
        """Ends the daemon: SIGTERM, after 5 s SIGKILL. Nothing in a forked child."""
        if os.getpid() == self._owner and self._process.poll() is None:
            self._process.terminate()
        self._put_away(_PATIENCE)

    def _put_away(self, patience: float) -> None:
        if os.getpid() != self._owner:
            return
        self._end.detach()
        _running.discard(self)
        self._close_ready()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)  # it leads a session of its own
            self._process.wait()
        self._reader.join(1)
        shutil.rmtree(self._folder, ignore_errors=True)

    def __getstate__(self) -> Any:
        raise TypeError("a private daemon belongs to its process; pickle the client instead")


def _read_log(
    fd: int, process: subprocess.Popen[bytes], lines: collections.deque[str], folder: str
) -> None:
    """Logs the daemon's lines until it closes its end, then removes its folder. Knows no
    PrivateDaemon, which may be collected meanwhile."""
    log = logging.getLogger("heliograph")
    with open(fd, "rb") as file:
        for raw in file:
            line = raw.decode(errors="replace").rstrip()
            if line:
                lines.append(line)
                log.log(level_of(line), "%s", line)
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


def _let_go(process: subprocess.Popen[bytes], owner: int) -> None:
    """Nobody refers to the daemon any more. Runs in any thread, at any time: the thread that reads
    the log waits for the end."""
    if os.getpid() == owner:
        process.terminate()


_running: weakref.WeakSet[PrivateDaemon] = weakref.WeakSet()
_readers: weakref.WeakSet[threading.Thread] = weakref.WeakSet()


def _stop_all() -> None:
    for daemon in list(_running):
        daemon.stop()
    for reader in list(_readers):
        reader.join(_PATIENCE)  # of a daemon that was let go


def _in_child() -> None:
    """Drops the parent's children and threads, in a forked child that has neither."""
    _readers.clear()
    for daemon in list(_running):
        daemon.disown()


atexit.register(_stop_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)


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
