"""Where things are in a draw: place() and pose() against what the daemon makes of the overlay."""

import itertools
import pathlib

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from balls import furnished
from drawing import drawn, seen

AT = hg.Pose((0, 0, 1), euler=(0.3, 0, 0), scale=2)


@pytest.fixture(scope="module")
def family(client):
    """A scene with a ball, its child and its grandchild; and where a draw wants them."""
    with client.create_scene() as scene:
        furnished(scene)
        with scene.edit() as edit:
            edit.entity("child", parent="ball/1", transform=AT)
            edit.entity("grandchild", parent="child", transform=AT)
        names = ("ball/1", "child", "grandchild")
        yield scene, {n: hg.Pose((i, 2, 3), euler=(1, i, 0)).matrix for i, n in enumerate(names)}


def in_world(scene, draw, names):
    with seen(scene, draw) as branch:
        return [branch[name].world_transform for name in names]


@pytest.mark.parametrize("count", [2, 3])
def test_what_is_placed_at_once_is_there_in_any_order(family, count):
    scene, wanted = family
    for names in itertools.permutations(wanted, count):
        poses = [wanted[name] for name in names]
        draw = drawn(scene, "cam", lambda draw, n=names, p=poses: draw.place(n, p))
        np.testing.assert_allclose(in_world(scene, draw, names), poses, atol=1e-5)
        drawn_poses = [draw.pose(name) for name in wanted]
        np.testing.assert_allclose(in_world(scene, draw, wanted), drawn_poses, atol=1e-5)


def test_what_a_draw_makes_has_its_place_in_the_world_below_any_parent(family):
    scene, _ = family
    bolt = pathlib.Path(__file__).parents[2] / "examples/assets/bolt/bolt.glb"
    made = {}

    def create(draw):
        edit = draw.edit
        made["a"] = edit.entity("a", parent="ball/1", transform=AT)
        nameless = edit.entity(parent=made["a"], transform=AT)
        twins = edit.instances("twin", mesh="mesh", transforms=[AT, AT], parent=nameless)
        made.update({"twin/0": twins[0], "twin/1": twins[1]})
        made["bolt"] = edit.import_file(bolt, name="bolt", parent="twin/1", transform=AT).root
        made["b"] = edit.entity("b", parent="bolt")
        edit.update(made["b"], parent="child", transform=AT)
        made["c"] = edit.entity("c", parent="b", transform=AT)
        edit.update("c", parent=None)
        made["ball/2"] = edit.entity("ball/2", parent="ball/0")  # it is in the scene

    def place(draw):
        draw.place([*made.values()][::-1], poses[::-1])

    draw = drawn(scene, "cam", create)
    poses = [draw.pose(thing) for thing in made.values()]
    np.testing.assert_allclose(in_world(scene, draw, made), poses, atol=1e-4)
    poses = [hg.Pose((i, 5, 5), euler=(0, 0, i)).matrix for i in range(len(made))]
    draw = drawn(scene, "cam", hd.Compose(create, place))
    np.testing.assert_allclose(in_world(scene, draw, made), poses, atol=1e-5)
    np.testing.assert_allclose([draw.pose(thing) for thing in made.values()], poses, atol=1e-5)


def test_a_pose_that_a_draw_cannot_know_is_refused(family):
    scene, _ = family

    def create(draw):
        keyed = draw.edit.entity("keyed", keys={0.0: hg.Pose(), 1.0: AT})
        many = draw.edit.instances("many", transforms=np.tile(np.eye(4), (1 << 15, 1, 1)))
        for thing in (keyed, many[7]):
            with pytest.raises(hg.InvalidArgument, match=r"^entity: .*not known here; place\(\)"):
                draw.pose(thing)
            draw.place(thing, [AT])
            np.testing.assert_allclose(draw.pose(thing), AT.matrix, atol=1e-6)

    drawn(scene, "cam", create)


def test_what_is_taken_back_has_its_parent_again(family):
    scene, _ = family

    def randomize(draw):
        before, mark = draw.pose("grandchild"), draw.mark()
        draw.edit.update("grandchild", parent="ball/0")
        assert not np.allclose(draw.pose("grandchild"), before)
        draw.rewind(mark)
        np.testing.assert_array_equal(draw.pose("grandchild"), before)

    drawn(scene, "cam", randomize)
