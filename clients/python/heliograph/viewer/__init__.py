"""A scene in a browser: Viewer serves one page on loopback. `heliograph view` runs it."""

from .gateway import Viewer

__all__ = ["Viewer"]
