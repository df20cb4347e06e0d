"""Joints of USD stages in a real daemon: against matrices that are multiplied here, and pxr."""

import math

import heliograph as hg
import numpy as np
import pytest

pytest.importorskip("pxr", reason="the extra `usd` is not installed")
from jointed_stages import METRES, Jointed, about, any_turn, in_metres, pose
from pxr import Sdf, UsdGeom, UsdPhysics

ARM = "/World/Arm"
BODIES = [f"{ARM}/{name}" for name in ("base", "upper", "slide", "ball")]


def put(scene, path, **options):
    with scene.edit() as edit:
        return edit.import_usd(path, name="it", **options)


def two(made, kind, freedom, **more):
    """A body that a joint of one kind moves in another: where it is at a freedom (4, 4)."""
    made.body("/A", pose())
    made.body("/B", made.frames["/A"] @ freedom)
    return made.joint(kind, "/joint", ("/A", "/B"), **more)


# ---------------------------------------------------------------- where links are


class Chain:
    """Scaled bodies beneath a scaled, turned prim: one turns about Y, one slides along X, one turns
    freely. Places and turns of the joints are arbitrary."""

    def __init__(self, folder):
        rng = np.random.default_rng(8)
        self.made = Jointed(folder)
        self.made.group("/World")
        self.made.group(ARM, pose((3, 1, 2), any_turn(rng)) @ np.diag([2, 0.5, 3, 1]))
        self.places = rng.uniform(-20, 20, (3, 2, 3))
        self.turns = [(any_turn(rng), any_turn(rng)) for _ in range(3)]
        scales = [(1, 1, 1), (0.2, 2, 1), (3, 0.5, 0.5), (1, 1, 4)]
        self.made.scales.update(zip(BODIES, map(np.array, scales), strict=True))
        self.base = pose((40, 10, -5), any_turn(rng))
        self.rest = {"turn": 0.7, "slide": 0.08, "free": any_turn(rng)}
        for body, frame in zip(BODIES, self.frames(self.rest), strict=True):
            self.made.body(body, frame, self.made.scales[body])
        kinds = [("RevoluteJoint", "turn"), ("PrismaticJoint", "slide"), ("SphericalJoint", "free")]
        for i, (kind, name) in enumerate(kinds):
            sides = self.places[i], self.turns[i]
            joint = self.made.joint(kind, f"{ARM}/joints/{name}", BODIES[i : i + 2], *sides)
            joint.CreateAxisAttr("Y" if name == "turn" else "X")
            if name == "turn":
                joint.CreateLowerLimitAttr(-90.0)
                joint.CreateUpperLimitAttr(120.0)
            if name == "slide":
                joint.CreateUpperLimitAttr(50.0)

    def frames(self, values, sense=1.0):
        """root_from_body of each, in the stage. sense: -1 where a joint is written backwards."""
        free = values["free"]
        moves = [
            pose(turn=about("Y", sense * values["turn"])),
            pose((sense * values["slide"] / METRES, 0, 0)),
            pose(turn=free),
        ]
        out = [self.base]
        for i, move in enumerate(moves):
            first, second = (
                self.made.frame(BODIES[i + side], self.places[i][side], self.turns[i][side])
                for side in (0, 1)
            )
            out.append(out[-1] @ first @ move @ np.linalg.inv(second))
        return out


def assert_seen(asset, chain, frames):
    for body, frame in zip(BODIES, frames, strict=True):
        expected = in_metres(frame)
        robot = asset.robots[ARM]
        np.testing.assert_allclose(
            robot.links[robot.bodies[body]].world_transform, expected, atol=1e-5
        )
        scaled = expected @ np.diag([*(METRES * chain.made.scales[body]), 1])
        np.testing.assert_allclose(asset.entities[body].world_transform, scaled, atol=1e-5)


