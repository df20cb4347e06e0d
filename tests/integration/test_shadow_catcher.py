"""The plane shadow_catcher: what other entities take from a stand-in's light, by arithmetic."""

import heliograph as hg
import numpy as np
import pytest

QUAD = {
    "positions": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
    "indices": [[0, 1, 2], [0, 2, 3]],
}
SIZE = (60, 40)


@pytest.fixture
def table(client):
    """A catcher of 10 m at z = 0 seen straight from above, 0.1 m a pixel, and a card above it."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            quad = edit.mesh("quad", **QUAD)
            edit.entity("table", mesh=quad, transform=hg.Pose(scale=5), shadow_catcher=True)
            edit.entity("card", mesh=quad, transform=hg.Pose((0, 0, 1), scale=(0.5, 0.5, 1)))
            view = hg.look_at((0, 0, 5), (0, 0, 0), up=(0, 1, 0))
            edit.entity("cam", camera=hg.Camera.orthographic(10, *SIZE), transform=view)
            sun = hg.Light(irradiance=1, sun_angle=0.002)
            edit.entity("sun", light=sun, transform=hg.look_at((2, 0, 1), (0, 0, 0)))
        yield scene


def coordinates():
    """x and y of the pixels' centres on the table, (H, W) each."""
    x = (np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2) / 10
    y = (SIZE[1] / 2 - np.arange(SIZE[1]) - 0.5) / 10
    return np.meshgrid(x, y)


def square_at(x0, half, margin=0.0):
    x, y = coordinates()
    return (np.abs(x - x0) < half - margin) & (np.abs(y) < half - margin)


def test_a_sun_casts_the_shadow_where_it_must(table):
    """The sun stands at (2, 0, 1): the shadow of a card at height 1 lies 2 m to -x."""
    frame = table.render(
        "cam",
        planes=["beauty", "shadow_catcher", "instance"],
        spp=32,
        filter="box",
        transparent_background=True,
    )
    shadow = frame["shadow_catcher"]
    assert shadow[square_at(-2, 0.5, 0.06)].max() == 0
    card = square_at(0, 0.5, -0.06)
    assert (shadow[~square_at(-2, 0.5, -0.06) & ~card] == 1).all()
    assert (shadow[square_at(0, 0.5, 0.06)] == 1).all()  # there the card is seen, not the table
    # The table is in no other plane: nothing but the card has coverage or a label.
    alpha = frame["beauty"][..., 3]
    assert alpha[square_at(0, 0.5, 0.06)].min() == 1 and alpha[~card].max() == 0
    assert (frame["instance"] == 0)[~card].all()


def test_without_others_or_without_light_it_is_one(table):
    with table.overlay() as alone:
        alone.update("card", visible=False)
    with table.overlay() as dark:
        dark.update("sun", visible=False)
    for overlay in (alone, dark):
        frame = table.render("cam", planes=["shadow_catcher"], spp=8, overlay=overlay)
        assert (frame["shadow_catcher"] == 1).all()


def test_under_a_sky_it_is_the_open_share_of_the_hemisphere(table):
    """Below the middle of a square of side 1 at height 1, whose form factor is 0.2395."""
    with table.overlay() as overcast:
        overcast.update("sun", visible=False)
        overcast.dome(color=1)
        overcast.update("cam", transform=hg.look_at((0, 0, 0.5), (0, 0, 0), up=(0, 1, 0)))
        overcast.update("cam", camera=hg.Camera.orthographic(400, 16, 16))
    frame = table.render("cam", planes=["shadow_catcher"], spp=1024, overlay=overcast)
    half = 0.5
    form = 4 / np.pi * half / np.hypot(1, half) * np.arctan(half / np.hypot(1, half))
    assert frame["shadow_catcher"].mean() == pytest.approx(1 - form, abs=0.004)


def test_catchers_still_shade_and_reflect(table):
    """Light that the card receives from below comes off the table."""
    with table.overlay() as below:
        below.update("cam", transform=hg.look_at((0, 0, 0.9), (0, 0, 2), up=(0, 1, 0)))
        below.update("sun", transform=hg.look_at((0.6, 0, 1), (0, 0, 0)))
    with table.overlay() as gone:
        gone.update("cam", transform=hg.look_at((0, 0, 0.9), (0, 0, 2), up=(0, 1, 0)))
        gone.update("sun", transform=hg.look_at((0.6, 0, 1), (0, 0, 0)))
        gone.update("table", visible=False)
    with_table = table.render("cam", spp=64, overlay=below)["beauty"][10:30, 20:40, 1].mean()
    without = table.render("cam", spp=64, overlay=gone)["beauty"][10:30, 20:40, 1].mean()
    assert without == 0 and with_table > 0.01
