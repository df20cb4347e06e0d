"""Robots of URDF files beside PyBullet: which of the two load each, where its links are, and what
is seen of them.

usage: robots.py [--import] [--seen] FILE_OR_FOLDER...
Run with .venv/bin/python; needs the extra `physics`. A line of JSON for each file, then the counts.

Joints take random values within their limits, 8 times over: a link that is more than a millionth of
a metre from where PyBullet has it, or as much in a term of its rotation, is a disagreement.
--import: a daemon takes the robot, and reads its meshes and textures.
--seen: that, and pictures of both: the share of pixels where both see the robot among those where
one does, of these the share that show the same link, and the median of the difference in depth, m.
PyBullet's spheres and capsules have few facets, it does not draw the backs of faces, and it draws
the collision shapes of every link without visuals.
"""

import argparse
import collections
import dataclasses
import json
import os
import pathlib
import sys

import heliograph as hg
import numpy as np
import pybullet as bullet
from heliograph.robots import urdf
from heliograph.robots.description import ONE_AXIS
from heliograph.robots.kinematics import Kinematics

TRIES, TOLERANCE = 8, 1e-6
MOST_JOINTS = 127  # of more, PyBullet returns no poses
WIDTH, HEIGHT, FIELD = 240, 180, 50
NEAR, FAR = 0.01, 100.0


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("places", nargs="+", type=pathlib.Path)
    parser.add_argument("--import", dest="imported", action="store_true")
    parser.add_argument("--seen", action="store_true")
    given = parser.parse_args()
    counts = collections.Counter()
    for path in files(given.places):
        found = in_a_child(lambda path=path: compared(path.resolve(), given))
        counts[found["outcome"]] += 1
        print(json.dumps({"file": str(path), **found}), flush=True)
    print(json.dumps(counts))


def files(places):
    for place in places:
        yield from sorted(place.rglob("*.urdf")) if place.is_dir() else [place]


