"""A real daemon on a Unix socket in a temporary folder, and a client of raw gRPC stubs.

The stubs are generated here by protoc, so that these tests need no client package.
"""

import dataclasses
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd"))
STUBS = ROOT / "build/stubs"


def generate_stubs() -> None:
    protos = sorted((ROOT / "proto/heliograph").rglob("*.proto"))  # google.rpc is a package
    package = STUBS / "heliograph/v1"
    newest = max(p.stat().st_mtime for p in protos)
    made = package / "service_pb2_grpc.py"
    if made.exists() and made.stat().st_mtime >= newest:
        return
    package.mkdir(parents=True, exist_ok=True)
    for folder in (STUBS / "heliograph", package):
        (folder / "__init__.py").touch()
    plugin = subprocess.check_output(["which", "grpc_python_plugin"], text=True).strip()
    subprocess.check_call(
        [
            "protoc",
            f"-I{ROOT / 'proto'}",
            f"--python_out={STUBS}",
            f"--grpc_python_out={STUBS}",
            f"--plugin=protoc-gen-grpc_python={plugin}",
            *map(str, protos),
        ]
    )


generate_stubs()
sys.path.insert(0, str(STUBS))

import grpc  # noqa: E402
from google.rpc import error_details_pb2 as details  # noqa: E402
from google.rpc import status_pb2  # noqa: E402
from heliograph.v1 import errors_pb2, service_pb2_grpc  # noqa: E402
from heliograph.v1 import service_pb2 as service  # noqa: E402


class Daemon:
    """One heliographd process."""

    def __init__(self, *flags: str, folder: str, limits: dict | None = None, under=(), **popen):
        self.socket = os.path.join(folder, "heliograph.sock")
        read, write = os.pipe()
        named = [f"--limit={name}={value}" for name, value in (limits or {}).items()]
        self.process = subprocess.Popen(
            [*under, DAEMON, "--socket", self.socket, "--ready-fd", str(write), *named, *flags],
            pass_fds=(write, *popen.pop("pass_fds", ())),
            stderr=subprocess.PIPE,
            text=True,
            **popen,
        )
        os.close(write)
        with os.fdopen(read) as ready:
            line = ready.readline()
        self.ready = json.loads(line) if line else None

    @property
    def target(self) -> str:
        return f"unix:{self.socket}"

    def stop(self, signal_number: int = signal.SIGTERM, timeout: float = 10) -> int:
        if self.process.poll() is None:
            self.process.send_signal(signal_number)
        try:
            return self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise


class Client:
    """One session: its local channel, its gRPC channel, its stub."""

    def __init__(self, daemon: Daemon, ticket: bool = True, token: str = ""):
        self.channel = grpc.insecure_channel(
            daemon.target, options=[("grpc.use_local_subchannel_pool", 1)]
        )
        self.stub = service_pb2_grpc.RendererStub(self.channel)
        self.local_channel = None
        request = service.OpenSessionRequest(client="test")
        if ticket:
            self.local_channel = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self.local_channel.connect(daemon.socket + ".fd.sock")
            request.ticket = self.local_channel.recv(64)
        self.metadata = [("authorization", f"Bearer {token}")] if token else []
        self.opened = self.stub.OpenSession(
            request, metadata=self.metadata, wait_for_ready=True, timeout=10
        )
        self.metadata.append(("heliograph-session", str(self.opened.session)))
        self.numbers: dict[int, int] = {}

    def call(self, method: str, request=None, timeout: float | None = 10, **fields):
        rpc = getattr(self.stub, method)
        if request is None:
            request = getattr(service, method + "Request")(**fields)
        reply = rpc(request, metadata=self.metadata, timeout=timeout)
        return joined(reply) if method in ("Query", "Tracks") else reply

    def create(self, name: str = "", **fields) -> int:
        return self.call("CreateScene", name=name, **fields).scene

    def apply(self, scene: int, *edits, number: int | None = None, **fields):
        number = self.numbers.get(scene, 0) + 1 if number is None else number
        self.numbers[scene] = number
        request = service.ApplyRequest(scene=scene, number=number, **fields)
        request.transaction.edits.extend(edits)
        return self.call("Apply", request)

    def revision(self, scene: int) -> int:
        return self.call("DescribeScene", scene=scene).scene.revision

    def close(self) -> None:
        self.channel.close()
        if self.local_channel:
            self.local_channel.close()