def test_links_are_where_matrices_have_them_in_scaled_bodies_and_other_units(scene, tmp_path):
    chain = Chain(tmp_path)
    asset = put(scene, chain.made.saved())
    robot = asset.robots[ARM]
    assert asset.warnings == [] and robot.name == f"it/robots{ARM}"
    assert robot.joint_names == ["turn", "slide", *(f"free/q{i}" for i in "wxyz")]
    np.testing.assert_allclose(robot.limits[0], np.radians([-90, 120]), rtol=1e-6)
    np.testing.assert_allclose(robot.limits[1], [-math.inf, 0.5], rtol=1e-6)
    np.testing.assert_allclose(robot.rest[:2], [0.7, 0.08], atol=1e-5)
    assert_seen(asset, chain, chain.frames(chain.rest))  # the stage as it is
    rng = np.random.default_rng(2)
    for _ in range(3):
        values = {
            "turn": rng.uniform(-1, 2),
            "slide": rng.uniform(-0.5, 0.5),
            "free": any_turn(rng),
        }
        with scene.edit() as edit:
            edit.set_joints(robot, values)
        assert_seen(asset, chain, chain.frames(values))
        base = np.linalg.inv(in_metres(chain.base))
        found = dict(zip(robot.link_names, robot.forward(values), strict=True))
        for body, frame in zip(BODIES, chain.frames(values), strict=True):
            expected = base @ in_metres(frame)
            np.testing.assert_allclose(found[robot.bodies[body]], expected, atol=1e-6)


def test_joints_written_from_the_lower_body_keep_their_sense(scene, tmp_path):
    """body0 is the lower one: a turn by +q of body1 in body0 turns the lower one by -q. But what
    turns freely has the value of the lower one in the upper."""
    chain = Chain(tmp_path)
    stage = chain.made.stage
    for name in ("turn", "slide", "free"):
        prim = stage.GetPrimAtPath(f"{ARM}/joints/{name}")
        for what in ("body0 body1", "localPos0 localPos1", "localRot0 localRot1"):
            first, second = (prim.GetProperty(f"physics:{part}") for part in what.split())
            if "body" in what:
                ends = first.GetTargets(), second.GetTargets()
                first.SetTargets(ends[1]), second.SetTargets(ends[0])
            else:
                ends = first.Get(), second.Get()
                first.Set(ends[1]), second.Set(ends[0])
    UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath(BODIES[0]))
    asset = put(scene, chain.made.saved())
    robot = asset.robots[ARM]
    np.testing.assert_allclose(robot.rest[:2], [-0.7, -0.08], atol=1e-5)
    assert_seen(asset, chain, chain.frames(chain.rest))
    values = {"turn": 0.3, "slide": -0.2, "free": about("Y", 0.8)}
    with scene.edit() as edit:
        edit.set_joints(robot, values)
    assert_seen(asset, chain, chain.frames(values, sense=-1.0))


def test_generic_joints_slide_first_and_turn_about_x_y_z(scene, tmp_path):
    made = Jointed(tmp_path)
    moved = pose((0, 3, 0), about("X", 0.2) @ about("Y", -0.4) @ about("Z", 0.6))
    prim = two(made, "Joint", moved).GetPrim()
    for token, (low, high) in {
        **{"transX": (1, -1), "transY": (-5, 5), "transZ": (1, -1)},
        **{"rotX": (-45, 45), "rotY": (-60, 60), "rotZ": (-90, 90)},
    }.items():
        limit = UsdPhysics.LimitAPI.Apply(prim, token)
        limit.CreateLowAttr(low)
        limit.CreateHighAttr(high)
    robot = put(scene, made.saved()).robots["/A"]
    assert robot.joint_names == [f"joint:{t}" for t in ("transY", "rotX", "rotY", "rotZ")]
    np.testing.assert_allclose(robot.rest, [0.03, 0.2, -0.4, 0.6], atol=1e-6)
    q = [-0.02, 0.5, 0.7, -1.1]
    turn = about("X", 0.5) @ about("Y", 0.7) @ about("Z", -1.1)
    np.testing.assert_allclose(robot.forward(q)[-1], pose((0, -0.02, 0), turn), atol=1e-6)


