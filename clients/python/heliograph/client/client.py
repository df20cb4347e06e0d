"""connect() and Client: a session with a daemon, and its scenes."""

from __future__ import annotations

import os
import threading
import uuid
import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .._wire._proto import service_pb2 as service
from .._wire.access import TLS, Access
from .._wire.arrays import Store
from .._wire.connection import Connection
from ..errors import InvalidArgument
from .lifetime import Lifetime, lifetime_of
from .scene import Scene
from .state import SceneState

if TYPE_CHECKING:
    from .._wire.launch import PrivateDaemon
    from .._wire.start import Deadline

_LISTS = ("objects", "scenes", "sessions")  # that come in pages
_clients: weakref.WeakValueDictionary[tuple[int, Access], Client] = weakref.WeakValueDictionary()
_inherited: weakref.WeakSet[Client] = weakref.WeakSet()  # every one, for forked children


class Client:
    """A session with a daemon. Use it in a `with`, or close() it. Thread: any.

    Pickles as its address and access; a forked child opens a session of its own.
    """

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.store = Store(connection)
        self._states: dict[int, SceneState] = {}
        self._lock = threading.RLock()  # a collection within it may end a scene of this client
        _clients[(os.getpid(), connection.access)] = self
        _inherited.add(self)

    @property
    def address(self) -> str:
        """ "unix:///path" or "host:port"."""
        return self.connection.access.address

    def create_scene(self, name: str = "", *, lifetime: Lifetime = "session") -> Scene:
        """An empty scene.

        lifetime: until when it lives, if it is not deleted before. "session": the end of this
        session; "daemon": that of the daemon; "disk": for ever, and its acknowledged edits survive
        the end of the daemon, kill -9 too; "disk_synced": a loss of power, too. The last two need a
        daemon with --state-dir.
        """
        request = service.CreateSceneRequest(
            request_id=uuid.uuid4().hex, name=name, lifetime=lifetime_of(lifetime)
        )
        info = self.connection.call("CreateScene", request)
        return self.scene_of(info, owned=lifetime == "session")

    def open_scene(self, name: str) -> Scene:
        """A scene by its name; NotFound lists the nearest."""
        return self.scene_of(self.connection.call("OpenScene", service.OpenSceneRequest(name=name)))

    def load_scene(
        self,
        path: str | os.PathLike[str],
        *,
        name: str = "",
        lifetime: Lifetime = "session",
    ) -> Scene:
        """A new scene from a file that Scene.save wrote. lifetime: see create_scene."""
        from ..scene import scene_file

        chunks = scene_file.read(
            path,
            request_id=uuid.uuid4().hex,
            name=name,
            lifetime=lifetime_of(lifetime),
        )
        info = self.connection.push("ImportScene", chunks)
        return self.scene_of(info, owned=lifetime == "session")

    def scenes(self) -> list[Scene]:
        """Lists every scene that this client may open."""
        return [self.scene_of(info) for info in self.scene_infos()]

    def scene_infos(self) -> list[service.SceneInfo]:
        """Lists the v1.SceneInfo of each such scene, the oldest first."""
        return list(self.whole("ListScenes", service.ListScenesRequest()).scenes)

    def sessions(self) -> list[service.SessionUse]:
        """Lists the sessions of this client's tenant, the oldest first, with their use of
        limits."""
        return list(self.whole("ListSessions", service.ListSessionsRequest()).sessions)

    def whole(self, name: str, request: Any) -> Any:
        """The reply of a call that lists, with all pages of the list in it; what else it has is
        that of the first page."""
        reply = page = self.connection.call(name, request)
        while page.next_page_token:
            request.page_token = page.next_page_token
            page = self.connection.call(name, request)
            for field, value in page.ListFields():
                if field.name in _LISTS:
                    getattr(reply, field.name).extend(value)
        reply.ClearField("next_page_token")
        return reply

    def info(self) -> service.GetServerInfoReply:
        """Version, backend, limits, capabilities, and features that the kernel refused."""
        reply: service.GetServerInfoReply = self.connection.call(
            "GetServerInfo", service.GetServerInfoRequest()
        )
        return reply

    def scene_of(self, info: service.SceneInfo, owned: bool = False) -> Scene:
        """The Scene of a SceneInfo."""
        return Scene(self, info.scene, info.name, owned=owned)

    def state_of(self, scene: int) -> SceneState:
        """State that every Scene object of one scene shares: the numbering of its edits."""
        with self._lock:
            return self._states.setdefault(scene, SceneState())

    def forget(self, scene: int) -> None:
        """The scene is deleted."""
        with self._lock:
            self._states.pop(scene, None)

    def forget_parent(self) -> None:
        """Replaces locks and states, in a forked child: waits for no thread of the parent."""
        self._lock = threading.RLock()
        self._states = {}
        self.store.forget_parent()

    def close(self) -> None:
        """Ends the session, its private scenes, and a private daemon."""
        self.connection.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Client {self.address}>"

    def __reduce__(self) -> Any:
        return _reconnect, (self.connection.access,)


def _reconnect(access: Access) -> Client:
    """Unpickling: this process's client of that daemon, or a new one."""
    found = _clients.get((os.getpid(), access))
    if found is None or found.connection.closed:
        return open_client(access, None)
    return found


def open_client(
    access: Access, daemon: PrivateDaemon | None, deadline: Deadline | None = None
) -> Client:
    """A client whose session is open by the deadline."""
    connection = Connection(access, daemon)
    try:
        connection.open(deadline)
    except BaseException:
        connection.close()
        raise
    return Client(connection)


def check_arguments(address: str | None, tls: TLS | None, arguments: Sequence[str]) -> None:
    """Checks the arguments of connect(). InvalidArgument."""
    if tls is not None and (address is None or address.startswith("unix:")):
        raise InvalidArgument('tls= is for "host:port"', field="tls")
    if tls is not None and not isinstance(tls, TLS):
        raise InvalidArgument("tls= is a heliograph.TLS(...)", field="tls")
    if address is not None and arguments:
        raise InvalidArgument("arguments= are for the private daemon", field="arguments")


def _in_child() -> None:
    for client in list(_inherited):
        client.forget_parent()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
