"""A daemon as an operator runs it: a process of its own with a socket, which clients name; for
several tenants, over TCP, with certificates made here."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import pathlib
import ssl
import subprocess
import tempfile
import urllib.request

import grpc
import heliograph as hg
from heliograph._wire._proto import service_pb2 as service

ROOT = pathlib.Path(__file__).resolve().parents[2]
DAEMON = os.environ.get("HELIOGRAPHD", str(ROOT / "build/cpu/bin/heliographd"))
TOKENS = {"robots": "token-of-robots-0123456789", "vision": "token-of-vision-0123456789"}
LOOPBACK = "DNS:localhost,IP:127.0.0.1"


def write(path, text, mode=0o600):
    """Replaces a file whole."""
    fresh = pathlib.Path(f"{path}.new")
    fresh.write_text(text)
    fresh.chmod(mode)
    fresh.rename(path)


def token_line(tenant, token):
    """A line of the tenants file."""
    return f"{tenant} token sha256:{hashlib.sha256(token.encode()).hexdigest()}\n"


def tenants_file(folder, *lines):
    """The file of both tenants' tokens, and more lines."""
    path = pathlib.Path(folder) / "tenants"
    write(path, "".join(token_line(*item) for item in TOKENS.items()) + "".join(lines))
    return path


class Authority:
    """Signs certificates; files NAME.pem and NAME.key in its folder."""

    def __init__(self, folder, name="ca"):
        self.folder, self.name = pathlib.Path(folder), name
        self.pem = self.folder / f"{name}.pem"
        self._openssl("req", "-x509", "-subj", f"/CN={name}", *self._fresh(name), "-out", self.pem)

    def sign(self, name, names=LOOPBACK, days=30):
        """(certificate, key) that bear these subject alternative names."""
        request, pem = self.folder / f"{name}.csr", self.folder / f"{name}.pem"
        extension = ("-addext", f"subjectAltName={names}") if names else ()
        subject = ("-subj", f"/CN={name}")
        self._openssl("req", "-new", *subject, *extension, *self._fresh(name), "-out", request)
        by = ("-CA", self.pem, "-CAkey", self.folder / f"{self.name}.key")
        copy = ("-copy_extensions", "copy", "-out", pem)
        self._openssl("x509", "-req", "-in", request, *by, "-days", str(days), *copy)
        return pem, self.folder / f"{name}.key"

    def _fresh(self, name):
        curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256")
        return (*curve, "-nodes", "-keyout", self.folder / f"{name}.key")

    @staticmethod
    def _openssl(*arguments):
        subprocess.run(["openssl", *arguments], check=True, capture_output=True)


class Served:
    """A heliographd with these flags; `.socket` is its address and `.path` the socket's, `.tcp` the
    address when it listens on TCP, `.metrics` that of its metrics. `under`: a command that executes
    it, as `prlimit` does; `popen`: of its process."""

    def __init__(self, folder, *flags, under=(), **popen):
        self.folder = pathlib.Path(folder)
        self.path = f"{folder}/run/heliograph.sock"
        self.socket = f"unix://{self.path}"
        self._log = self.folder / "log"
        read, ready = os.pipe()
        with open(self._log, "wb") as log:
            self.process = subprocess.Popen(
                [*under, DAEMON, "--socket", self.path, "--ready-fd", str(ready), *map(str, flags)],
                pass_fds=(ready,),
                **{"stderr": log, **popen},
            )
        atexit.register(self.process.kill)  # of a script that ends by an error
        os.close(ready)
        with os.fdopen(read) as pipe:
            line = pipe.readline()
        if not line:
            raise RuntimeError(f"heliographd did not start: {self.log()}")
        announced = json.loads(line)
        self.tcp, self.metrics = next(iter(announced["listen"]), ""), announced["metrics"]

    def log(self):
        return self._log.read_text()

    def token(self):
        return (self.folder / "run/token").read_text()

    def kill(self):
        self.process.kill()
        self.process.wait()

    @property
    def pid(self):
        return self.process.pid

    def descriptors(self):
        return len(os.listdir(f"/proc/{self.pid}/fd"))

    def cpu_seconds(self):
        """CPU time of all threads, user and system."""
        with open(f"/proc/{self.pid}/stat") as file:
            fields = file.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def scrape(self, name):
        """The values of a metric by their labels, as they are written."""
        with urllib.request.urlopen(f"http://{self.metrics}/metrics", timeout=5) as reply:
            lines = reply.read().decode().splitlines()
        found = (line[len(name) + 1 :].split("} ") for line in lines if line.startswith(name + "{"))
        return {labels: float(value) for labels, value in found}

    def stop(self):
        self.process.terminate()
        return self.process.wait(30)


@contextlib.contextmanager
def served(*flags, folder=None, **options):
    """Served, in a folder of its own, stopped at the end."""
    with contextlib.ExitStack() as stack:
        place = folder or stack.enter_context(tempfile.TemporaryDirectory(prefix="hg-"))
        daemon = Served(place, *flags, **options)
        stack.callback(daemon.stop)
        yield daemon


def few_descriptors(most):
    """The command that runs a daemon with no more."""
    return ("prlimit", f"--nofile={most}")


@contextlib.contextmanager
def folder():
    """A temporary folder."""
    with tempfile.TemporaryDirectory(prefix="hg-") as place:
        yield pathlib.Path(place)


def tls_context(ca, cert=None, key=None):
    """A handshake as gRPC makes it, for raw sockets."""
    context = ssl.create_default_context(cafile=ca)
    context.set_alpn_protocols(["h2"])
    if cert:
        context.load_cert_chain(cert, key)
    return context


def channel_of(address, tls=None):
    """A channel of its own connection."""
    options = [("grpc.use_local_subchannel_pool", 1)]
    if tls is not None and tls.server_name:
        options.append(("grpc.ssl_target_name_override", tls.server_name))
    if tls is None:
        return grpc.insecure_channel(address, options)
    return grpc.secure_channel(address, tls.credentials(), options)


def ask(channel, token=None, timeout=5.0):
    """The status code of one GetServerInfo."""
    call = channel.unary_unary(
        "/heliograph.v1.Renderer/GetServerInfo",
        request_serializer=service.GetServerInfoRequest.SerializeToString,
        response_deserializer=service.GetServerInfoReply.FromString,
    )
    try:
        call(
            service.GetServerInfoRequest(),
            metadata=(("authorization", f"Bearer {token}"),) if token else (),
            timeout=timeout,
        )
    except grpc.RpcError as error:
        return error.code().name
    return "OK"


def ask_once(address, tls=None, token=None):
    """The same over a new connection."""
    with channel_of(address, tls) as channel:
        return ask(channel, token)


def tls_of(ca, pair=None):
    """The client's side of a certificate."""
    cert, key = pair or (None, None)
    return hg.TLS(ca=ca, cert=cert, key=key)
