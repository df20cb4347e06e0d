"""How bright nvisii's lights, domes, volumes and materials are, against formulas."""

import math

import numpy as np
import nvisii
import pytest
from nvisii_world import ball, rows

ALBEDO = 0.8


def middle(samples=64, size=17, seed=0):
    """(3,) mean of the middle 3x3 pixels."""
    image = rows(nvisii.render(size, size, samples, seed=seed), size, size)
    k = size // 2
    return image[k - 1 : k + 2, k - 1 : k + 2, :3].mean(axis=(0, 1))


@pytest.fixture
def floor(camera):
    """A matt floor seen from above, slantwise, in the dark."""
    nvisii.set_dome_light_color((0, 0, 0))
    camera.get_transform().look_at(eye=(0, -1.5, 1), at=(0, 0, 0), up=(0, 0, 1))
    camera.get_camera().set_fov(0.05, 1.0)
    return nvisii.entity.create(
        "floor",
        transform=nvisii.transform.create("floor"),
        mesh=nvisii.mesh.create_plane("floor", size=(5, 5)),
        material=nvisii.material.create("floor", specular=0, roughness=1),
    )


def lamp(size=0.05, **light):
    made = nvisii.entity.create(
        "lamp",
        transform=nvisii.transform.create("lamp", position=(0, 0, 2)),
        mesh=nvisii.mesh.create_plane("lamp", size=(size, size), flip_z=True),
        light=nvisii.light.create("lamp"),
    )
    made.get_light().set_intensity(light.get("intensity", 10))
    return made


def test_intensity_of_a_mesh_is_that_along_its_normal_whatever_its_area(floor):
    made = lamp()
    expected = ALBEDO / math.pi * 10 / 4
    assert middle() == pytest.approx([expected] * 3, rel=0.02)
    made.get_transform().set_scale((2, 2, 2))
    assert middle() == pytest.approx([expected] * 3, rel=0.02)
    made.get_light().set_exposure(1)
    made.get_light().set_color((1, 0.5, 0.25))
    assert middle() == pytest.approx([2 * expected, expected, expected / 2], rel=0.02)
    made.get_light().set_falloff(0)  # light falls off as it does
    assert middle()[0] == pytest.approx(2 * expected, rel=0.02)


def test_with_its_area_it_is_the_radiance(floor):
    lamp().get_light().use_surface_area(True)
    assert middle() == pytest.approx([ALBEDO / math.pi * 10 * 0.1**2 / 4] * 3, rel=0.02)


def test_a_light_without_a_mesh_is_a_small_lamp(floor):
    lamp().clear_mesh()
    assert middle() == pytest.approx([ALBEDO / math.pi * 10 / 4] * 3, rel=0.02)


def test_a_texture_colours_a_light(floor):
    made = lamp()
    texels = np.tile(np.array([1, 0, 0, 1], "f4"), 4)
    made.get_light().set_color_texture(nvisii.texture.create_from_data("t", 2, 2, texels, hdr=True))
    color = middle()
    assert color[0] > 0.5 and color[1] == color[2] == 0
    nvisii.texture.remove("t")
    assert middle()[1] > 0.5


def test_temperature_is_a_black_bodys_colour():
    light = nvisii.light.create_from_temperature("warm", 2700, 3)
    r, g, b = light.get_color()
    assert r == 1 and 0.4 < g < 0.7 and 0.05 < b < 0.25 and light.get_intensity() == 3
    light.set_temperature(12000)
    assert light.get_color().b == 1 and light.get_color().r < 0.8
    rgb = nvisii.light.create_from_rgb("rgb", (0.1, 0.2, 0.3), 2)
    assert rgb.get_color() == [0.1, 0.2, 0.3]
    with pytest.raises(RuntimeError, match="kelvin"):
        light.set_temperature(0)
    nvisii.clear_all()


