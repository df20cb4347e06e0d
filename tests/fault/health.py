"""The health of a daemon: readiness and liveness, asked and watched."""

from __future__ import annotations

import threading
import time

import grpc

RENDERER = "heliograph.v1.Renderer"
DURABLE = "heliograph.v1.Durable"


def _request(name):
    """HealthCheckRequest; its one field is the name."""
    return b"\x0a" + bytes([len(name)]) + name.encode() if name else b""


def _serves(reply):
    """HealthCheckResponse; 1 is SERVING."""
    return reply == b"\x08\x01"


class Health:
    """Health of the daemon behind a client, or by its gRPC target, over a channel of its own."""

    def __init__(self, client):
        target = client if isinstance(client, str) else client.address
        options = [("grpc.use_local_subchannel_pool", 1)]
        self.channel = grpc.insecure_channel(target, options=options)

    def check(self, name=RENDERER, timeout=5.0):
        call = self.channel.unary_unary("/grpc.health.v1.Health/Check")
        return _serves(call(_request(name), timeout=timeout, wait_for_ready=True))

    def wait(self, ready, limit=30.0):
        """Until it is ready, or is not."""
        end = time.perf_counter() + limit
        while self.check() != ready:
            if time.perf_counter() > end:
                raise TimeoutError(f"never {'ready' if ready else 'not ready'}")
            time.sleep(0.02)

    def watch(self):
        return Watch(self.channel)


class Watch:
    """Notes when readiness changes."""

    def __init__(self, channel):
        self.seen = []  # (seconds of time.perf_counter(), ready)
        self._changed = threading.Condition()
        self._stream = channel.unary_stream("/grpc.health.v1.Health/Watch")(_request(RENDERER))
        threading.Thread(target=self._read, daemon=True).start()
        self.first(None)

    def _read(self):
        try:
            for reply in self._stream:
                with self._changed:
                    self.seen.append((time.perf_counter(), _serves(reply)))
                    self._changed.notify_all()
        except grpc.RpcError:
            pass  # the daemon ended, or close()

    def first(self, ready, after=0.0, limit=60.0):
        """When it was first so (None: either) after a time."""

        def found():
            return next((t for t, r in self.seen if t >= after and ready in (None, r)), None)

        with self._changed:
            if not self._changed.wait_for(lambda: found() is not None, limit):
                raise TimeoutError(f"never {ready}; saw {self.seen}")
            return found()

    def close(self):
        self._stream.cancel()
