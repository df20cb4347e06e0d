"""Requests that make no sense, through the Python client: one row each."""

from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
from refusals import EYE, TRIANGLE, camera, check, dome, edited, entity, material, mesh, render

INVALID, MISSING, STATE = hg.InvalidArgument, hg.NotFound, hg.FailedPrecondition
SINGULAR = np.diag([1.0, 1.0, 0.0, 1.0])
TILTED = EYE + np.outer((0, 0, 0, 1), (1, 0, 0, 0))
MANY = range(300_000)
FOX = Path(__file__).resolve().parents[1] / "assets/gltf/Fox.glb"


def overlay(call):
    """A row's call from a function of an overlay's edit."""

    def run(scene):
        with scene.overlay() as made:
            call(made)
        scene.render("cam", planes=["depth"], overlay=made)

    return run


def stale(scene):
    with scene.branch() as branch:
        with branch.edit() as edit:
            edit.entity("short-lived")
        gone = branch["short-lived"]
        with branch.edit() as edit:
            edit.remove(gone)
        with branch.edit() as edit:
            edit.update(gone, visible=False)


def thousands(edit):
    for i in MANY:
        edit.entity(f"an entity with a name of some length, so that messages grow {i}")


# Row -> (error, field, what else the message says, call).
MATRICES = {
    "pose": (INVALID, "pose", "not invertible", entity(transform=SINGULAR)),
    "projective": (INVALID, "pose", "0 0 0 1", entity(transform=TILTED)),
    "two equal columns": (INVALID, "pose", "independent", entity(transform=EYE[:, [0, 0, 2, 3]])),
    "keyed": (INVALID, "pose", "not invertible", entity(keys={0: EYE, 1: SINGULAR})),
    "instances": (
        INVALID,
        "matrices[1]",
        "not invertible",
        edited(lambda e: e.instances("thing", transforms=np.stack([EYE, SINGULAR]))),
    ),
    "set_transforms": (
        INVALID,
        "matrices[0]",
        "not invertible",
        edited(lambda e: e.set_transforms(["ball"], SINGULAR[None])),
    ),
    "symmetry": (INVALID, "symmetries[0]", "invertible", mesh(symmetries=[SINGULAR])),
    "dome": (INVALID, "rotation", "orthonormal", dome(rotation=2 * np.eye(3))),
    "scale 0": (INVALID, "scale", "not 0", lambda s: hg.Pose(scale=0).matrix),
    "quaternion of length 0": (
        INVALID,
        "wxyz",
        "length 0",
        lambda s: hg.Pose(wxyz=(0, 0, 0, 0)).matrix,
    ),
    "look_at itself": (INVALID, "at", "same point", lambda s: hg.look_at((0, 0, 0), (0, 0, 0))),
}
RANGES = {
    "name": (INVALID, "name", "1024", edited(lambda e: e.entity("x" * 1025))),
    "reference": (INVALID, "name", "1024", edited(lambda e: e.entity("a", mesh="x" * 1025))),
    "pattern": (INVALID, "pattern", "1024", lambda scene: scene.find("[" * 1025)),
    "vertex": (INVALID, "indices", "holds 3, but there are only 3", mesh(indices=[[0, 1, 3]])),
    "negative vertex": (INVALID, "indices", "-1", mesh(indices=[[0, 1, -1]])),
    "vertex over 2^32": (INVALID, "indices", "4294967296", mesh(indices=[[0, 1, 2**32]])),
    "fraction": (INVALID, "indices", "whole", mesh(indices=[[0, 1, 1.5]])),
    "part": (INVALID, "parts[0]", "only 1 part", mesh(parts=[1])),
    "keypoint": (
        INVALID,
        "skeleton",
        "only 1 keypoint",
        mesh(keypoints={"a": (0, 0, 0)}, skeleton=[[0, 1]]),
    ),
    "joint": (
        INVALID,
        "joints",
        "joint",
        edited(
            lambda e: e.entity(
                "x",
                skin=(["bone"], [EYE]),
                mesh=e.mesh(
                    "m",
                    **TRIANGLE,
                    joints=np.full((3, 4), 5, "u2"),
                    weights=np.eye(4)[:3] * 0 + [1, 0, 0, 0],
                ),
            )
        ),
    ),
    "channel": (INVALID, "channel", "", material(roughness=hg.Tex("dots", channel=4))),
    "uv_set": (INVALID, "uv_set", "", material(roughness=hg.Tex("dots", uv_set=2))),
    "roughness": (INVALID, "roughness", r"\[0, 1\]", material(roughness=1.5)),
    "base_color": (INVALID, "base_color", r"\[0, 1\]", material(base_color=(0, -1, 0))),
    "ior": (INVALID, "ior", r"\[1, 4\]", material(ior=0.5)),
    "emission": (INVALID, "emission", "", material(emission=-1)),
    "temperature": (
        INVALID,
        "temperature",
        "1000",
        entity(light=hg.Light(radiance=1, temperature=10)),
    ),
    "light": (INVALID, "intensity", "", entity(light=hg.Light(radiance=-1))),
    "advance": (INVALID, "dt", "more than 0", edited(lambda e: e.advance(0))),
    "clip": (INVALID, "animation", "below 3", edited(lambda e: e.import_file(FOX, animation=99))),
    "camera 0": (INVALID, "camera.width", "1", entity(camera=camera(width=0))),
    "camera 100,000": (INVALID, "camera.height", "16384", entity(camera=camera(height=100_000))),
    "camera half": (INVALID, "camera.width", "whole", entity(camera=camera(width=1.5))),
    "focal length": (INVALID, "fx", "", entity(camera=camera(fx=0))),
    "size 0": (INVALID, "width", "1", render(size=(0, 24))),
    "size 100,000": (INVALID, "width", "16384", render(size=(100_000, 24))),
    "height 100,000": (INVALID, "height", "16384", render(size=(32, 100_000))),
    "size -1": (INVALID, "size[0]", "outside", render(size=(-1, 24))),
    "spp 0": (INVALID, "spp", "outside", render(spp=0)),
    "spp 10^9": (INVALID, "spp", "1048576", render(spp=10**9)),
    "spp 10^12": (INVALID, "spp", "outside", render(spp=10**12)),
    "depth 0": (INVALID, "max_depth", "outside", render(max_depth=0)),
    "depth 10^9": (INVALID, "max_depth", "", render(max_depth=10**9)),
    "priority 101": (INVALID, "priority", "outside", render(priority=101)),
    "seconds": (INVALID, "seconds", "", render(seconds=-1)),
    "noise": (INVALID, "noise", "", render(noise=-1)),
    "clamp": (INVALID, "clamp", "", render(clamp=-1)),
    "indirect clamp": (INVALID, "clamp_indirect", "", render(clamp_indirect=0)),
    "seed": (INVALID, "seed", "outside", render(seed=-1)),
    "interval": (INVALID, "frame_interval", "", render(planes=["flow_forward"], frame_interval=-1)),
    "canvas": (INVALID, "canvas", "", render(labels={"amodal": True, "canvas": -1})),
    "radius": (INVALID, "keypoint_radius", "", render(labels={"keypoint_radius": -1})),
    "rows": (INVALID, "max_rows", "outside", render(labels={"boxes": True, "max_rows": 0})),
    "direction 0": (
        INVALID,
        "directions[0]",
        "length",
        lambda s: s.cast_rays((0, 0, 0), (0, 0, 0)),
    ),
    "t_max": (INVALID, "t_max", "", lambda s: s.cast_rays((0, 0, 0), (0, 0, 1), t_max=-1)),
    "samples": (hg.ResourceExhausted, "count", "", lambda s: s.sample_surface("ball", 2**32 - 1)),
    "revision": (hg.OutOfRange, "revision", "", render(revision=10**6)),
}
LENGTHS = {
    "positions": (INVALID, "positions", r"\(N, 3\)", mesh(positions=np.zeros((3, 2)))),
    "uvs": (INVALID, "uvs", r"V = 3", mesh(uvs=np.zeros((2, 2)))),
    "normals": (INVALID, "normals", r"V = 3", mesh(normals=np.ones((4, 3)))),
    "colors": (INVALID, "colors", r"V = 3", mesh(colors=np.ones((4, 3)))),
    "tangents": (INVALID, "tangents", r"V = 3", mesh(tangents=np.ones((4, 4)))),
    "parts": (INVALID, "parts", r"F = 1", mesh(parts=[0, 0])),
    "no faces": (INVALID, "indices", "F from 1", mesh(indices=np.zeros((0, 3), "u4"))),
    "ragged": (INVALID, "positions", "not an array", mesh(positions=[[0, 0, 0], [1]])),
    "text": (INVALID, "positions", "not an array", mesh(positions="many")),
    "objects": (INVALID, "transform", "not an array", entity(transform=[[None] * 4] * 4)),
    "weights": (
        INVALID,
        "weights",
        "V = 3",
        mesh(joints=np.zeros((3, 4)), weights=np.ones((2, 4)) / 4),
    ),
    "weights that sum to 2": (
        INVALID,
        "weights",
        "sum to 1",
        mesh(joints=np.zeros((3, 4)), weights=np.ones((3, 4)) / 2),
    ),
    "joints alone": (INVALID, "weights", "missing", mesh(joints=np.zeros((3, 4)))),
    "morph targets": (
        INVALID,
        "morph_positions",
        "V = 3",
        mesh(morph_positions=np.zeros((1, 2, 3))),
    ),
    "morph weights": (
        INVALID,
        "morph_weights",
        "2",
        entity(mesh="morphed", morph_weights=[1, 1, 1]),
    ),
    "times": (INVALID, "positions", "K = 1", mesh(positions=np.zeros((2, 3, 3)), times=[0])),
    "times in order": (
        INVALID,
        "times",
        "increase",
        mesh(positions=np.zeros((2, 3, 3)), times=[1, 0]),
    ),
    "no keys": (INVALID, "pose.times", "at least one", entity(keys={})),
    "skin": (INVALID, "skin", "", entity(mesh="skinned", skin=(["bone", "ball"], [EYE]))),
    "transforms": (
        INVALID,
        "transforms",
        "2 matrices for 1",
        edited(lambda e: e.set_transforms(["ball"], [EYE, EYE])),
    ),
    "4x3": (INVALID, "transform", r"\(4, 4\)", entity(transform=np.zeros((4, 3)))),
    "4-vector": (INVALID, "transform", "wxyz", entity(transform=(1, 0, 0, 0))),
    "indices alone": (
        INVALID,
        "positions",
        "",
        edited(lambda e: e.mesh("thing", indices=[[0, 1, 2]])),
    ),
    "texels": (INVALID, "image", "", edited(lambda e: e.texture("t", np.zeros((2, 2, 5), "f4")))),
    "no texels": (INVALID, "image", "", edited(lambda e: e.texture("t", np.zeros((0, 2), "f4")))),
    "size": (INVALID, "size", "(width, height)", render(size=(1, 2, 3))),
    "rays": (
        INVALID,
        "directions",
        "3 for 2",
        lambda s: s.cast_rays(np.zeros((2, 3)), np.ones((3, 3))),
    ),
    "pixels": (INVALID, "pixels", r"\(N, 2\)", lambda s: s.pick("cam", np.zeros((2, 3)))),
    "no entities": (INVALID, "entities", "at least one", lambda s: s.visible("cam", [])),
    "no planes": (INVALID, "planes", "", render(planes=[])),
}
NAMES = {
    "object": (MISSING, "bal", "nearest.*ball", lambda s: s["bal"]),
    "update": (MISSING, "target", "ball", edited(lambda e: e.update("bal", visible=False))),
    "remove": (MISSING, "target", "ball", edited(lambda e: e.remove("bal"))),
    "mesh": (MISSING, "mesh", "tri", entity(mesh="tr")),
    "material": (MISSING, "materials", "gold", entity(material="golf")),
    "parent": (MISSING, "parent", "bone", entity(parent="bune")),
    "joint": (MISSING, "skin", "bone", entity(mesh="skinned", skin=(["bune"], [EYE]))),
    "texture": (MISSING, "roughness", "dots", material(roughness="dot")),
    "light texture": (
        MISSING,
        "light.texture",
        "dots",
        entity(light=hg.Light(radiance=1, texture="dot")),
    ),
    "volume": (MISSING, "volume", "", entity(volume="nothing")),
    "camera": (MISSING, "cameras[0]", "cam", render("came")),
    "second camera": (MISSING, "cameras[1]", "cam", render(["cam", "came"])),
    "light group": (MISSING, "planes[0].group", "there are", render(planes=["beauty:kye"])),
    "stereo camera": (MISSING, "planes[0].camera", "cam", render(planes=["disparity:came"])),
    "pick camera": (MISSING, "camera", "cam", lambda s: s.pick("came", [[0, 0]])),
    "visible": (MISSING, "entities[0]", "ball", lambda s: s.visible("cam", ["bal"])),
    "overlaps": (MISSING, "b[0]", "ball", lambda s: s.overlaps("ball", "bal")),
    "samples": (MISSING, "entities[0]", "ball", lambda s: s.sample_surface("bal", 10)),
    "read": (MISSING, "refs[0]", "ball", lambda s: s.transforms(["bal"])),
    "overlay": (MISSING, "overlay", "ball", overlay(lambda e: e.update("bal", visible=False))),
    "scene": (MISSING, "name", "", lambda s: s.client.open_scene("nowhere")),
    "id": (
        MISSING,
        "target",
        "",
        edited(lambda e: e.update(hg.Entity(e.scene, "", (1 << 56) + 999), visible=False)),
    ),
    "stale id": (MISSING, "target", "", stale),
    "keyword": (INVALID, "colour", "", entity(colour=1)),
    "nearest keyword": (INVALID, "visble", "visible", entity(visble=True)),
    "material keyword": (INVALID, "rougness", "roughness", material(rougness=1)),
    "mesh keyword": (INVALID, "position", "positions", mesh(position=1)),
    "render keyword": (INVALID, "sp", "spp", render(sp=1)),
    "plane": (INVALID, "planes", "depth", render(planes=["dept"])),
    "no plane's name": (INVALID, "planes", "beauty", render(planes=[""])),
    "label column": (INVALID, "labels", "boxes", render(labels=["bxes"])),
    "filter": (INVALID, "filter", "box", render(filter="bx")),
    "alpha mode": (INVALID, "alpha_mode", "mask", material(alpha_mode="holes")),
    "encoding": (INVALID, "encoding", "srgb", edited(lambda e: e.texture("dots", encoding="rgb"))),
    "wrap": (INVALID, "wrap", "mirror", edited(lambda e: e.texture("dots", wrap="mirrored"))),
    "projection": (
        INVALID,
        "projection",
        "perspective",
        entity(camera=camera(projection="fish")),
    ),
}
STATES = {
    "no cameras": (INVALID, "cameras", "at least one", render([])),
    "not a camera": (INVALID, "cameras[0]", "camera", render("ball")),
    "picking without a camera": (INVALID, "camera", "'ball'", lambda s: s.pick("ball", [[0, 0]])),
    "seeing without a camera": (INVALID, "camera", "'ball'", lambda s: s.visible("ball", ["ball"])),
    "a group for depth": (INVALID, "planes[0]", "", render(planes=["depth:key"])),
    "stereo without a camera": (INVALID, "camera", "", render(planes=["disparity"])),
    "flow forward": (STATE, "frame_interval", "interval", render(planes=["flow_forward"])),
    "flow backward": (
        STATE,
        "frame_interval",
        "advance|interval",
        render(planes=["flow_backward"]),
    ),
    "flow of what has no keys": (
        STATE,
        "",
        "hold",
        render(planes=["flow_forward"], frame_interval=0.1),
    ),
    "mesh is a material": (INVALID, "mesh", "gold", entity(mesh="gold")),
    "parent is a mesh": (INVALID, "parent", "tri", entity(parent="tri")),
    "own parent": (INVALID, "parent", "", edited(lambda e: e.entity("ball", parent="ball"))),
    "taken": (
        hg.AlreadyExists,
        "target",
        "ball",
        edited(lambda e: e.entity("ball", exist_ok=False)),
    ),
    "in use": (STATE, "remove", "ball.*cascade", edited(lambda e: e.remove("gold"))),
    "label taken": (
        INVALID,
        "label",
        "",
        edited(lambda e: [e.entity("a", label=77), e.entity("b", label=77)]),
    ),
    "label": (INVALID, "label", "auto", entity(label="own")),
    "camera is a number": (INVALID, "camera", "hg.Camera", entity(camera=50)),
    "light is a number": (INVALID, "light", "hg.Light", entity(light=50)),
    "light without strength": (INVALID, "light", "exactly one", entity(light=hg.Light())),
    "transform and keys": (INVALID, "keys", "not both", entity(transform=EYE, keys={0: EYE})),
    "surface of a bone": (
        INVALID,
        "entities[0]",
        "no mesh",
        lambda s: s.sample_surface("bone", 10),
    ),
    "a message over the limit": (hg.ResourceExhausted, "", "transactions", edited(thousands)),
}
TABLES = {
    f"{kind}: {name}": row
    for kind, rows in {
        "matrix": MATRICES,
        "range": RANGES,
        "length": LENGTHS,
        "name": NAMES,
        "state": STATES,
    }.items()
    for name, row in rows.items()
}


@pytest.mark.parametrize("name", TABLES)
def test_a_request_is_refused(world, name):
    kind, field, message, call = TABLES[name]
    check(world, call, (kind, field), message)
