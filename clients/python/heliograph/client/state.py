"""State that a session keeps of a scene. Kept by client.py, used by scene.py."""

from __future__ import annotations

import threading

from ..scene import _domes


class SceneState:
    """State of one scene in one session: the numbering of its edits, contiguous, one at a time; and
    its dome."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.session = 0
        self.next = 1
        self.dome = _domes.Last()
