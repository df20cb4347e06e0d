"""A robot in a real daemon: poses, parts, keypoints, flow and blur against its kinematics."""

import json
import pickle
from pathlib import Path

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest

ASSETS = Path(__file__).resolve().parents[2] / "examples/assets"
ARM = ASSETS / "arm/arm.urdf"
VALUES = np.array([0.3, 0.5, 1.0, -0.4, 0.02])
ROOT = hg.Pose((0.1, -0.2, 0.05), euler=(0.1, -0.05, 0.4)).matrix
PLANES = ["position", "instance", "part", "semantic", "material"]
LABELS = {"boxes": True, "keypoints": True, "keypoint_radius": 0.15}


@pytest.fixture
def stage(scene):
    """The arm, at VALUES, and a camera."""
    with scene.edit() as edit:
        arm = edit.import_urdf(ARM, category="arm", transform=ROOT, label=7)
        edit.set_joints(arm, VALUES)
        edit.dome(color=1.0)
        lens = hg.Camera.from_fov(50, 160, 120, degrees=True)
        pose = hg.look_at((1.3, -1.6, 0.9), (0.2, 0, 0.45))
        cam = edit.entity("cam", camera=lens, transform=pose)
    return arm, cam


def world(arm, values):
    """(L, 4, 4) world_from_link."""
    return ROOT @ arm.forward(values)


def projected(frame, points):
    at = points @ frame.camera_from_world_cv[:3, :3].T + frame.camera_from_world_cv[:3, 3]
    image = at @ frame.K.T
    return image[..., :2] / image[..., 2:]


def test_links_are_where_the_kinematics_have_them(scene, stage):
    arm, _ = stage
    expected = world(arm, VALUES)
    for name, matrix in zip(arm.link_names, expected, strict=True):
        np.testing.assert_allclose(arm.links[name].world_transform, matrix, atol=1e-6)
    assert [link.name for link in arm.moving] == [
        f"arm/{name}" for name in "turret upper_arm forearm hand finger_left finger_right".split()
    ]
    with scene.edit() as edit:
        edit.set_joints(arm, {"grip": 0.05})  # the others stay, the mimic follows
    moved = VALUES * (1, 1, 1, 1, 0) + (0, 0, 0, 0, 0.05)
    for name, matrix in zip(arm.link_names, world(arm, moved), strict=True):
        np.testing.assert_allclose(arm.links[name].world_transform, matrix, atol=1e-6)


def test_links_are_parts_of_one_instance(scene, stage):
    arm, cam = stage
    frame = scene.render(cam, planes=PLANES, labels=LABELS)
    assert frame.labels["label"].tolist() == [7] and frame.labels["name"] == ["arm"]
    part = frame["part"]
    links = arm.link_of(part)
    assert {arm.link_names[i] for i in np.unique(links) if i >= 0} == set(arm.link_names) - {"tool"}
    assert ((links == -1) == (part == 0)).all()
    assert list(arm.parts.values()) == list(range(1, 1 + len(arm.link_names)))
    hand = links == arm.link_names.index("hand")
    assert len(np.unique(frame["material"][hand])) == 2
    assert (part[hand] == arm.parts["hand"]).all()
    assert ((part > 0) == (frame["instance"] == 7)).all()
    assert ((part > 0) == (frame["semantic"] == 1)).all()
    poses = dict(zip(arm.link_names, world(arm, VALUES), strict=True))

    def within(link):
        """Points that are seen of a link, in its frame."""
        number = arm.parts[link]
        points = frame["position"][part == number]
        return (points - poses[link][:3, 3]) @ poses[link][:3, :3]

    x, y, z = within("base").T
    rim = np.abs(np.hypot(x, y) - 0.14) < 1e-3
    lid = (np.abs(z - 0.08) < 1e-4) & (np.hypot(x, y) < 0.14)
    assert (rim | lid).all() and rim.any() and lid.any()
    for finger, side in (("finger_left", 1), ("finger_right", -1)):
        face = np.abs((within(finger) - (0, side * 0.01, 0.05)) / (0.015, 0.01, 0.05))
        np.testing.assert_allclose(face.max(1), 1, atol=1e-4)


def test_joints_are_keypoints(scene, stage):
    arm, cam = stage
    frame = scene.render(cam, planes=["depth"], labels=LABELS)
    assert sorted(frame.labels["keypoint_name"]) == sorted(arm.keypoints)
    assert set(frame.labels["keypoint_instance"]) == {7}
    origins = dict(zip(arm.link_names, world(arm, VALUES)[:, :3, 3], strict=True))
    above = {joint.name: joint.child for joint in arm.kinematics.joints}
    expected = np.array([origins[above[name]] for name in frame.labels["keypoint_name"]])
    camera = frame.camera_from_world_cv
    np.testing.assert_allclose(
        frame.labels["keypoint_position_camera"],
        expected @ camera[:3, :3].T + camera[:3, 3],
        atol=1e-5,
    )
    np.testing.assert_allclose(
        frame.labels["keypoint_image"], projected(frame, expected), atol=1e-3
    )
    assert ("shoulder", "elbow") in arm.skeleton and ("wrist", "tool_joint") in arm.skeleton
    assert {name for pair in arm.skeleton for name in pair} == set(arm.keypoints)


