"""The same bytes in another shape are another thing: nothing that was derived from one is used for
the other."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest
from heliograph.client.edit import Edits

CAMERA = hg.Camera.from_fov(60, 32, 24, degrees=True)
ABOVE = hg.look_at((0, -0.01, 6), (0, 0, 0))


def picture(client, build, textures):
    """Picture of the last of the textures, where all were rendered before."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("plane", **hg.shapes.plane(4.0))
            edit.entity("floor", mesh="plane", material=edit.material("grey"))
            edit.entity("cam", camera=CAMERA, transform=ABOVE)
        for i, texels in enumerate(textures):
            with scene.edit() as edit:
                build(edit, edit.texture(f"texture{i}", texels))
            frame = scene.render("cam", spp=16)
        return frame["beauty"]


def sky(edit, texture):
    edit.dome(None)
    edit.dome(texture)


def paint(edit, texture):
    edit.material("grey", base_color=texture, unlit=True)


def suns():
    texels = np.full((256, 512, 3), 0.01, "f4")
    texels[40:44, 100:110] = 2000
    return texels, texels.reshape(512, 256, 3)


def stripes():
    texels = (np.arange(512 * 3072) % 3072 < 1536).astype("u1") * np.uint8(255)
    return texels.reshape(1536, 1024), texels.reshape(512, 3072)


@pytest.mark.parametrize(("build", "shapes"), [(sky, suns()), (paint, stripes())])
def test_a_texture_of_another_shape(client, build, shapes):
    made = picture(client, build, shapes)
    with hg.connect() as fresh:
        alone = picture(fresh, build, shapes[-1:])
    assert np.array_equal(made, alone)


def test_a_light_with_more_parts(client, monkeypatch):
    count = 320
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, count), np.linspace(-0.5, 0.5, count))
    positions = np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype("f4")
    number = np.arange(count * count).reshape(count, count)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    halves = [np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    lamp = {"positions": positions, "indices": np.concatenate(halves).astype("u4")}
    monkeypatch.setattr(Edits, "edited", Edits.asset)  # equal arrays are one blob
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("sheet", **lamp)
            light = hg.Light(power=10, two_sided=True)
            edit.entity("lamp", mesh="sheet", transform=hg.Pose((0, 0, 1)), light=light)
            edit.entity("cam", camera=CAMERA, transform=ABOVE)
        before = scene.render("cam", spp=4)["beauty"]
        with scene.edit() as edit:
            edit.mesh("sheet", **lamp, part_names=[f"part {i}" for i in range(50_000)])
        assert np.allclose(scene.render("cam", spp=4)["beauty"], before, rtol=1e-5)
