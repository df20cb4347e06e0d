"""Changes of one picture, however many: beyond the size of a message they go out in parts; a
picture shows all parts or none. Used by mirror.py."""

from __future__ import annotations

from types import TracebackType

import heliograph as hg
from heliograph.client.edit import Edits

PART_BYTES = 8 << 20  # half of a daemon's default limit


class Parts:
    """`with Parts(scene) as parts:` edits go to parts.edit; room() may be called between two.

    Parts of a picture's changes. Changes that fit one message are one transaction. More of them go
    to a branch, which `scene` denotes from then on, and the scene as it was is deleted at the end,
    or denoted again on an exception.
    """

    def __init__(self, scene: hg.Scene) -> None:
        self.edit: Edits = scene.edit()
        self._scene = scene
        self._before: hg.Scene | None = None
        self._counted = self._bytes = 0

    def __enter__(self) -> Parts:
        return self

    def room(self) -> None:
        """Sends the gathered changes, if they are about as much as a message takes."""
        edits = self.edit.transaction.edits
        self._bytes += sum(edits[i].ByteSize() for i in range(self._counted, len(edits)))
        self._counted = len(edits)
        if self._bytes < PART_BYTES:
            return
        if self._before is None:
            self._before = self._scene.branch()
            self._swap()
        self.edit.commit()
        self.edit = self._scene.edit()
        self._counted = self._bytes = 0

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None
    ) -> None:
        is_whole = False
        try:
            if kind is None:
                self.edit.commit()
                is_whole = True
        finally:
            if self._before is not None:
                if not is_whole:
                    self._swap()
                self._before.delete()

    def _swap(self) -> None:
        """Swaps the scenes that two handles denote."""
        assert self._before is not None
        self._scene.id, self._before.id = self._before.id, self._scene.id