def test_coco_has_the_skeleton_of_a_robot(scene, stage, tmp_path):
    _, cam = stage
    with scene.edit() as edit:
        arm = edit.import_urdf(ARM, name="second", category="arm", transform=hg.Pose((0, 0.5, 0)))

    def bend(draw):
        draw.edit.set_joints(arm, draw.rng.uniform(0, 0.05, 5))

    writer = hd.Coco(tmp_path / "out", keypoints=True)
    hd.generate(scene, cam, bend, count=2, spp=1, writer=writer, progress=False)
    (found,) = json.loads((tmp_path / "out/annotations/keypoints.json").read_text())["categories"]
    names = found["keypoints"]
    assert sorted(names) == sorted(arm.keypoints)
    assert {(names[a - 1], names[b - 1]) for a, b in found["skeleton"]} == set(arm.skeleton)


def test_random_joints_are_within_their_limits_and_pure(scene, stage, tmp_path):
    arm, cam = stage
    randomize = hd.random_joints(arm, {"elbow": (0.5, 0.6), "wrist": 0.25})
    seen = []
    for name in "ab":
        drawn = {}  # in any order

        def remember(draw, drawn=drawn):
            drawn[draw.index] = [draw.pose(arm.links[name]) for name in arm.link_names]

        both, writer = hd.Compose(randomize, remember), hd.Coco(tmp_path / name)
        hd.generate(scene, cam, both, count=4, spp=1, writer=writer, progress=False, seed=3)
        seen.append(np.array([drawn[index] for index in range(4)]))
    poses, again = seen
    np.testing.assert_array_equal(poses, again)
    elbow, hand = arm.link_names.index("forearm"), arm.link_names.index("hand")
    step = np.linalg.inv(poses[:, elbow]) @ poses[:, hand]
    np.testing.assert_allclose(step[:, 0, 0], np.cos(0.25), atol=1e-6)
    bent = np.linalg.inv(poses[:, arm.link_names.index("upper_arm")]) @ poses[:, elbow]
    angles = np.arctan2(bent[:, 0, 2], bent[:, 0, 0])
    assert (angles > 0.5).all() and (angles < 0.6).all() and len(set(angles.round(9))) == 4
    with pytest.raises(hg.InvalidArgument, match=r"ranges\['elbow'\]"):
        hd.random_joints(arm, {"elbow": (0, 3)})
    with pytest.raises(hg.InvalidArgument, match="'tool_joint' is no joint"):
        hd.random_joints(arm, {"tool_joint": 1})


def test_flow_follows_the_joints(scene, stage):
    arm, cam = stage
    after = VALUES + (0.1, -0.15, 0.2, 0.3, 0.02)
    with scene.edit() as edit:
        edit.advance(1 / 30)
        edit.set_joints(arm, after)
    frame = scene.render(
        cam, planes=["position", "part", "flow_backward", "flow_backward_valid"], labels=False
    )
    seen = frame["part"] > 0
    assert frame["flow_backward_valid"][seen].all()
    link = arm.link_of(frame["part"])[seen]
    step = world(arm, VALUES) @ np.linalg.inv(world(arm, after))
    now = frame["position"][seen].astype(float)
    before = np.einsum("pij,pj->pi", step[link][:, :3, :3], now) + step[link][:, :3, 3]
    expected = projected(frame, before) - projected(frame, now)
    np.testing.assert_allclose(frame["flow_backward"][seen], expected, atol=0.05)
    assert np.linalg.norm(expected, axis=1).max() > 5


def test_keys_move_joints_evenly_and_blur_them(scene, stage):
    arm, cam = stage
    far = VALUES + (4.0, 0, 0, 0, 0)  # farther than any one rotation between two poses
    with scene.edit() as edit:
        edit.set_joints(arm, keys={0.0: VALUES, 1.0: far})
    shown = scene.render(cam, time=0.7, planes=["depth", "part"])
    shutter = hg.Camera.from_fov(50, 160, 120, degrees=True)
    with scene.overlay() as moving:
        lens = hg.Camera(**{**vars(shutter), "shutter": (0.0, 0.3)})
        moving.update(cam, camera=lens)
    with scene.overlay() as still:
        still.set_joints(arm, 0.3 * VALUES + 0.7 * far)
    expected = scene.render(cam, overlay=still, planes=["depth", "part"])
    assert (shown["part"] == expected["part"]).mean() > 0.999
    same = shown["part"] == expected["part"]
    np.testing.assert_allclose(shown["depth"][same], expected["depth"][same], rtol=1e-4)
    sharp = scene.render(cam, time=0.5, planes=["coverage"], spp=16)["coverage"]
    blurred = scene.render(cam, overlay=moving, time=0.5, planes=["coverage"], spp=16)["coverage"]
    assert ((blurred > 0) & (blurred < 1)).sum() > 2 * ((sharp > 0) & (sharp < 1)).sum()


