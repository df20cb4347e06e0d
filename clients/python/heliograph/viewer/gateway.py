"""The gateway between a browser and a daemon: HTTP on loopback, for who has the token.

Guards: the token is 256 random bits in each path, compared in constant time; the Host header has to
be this machine's, so that no foreign name can be bound to it; a browser's word on where a request
comes from is heeded; no other origin may read an answer; the page may load nothing from elsewhere.
"""

from __future__ import annotations

import hmac
import json
import re
import secrets
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import parse_qs, urlsplit

import numpy as np

from ..errors import HeliographError, InvalidArgument, NotFound, ResourceExhausted
from ..values.checks import whole_of
from . import outline
from .session import Session

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

    from ..client.scene import Scene

_HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?")
_MOST_SESSIONS = 16
_IDLE_SECONDS = 60.0
_POLL_SECONDS = 20.0
_MOST_BYTES = 65536  # of a request's body
_POLICY = (
    "default-src 'none'; script-src 'nonce-{0}'; style-src 'nonce-{0}'; img-src 'self' blob:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class Viewer:
    """Shows a scene in a browser, as it changes: `with hg.Viewer(scene) as viewer: viewer.wait()`.

    camera: one of the scene's to begin at, default a place that sees everything. port: default any
    free one. spp: samples per pixel at which refining ends. `.url` lets its holder see the scene,
    not change it. Thread: any. close() ends the pages' streams, not the scene.
    """

    def __init__(self, scene: Scene, camera: Any = None, *, port: int = 0, spp: int = 1024) -> None:
        self.scene = scene
        self.camera = "" if camera is None else str(getattr(camera, "name", camera))
        self.spp = spp
        port = whole_of(port, "port", 0, 65535)
        self.token = secrets.token_urlsafe(32)
        self._sessions: dict[str, Session] = {}
        self._lock = threading.Lock()
        self._server = _Server(("127.0.0.1", port), _Handler)
        self._server.viewer = self
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.2}, daemon=True
        )
        self._thread.start()

    @property
    def url(self) -> str:
        """URL of the page; it contains the token."""
        return f"http://127.0.0.1:{self._server.server_port}/{self.token}/"

    def wait(self) -> None:
        """Waits until Ctrl-C."""
        while self._thread.is_alive():
            self._thread.join(timeout=1.0)

    def close(self) -> None:
        """Ends it."""
        self._server.shutdown()
        self._server.server_close()
        with self._lock:
            sessions, self._sessions = list(self._sessions.values()), {}
        for session in sessions:
            session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()

    # ------------------------------------------------------------ what the handler calls

    def open_session(self) -> str:
        """A new page's; pages that nobody polls are forgotten."""
        now = time.monotonic()
        with self._lock:
            idle = [k for k, s in self._sessions.items() if now - s.seen > _IDLE_SECONDS]
            gone = [self._sessions.pop(key) for key in idle]
            full = len(self._sessions) >= _MOST_SESSIONS
            key = secrets.token_urlsafe(9)
            if not full:
                self._sessions[key] = Session(self.scene, self.spp)
        for session in gone:
            session.close()
        if full:
            raise ResourceExhausted(f"session: {_MOST_SESSIONS} pages are open; close one")
        return key

    def session(self, key: str) -> Session:
        with self._lock:
            found = self._sessions.get(key)
        if found is None:
            raise NotFound("session: there is none of that name; open the page again")
        return found

    def close_session(self, key: str) -> None:
        with self._lock:
            found = self._sessions.pop(key, None)
        if found is not None:
            found.close()

    def pick(self, key: str, at: Any) -> dict[str, Any]:
        """The entity at a point [x, y] of a page's picture, 0 to 1 each."""
        session = self.session(key)
        if not isinstance(at, list) or len(at) != 2 or not all(0 <= float(v) <= 1 for v in at):
            raise InvalidArgument("at: two numbers, 0 to 1", field="at")
        if session.camera:
            lens = self.scene[session.camera].camera
            pixel = np.array(at) * [lens.width, lens.height] - 0.5
            hit = self.scene.pick(session.camera, pixel[None])
        else:
            ray = session.ray(float(at[0]), float(at[1]))
            if ray is None:
                return {}
            hit = self.scene.cast_rays(ray[0][None], ray[1][None])
        if not np.isfinite(hit["position"][0]).all() or int(hit["entity"][0]) == 0:
            return {}
        return {"id": str(int(hit["entity"][0])), "position": hit["position"][0].tolist()}


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    viewer: Viewer


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "heliograph", ""
    timeout = 60  # seconds that a client may take for its request

    @property
    def viewer(self) -> Viewer:
        return cast(_Server, self.server).viewer

    def log_message(self, format: str, *args: Any) -> None:
        """Logs nothing: paths contain the token."""

    def do_GET(self) -> None:
        self._answer({"": self._page, "scene": self._scene, "picture": self._picture,
                      "object": self._object, "save": self._save})  # fmt: skip

    def do_POST(self) -> None:
        self._answer({"open": self._open, "want": self._want, "pick": self._pick,
                      "close": self._close})  # fmt: skip

    def _answer(self, routes: dict[str, Any]) -> None:
        """Answers a request. Without the token the reply is the same for every path, so that it
        discloses nothing."""
        length = self.headers.get("Content-Length", "0")
        self._body = b""
        if not length.isdigit() or int(length) > _MOST_BYTES:
            self.close_connection = True
            return self._send(413, {"error": "the body is too large"})
        self._body = self.rfile.read(int(length))
        parts = urlsplit(self.path)
        token, _, route = parts.path.lstrip("/").partition("/")
        allowed = hmac.compare_digest(token.encode(), self.viewer.token.encode())
        if not self._is_local() or not allowed:
            return self._send(403, {"error": "forbidden"})
        if route not in routes:
            return self._send(404, {"error": "not found"})
        self._query = {key: values[-1] for key, values in parse_qs(parts.query).items()}
        try:
            routes[route]()
        except NotFound as error:
            self._send(404, {"error": str(error)})
        except (HeliographError, ValueError, TypeError, KeyError) as error:
            self._send(400, {"error": str(error)})

    def _is_local(self) -> bool:
        """True if the Host is this machine and, from a browser, the request is its own page's."""
        host = self.headers.get("Host", "")
        if not _HOST.fullmatch(host):
            return False
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return False
        origin = self.headers.get("Origin")
        return origin is None or origin == f"http://{host}"

    def _json(self) -> Any:
        if self.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            raise InvalidArgument("Content-Type: application/json")
        return json.loads(self._body or b"{}")

    def _send(self, status: int, body: Any, kind: str = "application/json", **more: str) -> None:
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(data)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
        }
        for name, value in {**headers, **more}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        try:
            self.wfile.write(data)
        except OSError:  # the page is gone
            self.close_connection = True

    # ------------------------------------------------------------ routes

    def _page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        page = (resources.files(__package__) / "page.html").read_text("utf-8")
        policy = {"Content_Security_Policy": _POLICY.format(nonce)}
        self._send(
            200, page.replace("{{nonce}}", nonce).encode(), "text/html; charset=utf-8", **policy
        )

    def _scene(self) -> None:
        self._send(200, outline.of_scene(self.viewer.scene, self.viewer.camera))

    def _object(self) -> None:
        self._send(200, outline.of_object(self.viewer.scene, int(self._query["id"])))

    def _open(self) -> None:
        self._json()
        self._send(200, {"session": self.viewer.open_session()})

    def _want(self) -> None:
        self.viewer.session(self._query["session"]).want(self._json())
        self._send(200, {})

    def _close(self) -> None:
        self._json()
        self.viewer.close_session(self._query["session"])
        self._send(200, {})

    def _pick(self) -> None:
        self._send(200, self.viewer.pick(self._query["session"], self._json().get("at")))

    def _picture(self) -> None:
        """Waits for one after the serial; 204 when none comes for long."""
        session = self.viewer.session(self._query["session"])
        found = session.next(int(self._query.get("after", "0")), _POLL_SECONDS)
        if found is None:
            return self._send(204, b"", "image/jpeg")
        description, data = found
        self._send(200, data, "image/jpeg", X_Picture=json.dumps(description))

    def _save(self) -> None:
        data = self.viewer.session(self._query["session"]).png()
        if not data:
            raise NotFound("save: there is no picture yet")
        disposition = {"Content_Disposition": 'attachment; filename="heliograph.png"'}
        self._send(200, data, "image/png", **disposition)