def test_domes(camera):
    nvisii.set_dome_light_color((0.2, 0.4, 2))
    nvisii.set_dome_light_intensity(2)
    nvisii.set_dome_light_exposure(1)
    assert middle(1).tolist() == pytest.approx([0.8, 1.6, 4])
    nvisii.set_dome_light_intensity(-1)
    assert not middle(1).any()
    nvisii.set_dome_light_intensity(1)
    nvisii.set_dome_light_exposure(0)
    texels = np.zeros((8, 16, 4), "f4")
    texels[:, :8, 0], texels[:, 8:, 1] = 3, 5  # half of all directions red, half green
    texture = nvisii.texture.create_from_data("dome", 16, 8, texels, hdr=True)
    nvisii.set_dome_light_texture(texture, enable_cdf=True)
    ahead = middle(1)
    nvisii.set_dome_light_rotation(nvisii.angleAxis(math.pi, (0, 0, 1)))
    behind = middle(1)
    assert sorted(map(tuple, np.array([ahead, behind]).tolist())) == [(0, 5, 0), (3, 0, 0)]
    nvisii.clear_dome_light_texture()
    nvisii.set_dome_light_sky((0, 0, 10))
    blue = middle(1)
    nvisii.set_dome_light_sky((0, 0, 10), sky_tint=(1, 0.5, 0.5))
    assert blue[2] > blue[0] > 0 and middle(1)[0] == pytest.approx(2 * blue[0], rel=0.01)
    nvisii.set_dome_light_sky((0, 0, 10), saturation=0)
    grey = middle(1)
    assert grey.tolist() == pytest.approx([grey[0]] * 3, rel=0.01)
    nvisii.disable_dome_light_sampling()
    nvisii.enable_dome_light_sampling()
    with pytest.raises(RuntimeError, match="sun_position"):
        nvisii.set_dome_light_sky((0, 0, 0))


def test_light_falls_off_in_a_volume_by_beer_and_lambert(camera):
    fog = nvisii.volume.create_from_data("fog", 10, 10, 10, np.ones(1000), 0.0)
    fog.set_scattering(0)
    fog.set_absorption(0.1)
    thing = nvisii.entity.create(
        "fog",
        transform=nvisii.transform.create("fog", scale=(0.1, 0.1, 0.1)),
        volume=fog,
        material=nvisii.material.create("fog"),
    )
    assert middle(64, 33)[0] == pytest.approx(math.exp(-1), rel=0.03)
    thing.get_transform().set_scale((0.2, 0.2, 0.2))  # as many voxels
    assert middle(64, 33)[0] == pytest.approx(math.exp(-1), rel=0.03)
    fog.set_scale(2)
    assert middle(64, 33)[0] == pytest.approx(math.exp(-0.5), rel=0.03)
    assert nvisii.get_scene_max_aabb_corner() == pytest.approx([1, 1, 1])
    with pytest.raises(RuntimeError, match="has a volume"):
        thing.set_mesh(nvisii.mesh.create_box("box"))
    nvisii.set_max_bounce_depth(volume_depth=60)
    fog.set_scattering(0.4)
    fog.set_absorption(0)
    nvisii.material.get("fog").set_base_color((1, 1, 1))
    assert middle(64, 33)[0] == pytest.approx(1, rel=0.03)  # white fog in a white furnace


def test_volumes_know_their_voxels():
    ball = nvisii.volume.create_sphere("s")
    assert ball.get_max(3, 0) == 1 and ball.get_node_count(3) == 1 and ball.get_node_count(1) == 8
    assert ball.get_max_aabb_corner(3, 0) == pytest.approx([100, 100, 100], abs=1)
    assert ball.get_aabb_center(3, 0) == pytest.approx([0, 0, 0], abs=1)
    assert ball.get_grid_type() == "float" and ball.get_node_count(0) > 8000
    box = nvisii.volume.create_box("b", size=(20, 40, 60), center=(5, 0, 0))
    assert box.get_min_aabb_corner(3, 0) == pytest.approx([-5, -20, -30], abs=1)
    assert nvisii.volume.create_torus("t").get_max_aabb_corner(3, 0) == pytest.approx(
        [150, 50, 150], abs=1
    )
    assert nvisii.volume.create_octahedron("o").get_max(0, 0) > 0
    empty = nvisii.volume.create_from_data("e", 2, 1, 1, [0.5, 0.5], 0.5)
    assert empty.get_node_count(0) == 0
    with pytest.raises(RuntimeError, match="8 values, not 7"):
        nvisii.volume.create_from_data("x", 2, 2, 2, [1.0] * 7, 0.0)
    with pytest.raises(RuntimeError, match="node_idx"):
        ball.get_max(3, 1)
    nvisii.clear_all()


