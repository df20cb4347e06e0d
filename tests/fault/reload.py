"""S11: tokens and certificates are replaced under load. No call with a valid one fails, and an old
token is refused within a second.
"""

import os
import ssl
import threading
import time

import common
import served

ROUNDS = common.size(100, 4)
RENEWALS = common.size(20, 1)


class Load:
    """Asks without end, over one connection or a new one each time, with the token of the day."""

    def __init__(self, daemon, tls, token, fresh):
        self.token, self.calls, self.failed = token, 0, []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(daemon, tls, fresh))
        self._thread.start()

    def _run(self, daemon, tls, fresh):
        channel = served.channel_of(daemon.tcp, tls)
        while not self._stop.wait(0.005):
            token = self.token
            answer = (
                served.ask_once(daemon.tcp, tls, token) if fresh else served.ask(channel, token)
            )
            self.calls += 1
            if answer != "OK":
                self.failed.append(answer)
        channel.close()

    def stop(self):
        self._stop.set()
        self._thread.join()


def rotate(place, daemon, tls, loads, number):
    """Replaces a token in three steps; the seconds until the old one is refused."""
    old, new = loads[0].token, f"token-of-robots-{number:08d}"
    lines = [served.token_line("robots", token) for token in (old, new)]
    with served.channel_of(daemon.tcp, tls) as channel:
        served.write(place / "tenants", "".join(lines))
        common.seconds_until(lambda: served.ask(channel, new) == "OK")
        for load in loads:
            load.token = new
        time.sleep(0.1)  # calls on their way carry the old one
        served.write(place / "tenants", lines[1])
        return common.seconds_until(lambda: served.ask(channel, old) == "UNAUTHENTICATED")


def serial_of(daemon, ca):
    """The number of the certificate that a handshake meets."""
    host, port = daemon.tcp.rsplit(":", 1)
    context = served.tls_context(ca)
    with ssl.create_connection((host, int(port))) as plain:
        with context.wrap_socket(plain, server_hostname=host) as secure:
            return secure.getpeercert()["serialNumber"]


def renew(place, daemon, authority):
    """New key first, new certificate later, as a careless script does it."""
    before = serial_of(daemon, authority.pem)
    pem, key = authority.sign("renewed")
    os.replace(key, place / "server.key")
    time.sleep(0.5)
    os.replace(pem, place / "server.pem")
    return common.seconds_until(lambda: serial_of(daemon, authority.pem) != before)


def check_files(report, place, daemon, tls, load):
    """Files that are wrong change nothing."""
    for text in ("", "robots token nonsense\n", served.token_line("robots", load.token)[:-1]):
        served.write(place / "tenants", text)
        time.sleep(0.7)
    served.write(place / "tenants", served.token_line("vision", "somebody-elses-token"), mode=0o644)
    time.sleep(0.7)
    answer = served.ask_once(daemon.tcp, tls, load.token)
    report.figure("after wrong files: refused", answer != "OK", 0)
    lines = sum(
        "what held goes on" in line and "--tenants" in line for line in daemon.log().splitlines()
    )
    report.figure("wrong files that the log does not tell", 4 - lines, 0)
    report.figure("of them, told with what is in them", "nonsense" in daemon.log(), 0)


def main():
    with common.Report("S11 reload") as report, served.folder() as place:
        authority = served.Authority(place)
        cert, key = authority.sign("server")
        flags = ("--tenants", served.tenants_file(place), "--listen", "127.0.0.1:0")
        tls = served.tls_of(authority.pem)
        with served.served(*flags, "--tls-cert", cert, "--tls-key", key) as daemon:
            token = served.TOKENS["robots"]
            loads = [Load(daemon, tls, token, fresh) for fresh in (False, True)]
            seconds = [rotate(place, daemon, tls, loads, i) for i in range(ROUNDS)]
            renewals = [renew(place, daemon, authority) for _ in range(RENEWALS)]
            check_files(report, place, daemon, tls, loads[0])
            for load in loads:
                load.stop()
            calls = sum(load.calls for load in loads)
            failed = [answer for load in loads for answer in load.failed]
            report.figure(f"of {calls} valid calls, failed", len(failed), 0)
            report.figure(f"old token refused after, worst of {ROUNDS}", max(seconds), 1, "s")
            report.figure(f"new certificate met after, worst of {RENEWALS}", max(renewals), 2, "s")


if __name__ == "__main__":
    main()