def test_a_joint_to_the_world_moves_and_a_fixed_one_holds(scene, tmp_path):
    made = Jointed(tmp_path)
    made.body("/Door", pose((100, 0, 0)))
    hinge = made.joint("RevoluteJoint", "/hinge", ("", "/Door"), ((100, 0, 0), (0, 0, 0)))
    hinge.CreateAxisAttr("Y")  # up, in this stage
    made.body("/Base", pose((0, 0, 300)))
    made.body("/Wheel", pose((0, 0, 300)))
    made.joint("FixedJoint", "/hold", ("", "/Base"))
    made.joint("RevoluteJoint", "/axle", ("/Base", "/Wheel"))
    asset = put(scene, made.saved())
    door, wheel = asset.robots["/Door"], asset.robots["/Base"]
    assert door.link_names == ["world", "Door"] and wheel.link_names == ["Base", "Wheel"]
    assert asset.warnings == []
    with scene.edit() as edit:
        edit.set_joints(door, {"hinge": math.pi / 2})
    found = asset.entities["/Door"].world_transform
    np.testing.assert_allclose(found[:3, 3], (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(found[:3, 0], (0, METRES, 0), atol=1e-8)  # +X to +Y about +Z
    np.testing.assert_allclose(
        asset.entities["/Base"].world_transform[:3, 3], (0, -3, 0), atol=1e-6
    )


def test_several_joints_of_two_bodies_go_one_after_another(scene, tmp_path):
    """As exporters of MuJoCo's hinges write them."""
    made = Jointed(tmp_path)
    made.body("/A", pose())
    made.body("/B", pose((0, 0, 5)))
    for name, axis in (("swing", "X"), ("lift", "Y")):
        joint = made.joint("RevoluteJoint", f"/{name}", ("/A", "/B"), ((0, 0, 5), (0, 0, 0)))
        joint.CreateAxisAttr(axis)
    asset = put(scene, made.saved())
    robot = asset.robots["/A"]
    assert robot.joint_names == ["swing", "lift"] and asset.warnings == []
    expected = pose((0, 0, 0.05), about("X", 0.3) @ about("Y", 0.9))
    np.testing.assert_allclose(robot.forward([0.3, 0.9])[-1], expected, atol=1e-6)


def test_prims_of_one_name_are_called_by_their_paths(scene, tmp_path):
    """Each body has a joint of the same name beneath it, fixed and not, and one a body's name."""
    made = Jointed(tmp_path)
    bodies = ["/Base", "/Left/hand", "/Right/hand", "/Left/tip", "/Right/tip"]
    for body in bodies:
        made.body(body, pose())
    for side in ("Left", "Right"):
        made.joint("RevoluteJoint", f"/{side}/hand/joint", ("/Base", f"/{side}/hand"))
        made.joint("FixedJoint", f"/{side}/tip/joint", (f"/{side}/hand", f"/{side}/tip"))
    asset = put(scene, made.saved())
    robot = asset.robots["/Base"]
    assert robot.joint_names == ["Left/hand/joint", "Right/hand/joint"]
    assert robot.link_names == ["Base", "Left/hand", "Left/tip", "Right/hand", "Right/tip"]
    with scene.edit() as edit:
        edit.set_joints(robot, {"Right/hand/joint": 0.5})
    turned = in_metres(pose(turn=about("X", 0.5)))
    found = {body: robot.links[robot.bodies[body]].world_transform for body in bodies}
    np.testing.assert_allclose(found["/Right/tip"], turned, atol=1e-6)
    np.testing.assert_allclose(found["/Left/tip"], in_metres(pose()), atol=1e-6)


def test_copies_of_one_robot_are_each_their_own(scene, tmp_path):
    """A reference to the robot's file, twice, one of them as scenegraph instance."""
    chain = Chain(tmp_path)
    chain.made.stage.SetDefaultPrim(chain.made.stage.GetPrimAtPath("/World"))
    file = chain.made.saved()
    room = Jointed(tmp_path)
    for name, at in {"one": 500, "two": -500}.items():
        prim = room.group(f"/Room/{name}", pose((at, 0, 0)))
        prim.GetReferences().AddReference(str(file))
        prim.SetInstanceable(name == "two")
    asset = put(scene, room.saved())
    one, two = (asset.robots[f"/Room/{name}/Arm"] for name in ("one", "two"))
    values = {"turn": 1.1, "slide": -0.1, "free": np.eye(3)}
    with scene.edit() as edit:
        edit.set_joints(two, values)
    for robot, at, expected in ((one, 500, chain.rest), (two, -500, values)):
        frame = pose((at, 0, 0)) @ chain.frames(expected)[-1]
        np.testing.assert_allclose(robot.links["ball"].world_transform, in_metres(frame), atol=2e-5)
    assert asset.warnings == []


# ---------------------------------------------------------------- values and what is left out


def test_states_come_before_places_and_drives_are_keyframes(scene, tmp_path):
    made = Jointed(tmp_path)
    prim = two(made, "RevoluteJoint", pose(turn=about("X", 0.25))).GetPrim()
    float_type = Sdf.ValueTypeNames.Float
    drive = UsdPhysics.DriveAPI.Apply(prim, "angular")
    drive.CreateTargetPositionAttr(30.0)
    drive.CreateStiffnessAttr(10.0)
    asset = put(scene, made.saved())
    np.testing.assert_allclose(asset.robots["/A"].rest, [0.25], atol=1e-6)
    np.testing.assert_allclose(asset.robots["/A"].keyframes["targets"], [math.pi / 6], rtol=1e-6)
    prim.CreateAttribute("state:angular:physics:position", float_type).Set(-45.0)
    with scene.edit() as edit:
        stated = edit.import_usd(made.saved(), name="stated")
    np.testing.assert_allclose(stated.robots["/A"].rest, [-math.pi / 4], rtol=1e-6)
    turned = stated.robots["/A"].links["B"].world_transform
    expected = in_metres(pose(turn=about("X", -math.pi / 4)))
    np.testing.assert_allclose(turned, expected, atol=1e-6)
    assert stated.warnings == ["/joint: its state says other than its bodies' places: it counts"]


@pytest.mark.parametrize("schema", ["newton", "physx"])
def test_mimics_follow_with_gear_and_offset_in_degrees(scene, tmp_path, schema):
    made = Jointed(tmp_path)
    for name in "ABC":
        made.body(f"/{name}", pose())
    made.joint("RevoluteJoint", "/lead", ("/A", "/B"))
    prim = made.joint("RevoluteJoint", "/follow", ("/A", "/C")).GetPrim()
    float_type = Sdf.ValueTypeNames.Float
    if schema == "newton":
        prim.CreateRelationship("newton:mimicJoint").SetTargets(["/lead"])
        prim.CreateAttribute("newton:mimicCoef0", float_type).Set(10.0)
        prim.CreateAttribute("newton:mimicCoef1", float_type).Set(-2.0)
    else:  # follow + gearing lead + offset = 0
        prim.CreateRelationship("physxMimicJoint:rotX:referenceJoint").SetTargets(["/lead"])
        prim.CreateAttribute("physxMimicJoint:rotX:gearing", float_type).Set(2.0)
        prim.CreateAttribute("physxMimicJoint:rotX:offset", float_type).Set(-10.0)
    robot = put(scene, made.saved()).robots["/A"]
    assert robot.joint_names == ["lead"]
    found = robot.forward([0.4])[robot.link_names.index("C")]
    expected = pose(turn=about("X", math.radians(10) - 0.8))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_what_is_no_part_of_an_articulation_is_named(scene, tmp_path):
    made = Jointed(tmp_path)
    for i, name in enumerate("ABCD"):
        made.body(f"/{name}", pose((10 * i, 0, 0)))
    near = ((10, 0, 0), (0, 0, 0))
    for name in ("AB", "BC", "CD"):
        made.joint("RevoluteJoint", f"/{name}", (f"/{name[0]}", f"/{name[1]}"), near)
    made.joint("RevoluteJoint", "/loop", ("/D", "/A"), ((-30, 0, 0), (0, 0, 0)))
    excluded = made.joint("FixedJoint", "/excluded", ("/A", "/C"))
    excluded.CreateExcludeFromArticulationAttr(True)
    made.joint("FixedJoint", "/off", ("/A", "/D")).CreateJointEnabledAttr(False)
    made.joint("FixedJoint", "/lost", ("/A", "/Nowhere"))
    made.joint("DistanceJoint", "/rope", ("/A", "/D"))
    made.joint("FixedJoint", "/nan", ("/A", "/D"), ((math.nan, 0, 0), (0, 0, 0)))
    made.joint("FixedJoint", "/alone", ("/A", ""))
    made.joint("RevoluteJoint", "/none", ("", ""))
    asset = put(scene, made.saved())
    assert asset.robots["/A"].joint_names == ["AB", "BC", "CD"]
    assert set(asset.warnings) == {
        "/loop: a joint that closes a loop is left out",
        "/excluded: a joint that is excluded from its articulation is left out",
        "/off: a joint that is not enabled is left out",
        "/lost and 1 more: a joint whose body is not there, or whose frame is not finite, is left "
        "out",
        "/none: a joint that connects no two bodies is left out",
        "/rope: PhysicsDistanceJoint is left out",
    }


def test_bodies_that_a_joint_does_not_hold_are_put_there(scene, tmp_path):
    made = Jointed(tmp_path)
    two(made, "RevoluteJoint", pose((0, 50, 0)))
    asset = put(scene, made.saved())
    assert asset.warnings == ["/joint: its bodies are not where it has them: they are put there"]
    np.testing.assert_allclose(asset.entities["/B"].world_transform[:3, 3], 0, atol=1e-6)


def test_bodies_that_move_by_themselves_are_no_robot(scene, tmp_path):
    made = Jointed(tmp_path)
    two(made, "RevoluteJoint", pose())
    [op] = UsdGeom.Xformable(made.stage.GetPrimAtPath("/B")).GetOrderedXformOps()
    for code in (0, 24):
        op.Set(op.Get(), code)
    path = made.saved()
    moving = put(scene, path, times="all")
    assert moving.robots == {}
    assert moving.warnings == [
        "/A: its joints are left out: /B moves by itself; without times= it does not"
    ]
    with scene.edit() as edit:
        assert list(edit.import_usd(path, name="still").robots) == ["/A"]


# ---------------------------------------------------------------- in a scene


def test_links_are_parts_and_copies_share(scene, tmp_path):
    chain = Chain(tmp_path)
    prim = chain.made.stage.GetPrimAtPath(ARM)
    prim.CreateAttribute("semantics:labels:class", Sdf.ValueTypeNames.TokenArray).Set(["arm"])
    asset = put(scene, chain.made.saved())
    robot = asset.robots[ARM]
    with scene.edit() as edit:
        again = edit.import_usd(asset, name="again", transform=hg.Pose((20, 0, 0)))
        middle = robot.links["ball"].world_transform[:3, 3]
        eye = hg.look_at(middle + (0, -0.3, 0.1), middle)
        edit.entity("cam", camera=hg.Camera.from_fov(60, 64, 64, degrees=True), transform=eye)
        edit.set_joints([robot, again.robots[ARM]], np.tile(robot.rest, (2, 1)))
    assert again.entities[BODIES[1]].mesh == asset.entities[BODIES[1]].mesh
    offset = again.robots[ARM].links["ball"].world_transform - robot.links["ball"].world_transform
    np.testing.assert_allclose(offset[:3, 3], (20, 0, 0), atol=1e-5)
    frame = scene.render("cam", spp=1, planes=["part", "instance"], labels={"keypoints": True})
    row = list(frame.labels["name"]).index(robot.name)
    assert frame.categories[frame.labels["category"][row]] == "arm"
    mine = frame["instance"] == frame.labels["label"][row]
    seen = set(robot.link_of(frame["part"][mine]).tolist())
    assert robot.link_names.index("ball") in seen and -1 not in seen


def test_what_hides_a_body_still_does(scene, tmp_path):
    made = Jointed(tmp_path)
    hidden = made.group("/Hidden")
    UsdGeom.Imageable(hidden).MakeInvisible()
    made.body("/A", pose())
    made.body("/Hidden/B", pose((0, 10, 0)))
    made.joint("PrismaticJoint", "/joint", ("/A", "/Hidden/B"), ((0, 10, 0), (0, 0, 0)))
    asset = put(scene, made.saved())
    assert asset.robots["/A"].joint_names == ["joint"]
    with scene.edit() as edit:
        eye = hg.look_at((0, -0.3, 0.2), (0, 0, 0.05))
        edit.entity("cam", camera=hg.Camera.from_fov(60, 64, 64, degrees=True), transform=eye)
    part = scene.render("cam", spp=1, planes=["part"])["part"]
    links = asset.robots["/A"].link_of(part)
    assert set(links.ravel().tolist()) == {-1, 0}
    with scene.edit() as edit:
        edit.update(asset.entities["/Hidden/B"], visible=True)
    part = scene.render("cam", spp=1, planes=["part"])["part"]
    assert set(asset.robots["/A"].link_of(part).ravel().tolist()) == {-1, 0, 1}


def test_keypoints_that_no_robot_has_are_refused(scene, tmp_path):
    path = Chain(tmp_path).made.saved()
    with pytest.raises(hg.InvalidArgument, match="no joint 'elbow'; the stage has turn"):
        put(scene, path, keypoints=["elbow"])
    robot = put(scene, path, keypoints=["slide"]).robots[ARM]
    assert robot.keypoints == ["slide"]
