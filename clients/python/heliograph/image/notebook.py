"""HTML of frames and scenes for notebooks. Called by their _repr_html_."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING, Any

from ..scene.handles import KINDS, Handle

if TYPE_CHECKING:
    from ..client.scene import Scene
    from ..render.frame import Frame

_ROWS = 500  # of a tree in a notebook; text has all


def html_of_frame(frame: Frame) -> str:
    """Picture of the frame's first plane, automatically exposed, and a line that describes it."""
    host = frame.cpu()
    description = (
        f"{frame.width} x {frame.height}, {frame.samples} samples per pixel, camera "
        f"{frame.camera or '?'}, revision {frame.revision}, seed {frame.seed}"
    )
    figure = ""
    if frame.planes:
        png = base64.b64encode(host.picture(exposure="auto").png()).decode()
        figure = f'<img style="max-width:100%" alt="" src="data:image/png;base64,{png}">'
    planes = ", ".join(
        f"<code>{escape(name)}</code> {'x'.join(map(str, host[name].shape))} {host[name].dtype}"
        for name in frame
    )
    small = "font-size:85%;opacity:.75"
    return f'<figure>{figure}<div style="{small}">{escape(description)}<br>{planes}</div></figure>'


class Tree:
    """Objects of a scene, entities under their parents. objects: ObjectInfo messages."""

    def __init__(self, objects: Any) -> None:
        self.children: dict[int, list[Any]] = {}
        for found in objects:
            self.children.setdefault(found.parent, []).append(found)

    def text(self) -> str:
        """Lists the objects, one per line, indented."""
        lines: list[str] = []

        def add(found: Any, depth: int) -> None:
            lines.append("  " * depth + _line_of(found))
            for child in self.children.get(found.id, ()):
                add(child, depth + 1)

        for found in self.children.get(0, ()):
            add(found, 0)
        return "\n".join(lines)

    def html(self) -> str:
        """Nested list whose parents fold; a long one is cut, with a remark."""
        self._left = _ROWS
        body = "".join(self._html(found) for found in self.children.get(0, ()))
        total = sum(len(listed) for listed in self.children.values())
        more = f"<div>and {total - _ROWS} more: scene.tree()</div>" if total > _ROWS else ""
        return f'<div style="line-height:1.5">{body or "empty"}{more}</div>'

    def _html(self, found: Any) -> str:
        if self._left <= 0:
            return ""
        self._left -= 1
        kind, _, rest = _line_of(found).partition(" ")
        row = f'<span style="opacity:.55">{kind}</span> {escape(rest)}'
        nested = "".join(self._html(child) for child in self.children.get(found.id, ()))
        indented = "margin-left:1.2em"
        if nested:
            return (
                f"<details open><summary>{row}</summary>"
                f'<div style="{indented}">{nested}</div></details>'
            )
        return f"<div>{row}</div>"


def kind_of(id: int) -> str:
    """ "entity", "mesh", ... of an object's id."""
    return KINDS.get(id >> 56, Handle).kind


def _line_of(found: Any) -> str:
    kind = kind_of(found.id)
    uses = f" ({found.uses} uses)" if kind not in ("entity", "object") else ""
    return f"{kind} {found.name or hex(found.id)}{uses}"


def html_of_scene(scene: Scene) -> str:
    """Its name, its revision, and its tree."""
    info = scene.describe(tree=True)
    title = f"<b>{escape(scene.name or 'scene')}</b> revision {info.scene.revision}"
    return f"<div>{title} of {escape(scene.client.address)}{Tree(info.objects).html()}</div>"
