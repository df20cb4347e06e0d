"""S13: what would not be safe does not start: exit 64, and the reason names the remedy."""

import os
import pathlib
import subprocess

import common
import heliograph as hg
import served

USAGE = 64
ROUTABLE = ("0.0.0.0:0", "[::]:0", "192.0.2.1:7443", "[2001:db8::1]:7443")


def start(*flags):
    """Exit status and words of a daemon that should not start."""
    command = [served.DAEMON, *map(str, flags)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10)
    except subprocess.TimeoutExpired:
        return 0, "it runs"
    return done.returncode, done.stderr


def refusals(place):
    """name: (flags, what the reason must name)."""
    authority = served.Authority(place)
    cert, key = authority.sign("server")
    other = authority.sign("other")[1]
    tenants = served.tenants_file(place)
    listen = ("--listen", "127.0.0.1:0")
    tls = ("--tls-cert", cert, "--tls-key")

    def copy(path, mode):
        made = pathlib.Path(f"{path}.{mode:o}")
        made.write_bytes(path.read_bytes())
        made.chmod(mode)
        return made

    empty = pathlib.Path(place / "empty")
    empty.touch(0o600)
    plain = pathlib.Path(place / "plain")
    served.write(plain, "robots token a-token-as-it-is-0123\n")
    token = pathlib.Path(place / "token")
    served.write(token, "0" * 64, 0o644)
    rows = {f"{address}, no TLS": (("--listen", address), "--tls-cert") for address in ROUTABLE}
    rows |= {
        "open address with tenants, no TLS": (
            ("--listen", "0.0.0.0:0", "--tenants", tenants),
            "--tls-cert",
        ),
        "key that others read": ((*listen, *tls, copy(key, 0o644)), "chmod 600"),
        "key that a group reads": ((*listen, *tls, copy(key, 0o660)), "chmod 600"),
        "certificate that others write": (
            (*listen, "--tls-cert", copy(cert, 0o666), "--tls-key", key),
            "chmod go-w",
        ),
        "authority that others write": (
            (*listen, *tls, key, "--tls-client-ca", copy(cert, 0o622), "--tenants", tenants),
            "chmod go-w",
        ),
        "key of another certificate": ((*listen, *tls, other), "--tls-key"),
        "no certificate": ((*listen, "--tls-cert", empty, "--tls-key", key), "PEM"),
        "certificate without key": ((*listen, "--tls-cert", cert), "--tls-key"),
        "certificates without tenants": (
            (*listen, *tls, key, "--tls-client-ca", authority.pem),
            "--tenants",
        ),
        "tenants that others read": (("--tenants", copy(tenants, 0o644)), "chmod 600"),
        "no tenants": (("--tenants", empty), "newline"),
        "a token as it is": (("--tenants", plain), "sha256sum"),
        "no such file": (("--tenants", place / "none"), "cannot be read"),
        "token that others read": ((*listen, "--token-file", token), "chmod 600"),
        "two files of tokens": (
            (*listen, "--tenants", tenants, "--token-file", place / "new"),
            "--tenants",
        ),
    }
    return rows


def main():
    with common.Report("S13 secure defaults") as report, served.folder() as place:
        rows = refusals(place)
        for name, (flags, remedy) in rows.items():
            status, words = start("--socket", place / "run/s", *flags)
            good = status == USAGE and remedy in words and "a-token-as-it-is" not in words
            report.figure(f"{name}: started, or not told why", not good, 0)
            if not good:
                print("   ", status, words)
        report.figure("sockets left behind", len(list(place.glob("run/s*"))), 0)
        with served.served("--listen", "0.0.0.0:0", "--insecure-i-know") as daemon:
            port = daemon.tcp.rsplit(":", 1)[1]
            token = pathlib.Path(daemon.path).with_name("token").read_text()
            with hg.connect(f"127.0.0.1:{port}", token=token) as client:
                stated = any("--insecure-i-know" in line for line in client.info().refused)
            report.figure("insecure: not told by GetServerInfo", not stated, 0)
            report.figure("insecure: no warning", "--insecure-i-know" not in daemon.log(), 0)
            answer = served.ask_once(f"127.0.0.1:{port}")
            report.figure("insecure: let in without a token", answer != "UNAUTHENTICATED", 0)
            mode = os.stat(pathlib.Path(daemon.path).with_name("token")).st_mode & 0o777
            report.figure("mode of the token's file beyond 0600", mode & ~0o600, 0)


if __name__ == "__main__":
    main()