LOOKS = {
    "base_color": (0.1, 0.8, 0.1),
    "metallic": 1.0,
    "specular": 1.0,
    "roughness": 0.1,
    "alpha": 0.3,
    "sheen": 1.0,
    "clearcoat": 1.0,
    "transmission": 1.0,
    "subsurface": 1.0,
}
MODIFIERS = {
    "specular_tint": (1.0, {"base_color": (0.8, 0.1, 0.1), "specular": 1.0}),
    "sheen_tint": (0.0, {"base_color": (0.8, 0.1, 0.1), "sheen": 1.0}),
    "clearcoat_roughness": (0.8, {"clearcoat": 1.0}),
    "transmission_roughness": (0.7, {"transmission": 1.0, "roughness": 0.0}),
    "ior": (2.2, {"transmission": 1.0, "roughness": 0.0}),
    "anisotropic": (1.0, {"metallic": 1.0, "roughness": 0.4}),
    "anisotropic_rotation": (0.25, {"metallic": 1.0, "roughness": 0.4, "anisotropic": 1.0}),
    "subsurface_color": ((0.9, 0.1, 0.1), {"subsurface": 1.0}),
    "subsurface_radius": ((0.01, 0.01, 0.01), {"subsurface": 1.0}),
}


@pytest.fixture
def lit_ball(camera):
    """A ball under two lamps and a dim dome."""
    nvisii.set_dome_light_color((0.3, 0.3, 0.4))
    for i, x in enumerate((-1.5, 1.5)):
        made = nvisii.entity.create(
            f"lamp{i}",
            transform=nvisii.transform.create(f"lamp{i}", position=(x, -2.5, 2)),
            mesh=nvisii.mesh.create_sphere(f"lamp{i}", 0.3),
            light=nvisii.light.create(f"lamp{i}"),
        )
        made.get_light().set_intensity(40)
    return ball()


@pytest.mark.parametrize("name", [*LOOKS, *MODIFIERS])
def test_every_parameter_acts_as_a_constant_and_as_a_texture(lit_ball, name):
    value, others = (LOOKS[name], {}) if name in LOOKS else MODIFIERS[name]
    look = lit_ball.get_material()
    for other, given in others.items():
        getattr(look, f"set_{other}")(given)

    def image():
        return rows(nvisii.render(24, 24, 64, seed=1), 24, 24)[..., :3]

    before = image()
    old = getattr(look, f"get_{name}")()
    getattr(look, f"set_{name}")(value)
    constant = image()
    read = getattr(look, f"get_{name}")()
    assert (tuple(read) if isinstance(value, tuple) else read) == value
    assert np.abs(constant - before).mean() > 0.002
    getattr(look, f"set_{name}")(old)
    texel = [*value, 1] if isinstance(value, tuple) else [0, value, 0, 1]
    texture = nvisii.texture.create_from_data("t", 1, 1, texel, hdr=True)
    if name == "ior":  # beyond [0, 1], which a texture may hold
        assert texture.get_float_texels()[1] == pytest.approx(2.2)
    arguments = {} if isinstance(value, tuple) else {"channel": 1}
    getattr(look, f"set_{name}_texture")(texture, **arguments)
    textured = image()
    assert np.abs(textured - constant).mean() < 0.1 * np.abs(constant - before).mean() + 0.02
    getattr(look, f"clear_{name}_texture")()
    assert np.array_equal(image(), before)


def test_a_normal_map_tilts_the_surface(floor):
    lamp()
    straight = middle()[0]
    tilted = np.array([0.5 + 0.35, 0.5, 0.5 + 0.35, 1], "f4")  # 45 degrees towards +X
    floor.get_material().set_normal_map_texture(
        nvisii.texture.create_from_data("n", 1, 1, tilted, hdr=True)
    )
    assert middle()[0] == pytest.approx(straight * math.sqrt(0.5), rel=0.03)
    floor.get_material().clear_normal_map_texture()
    assert middle()[0] == pytest.approx(straight, rel=0.01)
