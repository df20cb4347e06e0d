"""Common behaviour of nvisii's components, and references of entities; it needs no daemon."""

import math

import numpy as np
import nvisii
import pytest

HALF = math.sqrt(0.5)
MAKERS = {
    "entity": lambda name: nvisii.entity.create(name),
    "transform": lambda name: nvisii.transform.create(name),
    "mesh": lambda name: nvisii.mesh.create_box(name),
    "material": lambda name: nvisii.material.create(name),
    "texture": lambda name: nvisii.texture.create_from_data(name, 1, 1, [0, 0, 0, 1]),
    "light": lambda name: nvisii.light.create(name),
    "camera": lambda name: nvisii.camera.create(name),
    "volume": lambda name: nvisii.volume.create_from_data(name, 1, 1, 1, [1.0], 0.0),
}


@pytest.fixture(autouse=True)
def empty():
    yield
    nvisii.clear_all()


@pytest.mark.parametrize("kind", MAKERS)
def test_every_kind_has_names_ids_and_marks(kind):
    cls, make = getattr(nvisii, kind), MAKERS[kind]
    a, b = make("a"), make("b")
    assert cls.get("a") is a and cls.get("c") is None and cls.get_count() == 2
    assert (a.get_name(), a.get_id(), b.get_id()) == ("a", 0, 1)
    assert cls.get_name_to_id_map() == {"a": 0, "b": 1}
    assert kind in a.to_string() and '"a"' in a.to_string() and a.is_initialized()
    assert a.is_dirty() and not a.is_clean() and cls.are_any_dirty()
    a.mark_clean()
    assert a.is_clean() and not a.is_dirty() and b.is_dirty()
    a.mark_dirty()
    assert a.is_dirty()
    with pytest.raises(RuntimeError, match="already exists"):
        make("a")
    with pytest.raises(RuntimeError, match="is a str"):
        make(3)
    cls.remove("a")
    assert cls.get("a") is None and not a.is_initialized() and cls.get_count() == 1
    if kind in ("material", "light", "camera"):
        with pytest.raises(RuntimeError, match=f"there is no {kind}"):
            cls.remove("a")
    else:
        cls.remove("a")
    cls.clear_all()
    assert cls.get_count() == 0


@pytest.mark.parametrize("kind", ["transform", "mesh", "material", "light", "camera", "volume"])
def test_an_entity_has_a_place_for_each_kind(kind):
    thing, part = nvisii.entity.create("e"), MAKERS[kind]("p")
    assert getattr(thing, f"get_{kind}")() is None
    getattr(thing, f"set_{kind}")(part)
    assert getattr(thing, f"get_{kind}")() is part
    getattr(thing, f"clear_{kind}")()
    assert getattr(thing, f"get_{kind}")() is None
    getattr(thing, f"set_{kind}")(part)
    getattr(nvisii, kind).remove("p")
    assert getattr(thing, f"get_{kind}")() is None
    with pytest.raises(RuntimeError, match="was removed"):
        getattr(thing, f"set_{kind}")(part)
    other = nvisii.entity.create("whole", **{kind: MAKERS[kind]("q")})
    assert getattr(other, f"get_{kind}")().get_name() == "q"


def test_a_mesh_or_a_volume():
    mesh, volume = MAKERS["mesh"]("m"), MAKERS["volume"]("v")
    with pytest.raises(RuntimeError, match="has a mesh"):
        nvisii.entity.create("e", mesh=mesh, volume=volume)
    assert nvisii.entity.get("e") is None
    thing = nvisii.entity.create("e", mesh=mesh)
    thing.clear_mesh()
    thing.set_volume(volume)
    assert thing.get_volume() is volume
    volume.set_gradient_factor(0.3)


def test_transforms_add_and_turn():
    made = nvisii.transform.create("t", scale=(1, 2, 3))
    made.add_scale((1, 1, 1))
    assert made.get_scale() == [2, 3, 4]
    made.add_rotation(nvisii.angleAxis(math.pi / 2, (0, 0, 1)))
    made.add_angle_axis(math.pi / 2, (0, 0, 1))
    assert made.get_right() == pytest.approx([-2, 0, 0])
    assert made.get_up() == pytest.approx([0, -3, 0]) and made.get_forward() == [0, 0, 4]
    parent = nvisii.transform.create("p", rotation=nvisii.quat(HALF, HALF, 0, 0))
    parent.add_child(made)
    assert made.get_parent() is parent
    assert made.get_world_right() == pytest.approx([-2, 0, 0])
    assert made.get_world_up() == pytest.approx([0, 0, -3])
    assert made.get_world_forward() == pytest.approx([0, -4, 0])
    back = made.inverse_transform_direction(made.transform_direction((1, 2, 3)))
    assert back == pytest.approx([1, 2, 3])
    for part in ("", "_translation", "_scale", "_rotation"):
        there = getattr(made, f"get_local_to_parent{part}_matrix")()
        again = getattr(made, f"get_parent_to_local{part}_matrix")()
        assert np.allclose(np.array(again * there), np.eye(4))
    world = made.get_world_to_local_matrix() * made.get_local_to_world_matrix()
    assert np.allclose(np.array(world), np.eye(4))
    parent.remove_child(made)
    assert made.get_parent() is None and parent.get_children() == []
    made.set_parent(parent)
    made.clear_parent()
    assert made.get_world_right() == pytest.approx([-2, 0, 0])


