"""URDF files that tests write."""

import heliograph as hg
import pytest
from heliograph.robots import urdf

LIMIT = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
BOX = '<visual><geometry><box size="1 2 3"/></geometry></visual>'


def written(path, body, head="<robot name='r'>"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"{head}{body}</robot>")
    return path


def mesh(reference, scale=""):
    return f'<visual><geometry><mesh filename="{reference}"{scale}/></geometry></visual>'


def link(*visuals, name="a"):
    return f'<link name="{name}">{"".join(visuals)}</link>'


def joint(kind, inner="", name="j", ends="ab"):
    tree = f'<parent link="{ends[0]}"/><child link="{ends[1]}"/>'
    return f'<joint name="{name}" type="{kind}">{tree}{inner}</joint>'


def strictly_refused(path, message, error=hg.InvalidArgument):
    with pytest.raises(error, match=message):
        urdf.read(path, {}, strict=True)


def stl(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("solid\nendsolid\n")
    return path
