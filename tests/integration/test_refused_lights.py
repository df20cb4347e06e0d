"""Lights that make no sense, through the Python client: one row each."""

import heliograph as hg
import pytest
from refusals import check, dome, edited, entity

INVALID = hg.InvalidArgument

# Row -> (error, field, what else the message says, call).
LIGHTS = {
    "light groups": (
        INVALID,
        "light_group",
        "256",
        entity(light_group="x" * 257),
    ),
    "intensity of a mesh": (INVALID, "light.unit", "shape", entity(light=hg.Light(candela=3))),
    "irradiance of a disc": (
        INVALID,
        "light.unit",
        "suns",
        entity(light=hg.Light(irradiance=3, shape="disc")),
    ),
    "radius of a mesh": (INVALID, "light.radius", "", entity(light=hg.Light(power=3, radius=1))),
    "width of a disc": (
        INVALID,
        "light.width",
        "rectangles",
        entity(light=hg.Light(power=3, shape="disc", width=1)),
    ),
    "cone of a mesh": (
        INVALID,
        "light.outer_cone_angle",
        "shape",
        entity(light=hg.Light(power=3, outer_cone_angle=1)),
    ),
    "inner cone alone": (
        INVALID,
        "light.inner_cone_angle",
        "outer_cone_angle",
        entity(light=hg.Light(power=3, shape="disc", inner_cone_angle=1)),
    ),
    "inner beyond outer": (
        INVALID,
        "light.inner_cone_angle",
        "",
        entity(
            light=hg.Light(power=3, shape="disc", inner_cone_angle=1, outer_cone_angle=0.5),
        ),
    ),
    "a sun with a shape": (
        INVALID,
        "light.shape",
        "sun",
        entity(light=hg.Light(radiance=3, shape="disc", sun_angle=0.1)),
    ),
    "a shape with a mesh": (
        INVALID,
        "light.shape",
        "two entities",
        edited(lambda e: e.update("ball", light=hg.Light(power=3, shape="sphere"))),
    ),
    "a shape with a material": (
        INVALID,
        "materials",
        "mesh",
        entity(light=hg.Light(power=3, shape="sphere"), material="gold"),
    ),
    "light shape": (INVALID, "light.shape", "disc", entity(light=hg.Light(power=3, shape="cube"))),
    "radius 0": (
        INVALID,
        "light.radius",
        "",
        entity(light=hg.Light(power=3, shape="sphere", radius=0)),
    ),
    "a profile of a mesh": (
        INVALID,
        "light.profile",
        "small sphere",
        entity(light=hg.Light(power=3, profile="dots")),
    ),
    "a profile's scale without one": (
        INVALID,
        "light.unit",
        "with a profile",
        entity(light=hg.Light(profile_scale=1, shape="disc")),
    ),
    "radiance of a profile": (
        INVALID,
        "light.unit",
        "candela",
        entity(light=hg.Light(radiance=3, shape="disc", profile="dots")),
    ),
    "a profile in a cone": (
        INVALID,
        "light.outer_cone_angle",
        "profile",
        entity(light=hg.Light(shape="disc", profile="dots", outer_cone_angle=1)),
    ),
    "a profile that is a mesh": (
        INVALID,
        "light.profile",
        "texture",
        entity(light=hg.Light(shape="disc", profile="tri")),
    ),
    "portal width": (INVALID, "portal.width", "", entity(portal=hg.Portal(width=0))),
    "portal height": (INVALID, "portal.height", "", entity(portal=hg.Portal(height=2e6))),
    "a portal that is a light": (
        INVALID,
        "portal",
        "hg.Portal",
        entity(portal=hg.Light(power=1)),
    ),
    "light group 7": (INVALID, "light_group", "str", entity(light_group=7)),
    "dome group": (INVALID, "light_group", "256", dome(light_group="x" * 257)),
    "dome power": (INVALID, "power", "no 'power'", dome(power=3)),
}


@pytest.mark.parametrize("row", LIGHTS)
def test_refused(world, row):
    kind, field, message, call = LIGHTS[row]
    check(world, call, (kind, field), message)