def joined(replies):
    """One QueryReply or TracksReply of those that have some rows each."""
    whole = None
    for reply in replies:
        if whole is None:
            whole = reply
            continue
        assert reply.revision == whole.revision
        for column, more in zip(whole.columns, reply.columns, strict=True):
            assert column.name == more.name and column.shape[1:] == more.shape[1:]
            column.shape[0] += more.shape[0]
            column.data += more.data
    return whole


class Replies:
    """Result of a call: its `replies`; `is_over` when it ended, `error` when it ended so."""

    def __init__(self, call):
        self.call = call
        self.replies, self.error, self.is_over = [], None, False
        self.thread = threading.Thread(target=self._read)
        self.thread.start()

    def _read(self):
        try:
            for reply in self.call:
                self.replies.append(reply)
        except grpc.RpcError as error:
            self.error = error
        self.is_over = True

    def wait(self, count: int):
        eventually(lambda: len(self.replies) >= count)
        return self.replies

    def close(self):
        self.call.cancel()
        self.thread.join()


@dataclasses.dataclass
class Detail:
    """Details of a google.rpc.Status, as errors.proto has them."""

    field: str = ""
    reason: str = ""
    limit: str = ""
    needed: int = 0
    used: int = 0
    allowed: int = 0
    expected: int = 0
    retry_seconds: float = 0.0
    users: list[str] = dataclasses.field(default_factory=list)
    nearest: list[str] = dataclasses.field(default_factory=list)


def detail_of(status: status_pb2.Status) -> Detail:
    """Details of a status. Checks what holds of every one."""
    out = Detail()
    kinds = [getattr(details, each.type_url.rpartition(".")[2])() for each in status.details]
    for kind, packed in zip(kinds, status.details, strict=True):
        assert packed.Unpack(kind)
    info = next(kind for kind in kinds if isinstance(kind, details.ErrorInfo))
    assert info.domain == "heliograph"
    assert f"ERROR_REASON_{info.reason}" in errors_pb2.ErrorReason.keys()
    out.reason, out.limit = info.reason, info.metadata.get("limit", "")
    for name in ("needed", "used", "allowed", "expected"):
        setattr(out, name, int(info.metadata.get(name, 0)))
    out.nearest = [v for k, v in sorted(info.metadata.items()) if k.startswith("nearest_")]
    for kind in kinds:
        if isinstance(kind, details.BadRequest):
            out.field = kind.field_violations[0].field
            assert kind.field_violations[0].reason == info.reason
        elif isinstance(kind, details.QuotaFailure):
            quota = kind.violations[0]
            assert (quota.quota_metric, quota.quota_value) == (out.limit, out.allowed)
        elif isinstance(kind, details.RetryInfo):
            out.retry_seconds = kind.retry_delay.ToTimedelta().total_seconds()
        elif isinstance(kind, details.PreconditionFailure):
            out.users = [violation.subject for violation in kind.violations]
    return out


def status_of(error: grpc.RpcError) -> status_pb2.Status:
    """The google.rpc.Status that travels with every error of the daemon."""
    for key, value in error.trailing_metadata() or ():
        if key == "grpc-status-details-bin":
            status = status_pb2.Status.FromString(value)
            assert (status.code, status.message) == (error.code().value[0], error.details())
            return status
    raise AssertionError("the error carries no status")


def detail(error: grpc.RpcError) -> Detail:
    return detail_of(status_of(error))


def eventually(condition, seconds: float = 5.0):
    """Waits until condition() is true and returns it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError("did not come true in time")


@pytest.fixture
def start():
    """start(*flags, limits={}) -> Daemon; all are stopped at the end of the test."""
    daemons = []
    with tempfile.TemporaryDirectory(prefix="hg-") as folder:

        def make(*flags: str, **options) -> Daemon:
            place = os.path.join(folder, str(len(daemons)))
            os.mkdir(place, 0o700)
            daemons.append(Daemon(*flags, folder=place, **options))
            return daemons[-1]

        yield make
        for daemon in daemons:
            if daemon.process.poll() is None:
                daemon.process.kill()
            daemon.process.wait()


@pytest.fixture(scope="module")
def daemon():
    """One daemon for a whole file, stopped by SIGTERM; it must then end with 0."""
    with tempfile.TemporaryDirectory(prefix="hg-") as folder:
        running = Daemon("--grace", "0.2", folder=folder)
        yield running
        assert running.stop() == 0, running.process.stderr.read()


@pytest.fixture
def client(daemon):
    opened = Client(daemon)
    yield opened
    opened.close()