def test_many_robots_move_in_one_message(scene):
    with scene.edit() as edit:
        arms = [edit.import_urdf(ARM, name="arm/0")]
    with scene.edit() as edit:
        for i in (1, 2):
            at = hg.Pose((i, 0, 0))
            arms.append(edit.import_urdf(arms[0], name=f"arm/{i}", transform=at))
        assert not any(e.WhichOneof("action") == "mesh" for e in edit.transaction.edits)
    assert pickle.loads(pickle.dumps(arms[2])).links == arms[2].links
    rng = np.random.default_rng(5)
    rows = np.clip(rng.normal(0.3, 0.5, (3, 5)), arms[0].limits[:, 0], arms[0].limits[:, 1])
    with scene.edit() as edit:
        edit.set_joints(arms, rows)
        assert [e.WhichOneof("action") for e in edit.transaction.edits] == ["poses"]
    for i, arm in enumerate(arms):
        tool = arm.forward(rows[i])[arm.link_names.index("tool"), :3, 3] + (i, 0, 0)
        np.testing.assert_allclose(arm.links["tool"].world_transform[:3, 3], tool, atol=1e-6)
    with scene.edit() as edit:
        edit.set_joints(arms, {"yaw": [0.1, 0.2, 0.3]})
    turned = [arm.links["turret"].transform[1, 0] for arm in arms]
    np.testing.assert_allclose(turned, np.sin([0.1, 0.2, 0.3]), atol=1e-6)
    with pytest.raises(hg.InvalidArgument, match="2 rows for 3 robots"), scene.edit() as edit:
        edit.set_joints(arms, rows[:2])


def test_worlds_have_joints_of_their_own(scene, stage):
    arm, cam = stage
    rows = VALUES + np.linspace(-0.2, 0.2, 3)[:, None] * (1, 1, 1, 1, 0)
    worlds = hg.Worlds(3).set_joints(arm, rows)
    batch = scene.render_worlds(cam, worlds, planes=["depth", "part"], spp=1)
    for i, row in enumerate(rows):
        with scene.overlay() as overlay:
            overlay.set_joints(arm, row)
        alone = scene.render(cam, overlay=overlay, planes=["depth", "part"], spp=1)
        for plane in ("depth", "part"):
            np.testing.assert_array_equal(batch[plane][i, 0], alone[plane])


def test_limits_are_refused_before_anything_is_sent(scene, stage):
    arm, _ = stage
    revision = scene.revision
    with pytest.raises(hg.InvalidArgument, match="'wrist' is at 2.5"), scene.edit() as edit:
        edit.set_joints(arm, VALUES + (0, 0, 0, 2.9, 0))
    assert scene.revision == revision
    with scene.edit() as edit:
        edit.set_joints(arm, {"wrist": 2.5}, clamp=True)
    assert arm.links["hand"].transform[0, 0] == pytest.approx(np.cos(2))


def test_visuals_have_their_materials(scene, tmp_path):
    faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\nusemtl rubber\nf 3 2 1\n"
    (tmp_path / "hand.obj").write_text("mtllib hand.mtl\n" + faces)
    (tmp_path / "hand.mtl").write_bytes((ASSETS / "arm/meshes/hand.mtl").read_bytes())
    mesh = '<geometry><mesh filename="hand.obj"/></geometry>'
    (tmp_path / "r.urdf").write_text(f"""<robot name="r"><link name="a">
        <visual>{mesh}<material name="glass"><color rgba="0.5 1 0 0.25"/></material></visual>
        <visual>{mesh}</visual>
        <visual><geometry><box size="1 1 1"/></geometry><material name="glass"/></visual>
        </link></robot>""")
    with scene.edit() as edit:
        edit.import_urdf(tmp_path / "r.urdf", keypoints=[])
        edit.import_urdf(tmp_path / "r.urdf", name="kept", mesh_materials=True)
    glass = scene["r/material/glass"]
    assert scene["r/a/0"].materials == [glass, glass] and scene["r/a/2"].materials == [glass]
    own = scene["r/a/1"].materials
    assert own == [scene["hand/paint"], scene["hand/rubber"]]
    assert scene["kept/a/0"].materials == own
    found = glass.parameters
    assert found["base_color"] == pytest.approx((0.21404, 1, 0), abs=1e-4)
    assert found["alpha"] == pytest.approx(0.25)
    assert scene["r/a/0"].mesh == scene["r/a/1"].mesh == scene["kept/a/0"].mesh