def test_lights_keep_what_they_are_given():
    light = nvisii.light.create("l")
    assert (light.get_color(), light.get_intensity()) == ([1, 1, 1], 1)
    assert (light.get_exposure(), light.get_falloff()) == (0, 2)
    light.set_exposure(2)
    light.set_falloff(1)
    assert (light.get_exposure(), light.get_falloff()) == (2, 1)
    texture = MAKERS["texture"]("t")
    light.set_color_texture(texture)
    light.clear_color_texture()
    assert light._used() == [] and light not in texture._users
    with pytest.raises(RuntimeError, match="below 0"):
        light.set_intensity(-1)


def test_old_names_of_textures(tmp_path):
    from PIL import Image

    Image.new("RGB", (3, 2), (10, 20, 30)).save(tmp_path / "p.png")
    old = nvisii.texture.create_from_image("o", str(tmp_path / "p.png"), linear=True)
    assert (old.get_width(), old.get_height(), old.is_linear()) == (3, 2, True)
    assert old.get_byte_texels()[:4].tolist() == [10, 20, 30, 255]


NAN = float("nan")


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: nvisii.transform.create("t", position=(NAN, 0, 0)), "position"),
        (lambda: nvisii.transform.create("t").set_scale((1, float("inf"), 1)), "scale"),
        (lambda: nvisii.transform.create("t").set_rotation(nvisii.quat(NAN, 0, 0, 0)), "rotation"),
        (lambda: nvisii.transform.create("t").set_transform(np.eye(4) * NAN, False), "transform"),
        (lambda: nvisii.material.create("m", roughness=NAN), "roughness"),
        (lambda: nvisii.material.create("m").set_base_color((0, NAN, 0)), "base_color"),
        (lambda: nvisii.light.create("l").set_intensity(float("inf")), "intensity"),
        (lambda: nvisii.light.create("l").set_exposure(100), "exposure"),
        (lambda: nvisii.light.create("l").set_color((-1, 0, 0)), "color"),
        (lambda: nvisii.camera.create("c").set_focal_distance(NAN), "distance"),
    ],
)
def test_what_no_picture_can_show_is_refused_where_it_is_given(call, argument):
    with pytest.raises(RuntimeError, match=f"^{argument}: "):
        call()


@pytest.mark.parametrize("name", ["add_position", "add_scale"])
def test_what_is_added_has_three_numbers(name):
    with pytest.raises(RuntimeError, match=f"additional_{name[4:]}: needs 3 numbers"):
        getattr(nvisii.transform.create("t"), name)((1, 2))


def test_exposures_that_no_float_holds():
    for put in (nvisii.light.create("l").set_exposure, nvisii.set_dome_light_exposure):
        for stops in (2000, -65):
            with pytest.raises(RuntimeError, match="exposure: .* outside"):
                put(stops)


def test_counts_are_whole():
    for call in (nvisii.set_max_bounce_depth, nvisii.set_light_sample_count):
        with pytest.raises(RuntimeError, match="2.5 is no whole number"):
            call(2.5)
    with pytest.raises(RuntimeError, match="glossy_depth: -1 is below 0"):
        nvisii.set_max_bounce_depth(1, -1)
    with pytest.raises(RuntimeError, match="width: -2 is below 1"):
        nvisii.volume.create_from_data("v", -2, -2, 1, [0] * 4, 0)
    with pytest.raises(RuntimeError, match="half_width: 0 is not above 0"):
        nvisii.volume.create_box("v", half_width=0)


def test_a_transform_keeps_its_own_rotation():
    turn = nvisii.angleAxis(1, (0, 0, 1))
    place = nvisii.transform.create("t", rotation=turn)
    turn.x = 5
    assert place.get_rotation().x == 0
