"""Stages with joints of UsdPhysics, of test_usd_robots.py, and where their bodies are, by
arithmetic of its own: rigid matrices (4, 4) for column vectors, in units and axes of the stage."""

import itertools

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdPhysics

_NUMBERS = itertools.count()
METRES = 0.01
ROOT_FROM_STAGE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # +Y up to +Z up


def pose(at=(0, 0, 0), turn=None):
    out = np.eye(4)
    out[:3, 3] = at
    out[:3, :3] = np.eye(3) if turn is None else turn
    return out


def about(axis, angle):
    """(3, 3) about X, Y or Z, radians."""
    i = "XYZ".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    out = np.eye(3)
    out[j, j] = out[k, k] = np.cos(angle)
    out[k, j], out[j, k] = np.sin(angle), -np.sin(angle)
    return out


def any_turn(rng):
    return about("X", rng.uniform(-3, 3)) @ about("Y", rng.uniform(-3, 3)) @ about("Z", 1.0)


def in_metres(rigid):
    """root_from_body of a rigid matrix of a stage that is +Y up, in METRES."""
    return pose(METRES * ROOT_FROM_STAGE @ rigid[:3, 3], ROOT_FROM_STAGE @ rigid[:3, :3])


def gf(matrix):
    return Gf.Matrix4d(np.asarray(matrix, "f8").T)


class Jointed:
    """A stage that is +Y up in centimetres, of cubes. frames: of bodies, rigid. scales: (3,)."""

    def __init__(self, folder):
        self.path = folder / f"jointed{next(_NUMBERS)}.usda"
        self.stage = Usd.Stage.CreateNew(str(self.path))
        UsdGeom.SetStageMetersPerUnit(self.stage, METRES)
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.y)
        self.frames, self.scales = {"": np.eye(4)}, {"": np.ones(3)}

    def group(self, path, matrix=None):
        prim = UsdGeom.Xform.Define(self.stage, path)
        prim.AddTransformOp().Set(gf(np.eye(4) if matrix is None else matrix))
        return prim.GetPrim()

    def body(self, path, frame, scale=(1, 1, 1)):
        """A cube of a rigid body, wherever its path is."""
        cube = UsdGeom.Cube.Define(self.stage, path)
        above = UsdGeom.Xformable(cube.GetPrim().GetParent())
        outer = np.array(above.ComputeLocalToWorldTransform(0)).T if above else np.eye(4)
        world = frame @ np.diag([*scale, 1.0])
        cube.AddTransformOp().Set(gf(np.linalg.inv(outer) @ world))
        UsdPhysics.RigidBodyAPI.Apply(cube.GetPrim())
        self.frames[path], self.scales[path] = frame, np.asarray(scale, "f8")
        return cube.GetPrim()

    def joint(self, kind, path, bodies, places=((0, 0, 0), (0, 0, 0)), turns=(None, None)):
        """kind: of UsdPhysics. bodies: paths, "" for the world. places, turns: of its frame."""
        joint = getattr(UsdPhysics, kind).Define(self.stage, path)
        for side, body in enumerate(bodies):
            if body:
                getattr(joint, f"CreateBody{side}Rel")().SetTargets([body])
            turn = np.eye(4) if turns[side] is None else pose(turn=turns[side])
            quaternion = Gf.Quatf(gf(turn).ExtractRotationQuat())
            getattr(joint, f"CreateLocalPos{side}Attr")(Gf.Vec3f(*map(float, places[side])))
            getattr(joint, f"CreateLocalRot{side}Attr")(quaternion)
        return joint

    def frame(self, body, place, turn):
        """body_from_joint: a joint's place is in the scaled frame of its body."""
        return pose(self.scales[body] * place, turn)

    def saved(self):
        self.stage.GetRootLayer().Save()
        return self.path
