"""Identity before bytes: callers over TCP without a token send messages that never end. The daemon
buffers none of them: others' calls and sessions go on, over the Unix socket and over TCP, and its
memory stays where it was."""

import socket
import struct
import threading
import time

import common
import h2_abuse as h2
import heliograph as hg
import served

CONNECTIONS = common.size(8, 4)
STREAMS = 32
SIZE = 14 << 20  # of each message, below message_bytes
SECONDS = common.size(20, 5)
WINDOW_UPDATE, GOAWAY = 8, 7


class Stranger:
    """A connection whose calls of `path` send one message each for as long as they may."""

    def __init__(self, address, path):
        host, port = address.rsplit(":", 1)
        self.socket = socket.create_connection((host, int(port)), timeout=5)
        self.sent = 0
        self._room, self._of_stream, self._initial = 65535, {}, 65535
        self._out, self._in = h2.PREFACE + h2.frame(h2.SETTINGS), b""
        call = b"\x83\x86" + h2.literal(b":path", path) + h2.literal(b":authority", b"x")
        call += h2.literal(b"content-type", b"application/grpc") + h2.literal(b"te", b"trailers")
        for stream in range(1, 2 * STREAMS, 2):
            self._out += h2.frame(h2.HEADERS, h2.END_HEADERS, stream, call)
            self._out += h2.frame(h2.DATA, 0, stream, b"\x00" + struct.pack(">I", SIZE))
            self._of_stream[stream] = self._initial - 5
            self._room -= 5
        self.socket.setblocking(False)

    def step(self):
        """Sends what flow control lets through, and reads what it lets through from now on."""
        try:
            self._in += self.socket.recv(1 << 16)
        except BlockingIOError:
            pass
        while len(self._in) >= 9 and len(self._in) >= 9 + int.from_bytes(self._in[:3], "big"):
            size = int.from_bytes(self._in[:3], "big")
            stream = int.from_bytes(self._in[5:9], "big") & 0x7FFFFFFF
            self._receive(self._in[3], self._in[4], stream, self._in[9 : 9 + size])
            self._in = self._in[9 + size :]
        if not self._out:
            self._fill()
        try:
            sent = self.socket.send(self._out) if self._out else 0
        except BlockingIOError:
            return
        self._out = self._out[sent:]
        self.sent += sent

    def _receive(self, kind, flags, stream, body):
        if kind == WINDOW_UPDATE and stream == 0:
            self._room += int.from_bytes(body, "big")
        elif kind == WINDOW_UPDATE and stream in self._of_stream:
            self._of_stream[stream] += int.from_bytes(body, "big")
        elif kind == h2.SETTINGS and not flags & 1:
            for at in range(0, len(body), 6):
                key, value = struct.unpack(">HI", body[at : at + 6])
                if key == 4:
                    for each in self._of_stream:
                        self._of_stream[each] += value - self._initial
                    self._initial = value
            self._out += h2.frame(h2.SETTINGS, 1)
        elif kind == h2.PING and not flags & 1:
            self._out += h2.frame(h2.PING, 1, 0, body)
        elif kind == h2.RST_STREAM or (kind == h2.HEADERS and flags & 1):
            self._of_stream.pop(stream, None)

    def _fill(self):
        for stream, room in self._of_stream.items():
            size = min(16384, self._room, room)
            if size > 0 and len(self._out) < 1 << 18:
                self._out += h2.frame(h2.DATA, 0, stream, bytes(size))
                self._of_stream[stream] -= size
                self._room -= size


def attack(strangers, over):
    while not over.is_set():
        for each in list(strangers):
            try:
                each.step()
            except OSError:
                strangers.remove(each)
        time.sleep(0.001)


def render_beside(scenes, peak, pid):
    """How many frames failed, and the most memory seen."""
    failed, end = 0, time.perf_counter() + SECONDS
    while time.perf_counter() < end:
        for scene in scenes:
            try:
                scene.render("cam", spp=1)
            except hg.HeliographError as error:
                print("   ", error)
                failed += 1
        peak = max(peak, common.resident(pid))
    return failed, peak


def main():
    with common.Report("strangers over TCP") as report:
        with served.served("--listen", "127.0.0.1:0", "--grace", "2") as daemon:
            local = hg.connect(daemon.socket)
            remote = hg.connect(daemon.tcp, token=daemon.token())
            with local, remote:
                scenes = [common.stage(client, 32, 32) for client in (local, remote)]
                before = common.resident(daemon.pid)
                for path in (b"/heliograph.v1.Renderer/Apply", b"/grpc.health.v1.Health/Check"):
                    strangers = [Stranger(daemon.tcp, path) for _ in range(CONNECTIONS)]
                    over = threading.Event()
                    thread = threading.Thread(target=attack, args=(list(strangers), over))
                    thread.start()
                    failed, peak = render_beside(scenes, before, daemon.pid)
                    over.set()
                    thread.join()
                    sent = sum(each.sent for each in strangers) / 2**20
                    print(f"  {path.decode()}: {sent:.1f} MiB were sent")
                    for each in strangers:
                        each.socket.close()
                    report.figure("others' frames that failed", failed, 0, slack=False)
                    grown = (peak - before) / 2**20
                    report.figure("memory grew by", grown, 48, "MiB", slack=False)


if __name__ == "__main__":
    main()
