"""The dome of an edit, and the texture that each one makes: it goes when the next one takes its
place. Used by edit.py."""

from __future__ import annotations

import re
import threading
from typing import TYPE_CHECKING, Any, cast

from .._wire._proto import service_pb2 as service
from ..errors import FailedPrecondition, HeliographError, NotFound
from . import images
from .handles import Handle, Texture

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..client.edit import Edits
    from ..client.scene import Scene
    from ..values.sky import AirOptions

_UNSET: Any = object()
_MADE = re.compile(r"dome/.*-[0-9a-f]{12}", re.DOTALL)  # the names that images.dome_texture gives
_EDIT = re.compile(r"edits\[(\d+)\]")


class Last:
    """Texture that the last dome() of a session made in a scene."""

    def __init__(self) -> None:
        self.name = ""  # of the texture; "": not known, or none
        self.lock = threading.Lock()  # while it is replaced


class DomeEdits:
    """The part of Edits that lights from infinitely far."""

    _domes: list[str]  # names of the textures that this transaction's domes made, "" for none

    def dome(
        self, image: Any = _UNSET, *, layer: str = "", **light: Unpack[images.DomeOptions]
    ) -> None:
        """Changes the light from infinitely far.

        image: a lat-long file's path, an array, or a texture handle; None: no dome at all. The
        texture that a file or an array makes goes with the next image, unless something else uses
        it. layer: as of texture().
        color: radiance (3,), or a number; it multiplies the image. intensity: a factor.
        rotation: radians about +Z, or (3, 3) world_from_dome. light_group: as of an entity.
        """
        edits = cast("Edits", self)
        out = images.dome_message(light)
        name = ""
        if image is None or image is _UNSET or isinstance(image, Handle):
            images.refuse_layer(layer)
        if image is None:
            out.clear.extend(field.name for field in out.DESCRIPTOR.fields if field.name != "clear")
        elif isinstance(image, Handle):
            out.texture.CopyFrom(edits.ref(image, "image"))
        elif image is not _UNSET:
            name, message = images.dome_texture(edits, image, layer)
            edits._add(name).texture.CopyFrom(message)
            out.texture.CopyFrom(edits._handle(Texture, name).ref(edits))
        edits._add(None).settings.dome.CopyFrom(out)
        if image is not _UNSET:
            self._domes.append(name)

    def sky(
        self, elevation: float, azimuth: float = 0.0, sun: str = "sun", **air: Unpack[AirOptions]
    ) -> None:
        """A clear sky as the dome, and its sun as the entity `sun`. elevation, azimuth: of the sun,
        radians. options: see heliograph.sky.AirOptions."""
        from ..values import sky

        sky.put(cast("Edits", self), sun, sky.sky(elevation, azimuth, **air))

    def _apply(self) -> service.ApplyReply:
        """Sends the transaction, with removals of textures that domes made before the last one."""
        edits = cast("Edits", self)
        if not self._domes:
            return edits.scene.apply(edits.transaction, edits._expected)
        last = edits.scene.client.state_of(edits.scene.id).dome
        with last.lock:
            known, last.name = last.name, ""  # until it is accepted
            left = _Left(edits, [*self._domes[:-1], known or _dome_of(edits.scene)])
            reply = left.apply()
            last.name = self._domes[-1]
        return reply


class _Left:
    """Textures of former domes, to be removed behind the edits of a transaction."""

    def __init__(self, edits: Edits, names: list[str]) -> None:
        self._edits = edits
        self._count = len(edits.transaction.edits)
        self._staying = {"", edits._domes[-1]}
        self._names = self._others(names)

    def _others(self, names: list[str]) -> list[str]:
        return [name for name in dict.fromkeys(names) if name not in self._staying]

    def apply(self) -> service.ApplyReply:
        """Sends the transaction with the removals, again without each one that is refused."""
        while True:
            self._write()
            try:
                return self._edits.scene.apply(self._edits.transaction, self._edits._expected)
            except (NotFound, FailedPrecondition) as error:
                self._clear()
                if not self._gives_up(error):
                    raise
            except BaseException:
                self._clear()
                raise

    def _write(self) -> None:
        edits = self._edits.transaction.edits
        for name in self._names:
            edits.add().remove.SetInParent()
            edits[-1].target.name = name

    def _clear(self) -> None:
        """Restores the transaction."""
        del self._edits.transaction.edits[self._count :]

    def _gives_up(self, error: HeliographError) -> bool:
        """Leaves out the texture whose removal was refused: it is gone, or something uses it. The
        last one may have been remembered, and another client have changed the dome since."""
        found = _EDIT.match(error.field)
        index = int(found[1]) - self._count if found else -1
        if not 0 <= index < len(self._names):
            return False
        self._staying.add(self._names[index])
        self._names = self._others([*self._names, _dome_of(self._edits.scene)])
        return True


def _dome_of(scene: Scene) -> str:
    """The name of the texture that the dome of a scene shows, if a dome() made it."""
    state, session = scene.client.state_of(scene.id), scene.client.connection.link.session
    reply = scene.describe(tree=True, pattern="dome/*")
    with state.lock:
        if state.session != session:  # the first edit need not ask once more
            state.session, state.next = session, reply.scene.next_edit
    made = {found.id: found.name for found in reply.objects if _MADE.fullmatch(found.name)}
    if not made:
        return ""
    request = service.ReadRequest(scene=scene.id, fields=["dome"])
    for part in scene.client.connection.stream("Read", request):
        return made.get(part.object.settings.dome.texture.id, "")
    return ""