def dae_of(obj, material):
    """A COLLADA file of an OBJ's triangles, in millimetres, whose up_axis nobody meant."""
    rows = [line.split() for line in obj.splitlines()]
    points = [word for row in rows if row[0] == "v" for word in row[1:]]
    faces = [str(int(word) - 1) for row in rows if row[0] == "f" for word in row[1:]]
    return f"""<COLLADA><asset><unit meter="0.001"/><up_axis>X_UP</up_axis></asset>
        <library_effects><effect id="e"><profile_COMMON><technique><phong>{material}</phong>
        </technique></profile_COMMON></effect></library_effects>
        <library_materials><material id="m" name="shell"><instance_effect url="#e"/></material>
        </library_materials><library_geometries><geometry id="g"><mesh><source id="s">
        <float_array id="a">{" ".join(points)}</float_array><technique_common>
        <accessor source="#a" count="{len(points) // 3}" stride="3"><param/><param/><param/>
        </accessor></technique_common></source>
        <vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
        <polylist material="mat"><input semantic="VERTEX" source="#v" offset="0"/>
        <vcount>{"4 " * (len(faces) // 4)}</vcount><p>{" ".join(faces)}</p></polylist>
        </mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="vs">
        <node id="n"><instance_geometry url="#g"><bind_material><technique_common>
        <instance_material symbol="mat" target="#m"/></technique_common></bind_material>
        </instance_geometry></node></visual_scene></library_visual_scenes>
        <scene><instance_visual_scene url="#vs"/></scene></COLLADA>"""


def test_every_mesh_of_a_link_is_its_part(scene, tmp_path):
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n"
    color = "<diffuse><color>1 1 1 1</color></diffuse>"
    text = dae_of(obj.replace("f 1 2 3\nf 3 2 1", "f 1 2 3 3\nf 3 2 1 1"), color)
    node = text[text.index('<node id="n">') : text.index("</visual_scene>")]
    (tmp_path / "two.dae").write_text(text.replace(node, node + node.replace('"n"', '"m"')))
    visual = '<visual><geometry><mesh filename="two.dae"/></geometry></visual>'
    (tmp_path / "r.urdf").write_text(f"""<robot name="r"><link name="a">{visual}</link>
        <link name="b">{visual}{visual}</link><joint name="j" type="fixed"><parent link="a"/>
        <child link="b"/><origin xyz="0 0 1"/></joint></robot>""")
    with scene.edit() as edit:
        robot = edit.import_urdf(tmp_path / "r.urdf", label=5)
    for link, part in robot.parts.items():
        for entity in scene.find(f"r/{link}/*"):
            if entity.kind == "entity" and entity.mesh is not None:
                label = entity._message().label
                assert label.part == part and label.WhichOneof("instance") is None
    meshes = [e for e in scene.find("r/*/*/*") if e.kind == "entity" and e.mesh is not None]
    assert len(meshes) == 6


def test_meshes_of_collada_are_those_of_obj(scene, tmp_path):
    obj = (ASSETS / "arm/meshes/hand.obj").read_text()
    (tmp_path / "hand.obj").write_text(
        "\n".join(r for r in obj.splitlines() if r[:2] in ("v ", "f "))
    )
    color = "<diffuse><color>0.8 0.1 0.05 1</color></diffuse>"
    (tmp_path / "hand.dae").write_text(dae_of((tmp_path / "hand.obj").read_text(), color))
    robot = """<robot name="{0}"><link name="hand"><visual><origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/>
        <geometry><mesh filename="hand.{0}" {1}/></geometry></visual></link></robot>"""
    for kind, scale in (("obj", 'scale="0.001 0.001 0.001"'), ("dae", "")):
        (tmp_path / f"{kind}.urdf").write_text(robot.format(kind, scale))
    frames = {}
    with scene.edit() as edit:
        lens = hg.Camera.from_fov(40, 96, 96, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0.3, -0.4, 0.4), (0, 0, 0.2)))
    for kind in ("obj", "dae"):
        with scene.overlay() as overlay:
            overlay.import_urdf(tmp_path / f"{kind}.urdf", category="hand")
        planes = ["depth", "normal", "part", "instance", "base_color"]
        frames[kind] = scene.render("cam", overlay=overlay, planes=planes)
    for plane in ("depth", "normal", "part", "instance"):
        np.testing.assert_allclose(frames["dae"][plane], frames["obj"][plane], atol=1e-4)
    seen = frames["dae"]["part"] == 1
    assert seen.sum() > 500
    np.testing.assert_allclose(
        frames["dae"]["base_color"][seen], np.tile((0.8, 0.1, 0.05), (seen.sum(), 1)), atol=1e-3
    )