def in_a_child(function):
    """Result of a function in a process of its own: a file may end it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)  # PyBullet writes there
        with os.fdopen(writer, "w") as out:
            json.dump(function(), out)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        text = pipe.read()
    _, status = os.waitpid(child, 0)
    return json.loads(text) if status == 0 else {"outcome": "ended", "status": status}


def compared(path, given):
    """The outcome for a file, and what led to it."""
    model, refusal = None, {}
    try:
        model = urdf.read(path, {})
    except hg.HeliographError as error:
        refusal = {"refusal": str(error)}
    body = loaded(path)
    if model is None:
        return {"outcome": "neither loads" if body is None else "PyBullet alone", **refusal}
    out = {"warnings": model.warnings}
    if given.imported or given.seen:
        out.update(imported(path, body, model, given.seen))
    if body is None:
        return {"outcome": "ours alone", **out}
    off = disagreement(model, body)
    return {"outcome": "disagree" if off else "agree", **off, **out}


def loaded(path):
    """The body in PyBullet; None: refused."""
    bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(str(path), useFixedBase=True)
        if bullet.getNumJoints(body) > MOST_JOINTS:
            bullet.removeBody(body)
            flags = bullet.URDF_MERGE_FIXED_LINKS
            body = bullet.loadURDF(str(path), useFixedBase=True, flags=flags)
        return body
    except bullet.error:
        return None


# ---------------------------------------------------------------- kinematics


def disagreement(model, body):
    k = Kinematics(model)
    places = links_of(body)
    alone = set(places) - set(k.link_names) | {j.child for j in k.moving} - set(places)
    if alone:
        return {"links of one alone": sorted(alone)}
    worst = collections.Counter()
    for row in random_rows(k, TRIES):
        move(body, k, row)
        for name, ours in zip(k.link_names, k.forward(row), strict=True):
            if places.get(name, -1) >= 0:
                off = np.abs(pose_of(body, places[name]) - ours).max()
                worst[name] = max(worst[name], float(off))
    far = {name: worst[name] for name in k.link_names if worst[name] > TOLERANCE}
    return {"links that are elsewhere": far} if far else {}


def random_rows(k, count):
    """Values that PyBullet can take: planar and floating joints rest."""
    rng = np.random.default_rng(0)
    low, high = np.clip(k.limits, -3, 3).T
    for row in rng.uniform(low, high, (count, len(low))):
        for joint in k.moving:
            if joint.kind in ("planar", "floating"):
                at = [n.startswith(f"{joint.name}/") for n in k.joint_names]
                row[at] = k.rest[at]
        yield k.values(row)


def move(body, k, row):
    """Puts the joints of a body at a row of values."""
    columns = dict(zip(k.joint_names, row, strict=True))
    joints = {joint.name: joint for joint in k.joints}

    def value(joint):
        if joint.mimic is None:
            return columns[joint.name]
        return joint.mimic.multiplier * value(joints[joint.mimic.joint]) + joint.mimic.offset

    for i in range(bullet.getNumJoints(body)):
        joint = joints[bullet.getJointInfo(body, i)[1].decode()]
        if joint.kind in ONE_AXIS:
            bullet.resetJointState(body, i, value(joint))
        elif joint.kind == "spherical":
            wxyz = [columns[f"{joint.name}/{part}"] for part in ("qx", "qy", "qz", "qw")]
            bullet.resetJointStateMultiDof(body, i, wxyz)


def base_of(body):
    return bullet.getBodyInfo(body)[0].decode()


def links_of(body):
    """{name: number in PyBullet}"""
    count = bullet.getNumJoints(body)
    found = {bullet.getJointInfo(body, i)[12].decode(): i for i in range(count)}
    return {base_of(body): -1, **found}


def pose_of(body, number):
    state = bullet.getLinkState(body, number, computeForwardKinematics=True)
    out = np.eye(4)
    out[:3, :3] = np.reshape(bullet.getMatrixFromQuaternion(state[5]), (3, 3))
    out[:3, 3] = state[4]
    return out


# ---------------------------------------------------------------- pictures


def imported(path, body, model, is_seen):
    with hg.connect(timeout=300) as client, client.create_scene() as scene:
        try:
            with scene.edit() as edit:
                robot = edit.import_urdf(path)
        except hg.HeliographError as error:
            return {"not imported": str(error)}
        out = {"warnings": robot.warnings}
        if is_seen and body is not None:
            row = next(random_rows(robot.kinematics, 1))
            with scene.edit() as edit:
                edit.set_joints(robot, row)
            move(body, robot.kinematics, row)
            out.update(seen(scene, robot, body))
        return out


def seen(scene, robot, body):
    low, high = bounds_of(body)
    target, size = (low + high) / 2, np.linalg.norm(high - low)
    eye = target + size * np.array([0.9, -1.0, 0.6])
    with scene.edit() as edit:
        lens = hg.Camera.from_fov(FIELD, WIDTH, HEIGHT, degrees=True)
        # PyBullet's rays go through a corner of a pixel, not its middle.
        lens = dataclasses.replace(lens, cx=lens.cx + 0.5, cy=lens.cy - 0.5)
        edit.entity("cam", camera=lens, transform=hg.look_at(eye, target))
    frame = scene.render("cam", planes=["depth", "part"], labels=False)
    names = np.array([*robot.link_names, ""])
    ours = names[robot.link_of(frame["part"])]
    theirs, depth = picture(body, (eye, target), frame.K)
    either, both = (ours != "") | (theirs != ""), (ours != "") & (theirs != "")
    same = both & (ours == theirs)
    off = np.abs(frame["depth"][same] - depth[same])
    return {
        "seen by both": share(both, either),
        "same link": share(same, both),
        "depth": round(float(np.median(off)), 5) if same.any() else None,
    }


def share(part, whole):
    return round(float(part.sum() / max(whole.sum(), 1)), 4)


def bounds_of(body):
    boxes = np.array([bullet.getAABB(body, i) for i in links_of(body).values()])
    return boxes[:, 0].min(0), boxes[:, 1].max(0)


def picture(body, view, K):
    """(H, W) names of links, and (H, W) depth in metres, as PyBullet draws them."""
    field = 2 * np.degrees(np.arctan(HEIGHT / 2 / K[1, 1]))
    _, _, _, buffer, numbers = bullet.getCameraImage(
        *(WIDTH, HEIGHT),
        viewMatrix=bullet.computeViewMatrix(*view, (0, 0, 1)),
        projectionMatrix=bullet.computeProjectionMatrixFOV(field, WIDTH / HEIGHT, NEAR, FAR),
        flags=bullet.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
        renderer=bullet.ER_TINY_RENDERER,
    )
    numbers = np.reshape(numbers, (HEIGHT, WIDTH))
    names = {number: name for name, number in links_of(body).items()}
    shown = [names[(n >> 24) - 1] if n >= 0 else "" for n in numbers.ravel()]
    z = np.reshape(buffer, (HEIGHT, WIDTH))
    return np.reshape(shown, (HEIGHT, WIDTH)), FAR * NEAR / (FAR - (FAR - NEAR) * z)


if __name__ == "__main__":
    sys.exit(main())
