"""S8: who is let in over TLS, with and without certificates of clients."""

import concurrent.futures
import pathlib
import socket
import ssl
import subprocess
import time

import common
import heliograph as hg
import served
from heliograph._wire import link

HANDSHAKE_SECONDS = 5.0


def is_let_in(address, context):
    """True if the handshake ends well: the daemon then speaks HTTP/2 first."""
    host, port = address.rsplit(":", 1)
    try:
        with socket.create_connection((host, int(port)), 5) as plain:
            with context.wrap_socket(plain, server_hostname=host) as secure:
                return bool(secure.recv(1))
    except (ssl.SSLError, ConnectionError):
        return False


def silent_seconds(address, first):
    """How long a connection stays that sends this and then nothing."""
    host, port = address.rsplit(":", 1)
    with socket.create_connection((host, int(port)), 5) as connection:
        connection.sendall(first)
        connection.settimeout(20)
        start = time.perf_counter()
        while connection.recv(4096):
            pass
        return time.perf_counter() - start


def speaks(address, version, ca):
    """True if the daemon takes this version of TLS from a client that speaks no other."""
    command = ["openssl", "s_client", "-connect", address, f"-{version}", "-CAfile", ca]
    command += ["-cipher", "ALL:@SECLEVEL=0", "-alpn", "h2"]
    done = subprocess.run(command, input=b"", capture_output=True, timeout=20)
    return done.returncode == 0


def raises(kind, call):
    """True if the error is of this kind and names the cause."""
    try:
        call()
    except kind as error:
        return "CERTIFICATE_VERIFY_FAILED" in str(error)
    return False


def check_mutual(report, place, daemon, known, files):
    """Rows about certificates of clients."""
    ca, robots, tenants = files
    stranger = served.Authority(place, "stranger")
    rows = {
        "no certificate": None,
        "of another authority": stranger.sign("faked", "DNS:robots.example"),
        "expired": known.sign("expired", "DNS:robots.example", days=-1),
        "a name of no tenant": known.sign("nobody", "DNS:nobody.example"),
        "no name but of no tenant": known.sign("nobody2", ""),
        "names of two tenants": known.sign("two", "DNS:robots.example,DNS:vision.example"),
    }
    report.figure("valid: refused", not is_let_in(daemon.tcp, served.tls_context(ca, *robots)), 0)
    for name, pair in rows.items():
        context = served.tls_context(ca, *(pair or ()))
        report.figure(f"{name}: let in", is_let_in(daemon.tcp, context), 0)
        answer = served.ask_once(daemon.tcp, served.tls_of(ca, pair))
        report.figure(f"{name}: answered", answer != "UNAVAILABLE", 0)
    with hg.connect(daemon.tcp, tls=served.tls_of(ca, robots)) as client:
        report.figure("valid: no session", client.info().max_api != 1, 0)

    with served.channel_of(daemon.tcp, served.tls_of(ca, robots)) as channel:
        report.figure("before it is revoked: refused", served.ask(channel) != "OK", 0)
        served.write(tenants, "vision certificate vision.example\n")
        gone = common.seconds_until(lambda: served.ask(channel) == "UNAUTHENTICATED")
        report.figure("revoked: answered for, open connection", gone, 1, "s", slack=False)
    context = served.tls_context(ca, *robots)
    report.figure("revoked: let in", is_let_in(daemon.tcp, context), 0)


def check_one_sided(report, daemon, ca):
    """Rows about the daemon's certificate, versions and silence."""
    token = served.TOKENS["robots"]
    elsewhere = hg.TLS(ca=ca, server_name="elsewhere.example")
    for tls, what in ((elsewhere, "wrong name"), (hg.TLS(), "unknown authority")):
        answer = served.ask_once(daemon.tcp, tls, token)
        report.figure(f"{what} of the daemon: trusted", answer == "OK", 0)
    report.figure("without TLS: answered", served.ask_once(daemon.tcp, None, token) == "OK", 0)
    tls = served.tls_of(ca)
    report.figure("with TLS: refused", served.ask_once(daemon.tcp, tls, token) != "OK", 0)
    report.figure("no token: let in", served.ask_once(daemon.tcp, tls) != "UNAUTHENTICATED", 0)
    for version in ("tls1", "tls1_1"):
        report.figure(f"{version}: let in", speaks(daemon.tcp, version, ca), 0)
    report.figure("tls1_2: refused", not speaks(daemon.tcp, "tls1_2", ca), 0)
    refused = raises(hg.Unavailable, lambda: hg.connect(daemon.tcp, token=token, tls=hg.TLS()))
    report.figure("unknown authority: no hg.Unavailable", not refused, 0)
    hello = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"
    firsts = (b"", hello)
    with concurrent.futures.ThreadPoolExecutor() as pool:
        stays = list(pool.map(lambda first: silent_seconds(daemon.tcp, first), firsts))
    for first, seconds in zip(firsts, stays, strict=True):
        name = f"handshake stops after {len(first)} bytes: stays"
        report.figure(name, seconds, HANDSHAKE_SECONDS, "s")


def main():
    link.RETRY_SECONDS = 1.0  # of connect()
    with common.Report("S8 TLS") as report, served.folder() as place:
        known = served.Authority(place)
        cert, key = known.sign("server")
        flags = ("--listen", "127.0.0.1:0", "--tls-cert", cert, "--tls-key", key)
        tenants = served.tenants_file(
            place, "robots certificate robots.example\n", "vision certificate vision.example\n"
        )
        flags += ("--tenants", tenants)
        with served.served(*flags) as daemon:
            check_one_sided(report, daemon, known.pem)
        with served.served(*flags, "--tls-client-ca", known.pem) as daemon:
            robots = known.sign("robots", "DNS:robots.example")
            check_mutual(report, place, daemon, known, (known.pem, robots, pathlib.Path(tenants)))


if __name__ == "__main__":
    main()
