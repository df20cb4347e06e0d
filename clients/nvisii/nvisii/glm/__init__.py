"""The types and functions of GLM that scripts use, under GLM's names."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from .constants import CONSTANTS
from .elementwise import ELEMENTWISE
from .geometry import (
    closestPointOnLine,
    cross,
    distance,
    distance2,
    dot,
    euclidean,
    faceforward,
    l1Norm,
    l2Norm,
    length,
    length2,
    lMaxNorm,
    normalize,
    orientedAngle,
    perp,
    polar,
    proj,
    reflect,
    refract,
    triangleNormal,
)
from .matrices import mat2, mat3, mat4
from .quaternions import angleAxis, conjugate, quat
from .random import ballRand, circularRand, diskRand, gaussRand, linearRand, sphericalRand
from .rotations import (
    angle,
    axis,
    eulerAngles,
    inverse,
    lerp,
    mat3_cast,
    mat4_cast,
    mix,
    pitch,
    quat_cast,
    quatLookAt,
    quatLookAtRH,
    roll,
    rotation,
    shortMix,
    slerp,
    toMat3,
    toMat4,
    toQuat,
    yaw,
)
from .transforms import (
    affineInverse,
    column,
    determinant,
    frustum,
    infinitePerspective,
    inverseTranspose,
    lookAt,
    lookAtRH,
    matrixCompMult,
    ortho,
    orthonormalize,
    outerProduct,
    perspective,
    perspectiveFov,
    project,
    rotate,
    rotateX,
    rotateY,
    rotateZ,
    row,
    scale,
    translate,
    transpose,
    unProject,
)
from .vectors import ivec2, ivec3, ivec4, u16vec2, u16vec3, u16vec4, vec2, vec3, vec4

globals().update(CONSTANTS)
globals().update(ELEMENTWISE)

__all__ = [
    "affineInverse",
    "angle",
    "angleAxis",
    "axis",
    "ballRand",
    "circularRand",
    "closestPointOnLine",
    "column",
    "conjugate",
    "cross",
    "determinant",
    "diskRand",
    "distance",
    "distance2",
    "dot",
    "euclidean",
    "eulerAngles",
    "faceforward",
    "frustum",
    "gaussRand",
    "infinitePerspective",
    "inverse",
    "inverseTranspose",
    "ivec2",
    "ivec3",
    "ivec4",
    "l1Norm",
    "l2Norm",
    "lMaxNorm",
    "length",
    "length2",
    "lerp",
    "linearRand",
    "lookAt",
    "lookAtRH",
    "mat2",
    "mat3",
    "mat3_cast",
    "mat4",
    "mat4_cast",
    "matrixCompMult",
    "mix",
    "normalize",
    "orientedAngle",
    "ortho",
    "orthonormalize",
    "outerProduct",
    "perp",
    "perspective",
    "perspectiveFov",
    "pitch",
    "polar",
    "proj",
    "project",
    "quat",
    "quatLookAt",
    "quatLookAtRH",
    "quat_cast",
    "reflect",
    "refract",
    "roll",
    "rotate",
    "rotateX",
    "rotateY",
    "rotateZ",
    "rotation",
    "row",
    "scale",
    "shortMix",
    "slerp",
    "sphericalRand",
    "toMat3",
    "toMat4",
    "toQuat",
    "translate",
    "transpose",
    "triangleNormal",
    "u16vec2",
    "u16vec3",
    "u16vec4",
    "unProject",
    "vec2",
    "vec3",
    "vec4",
    "yaw",
]
_ERRORS = (ArithmeticError, AttributeError, IndexError, ValueError, np.linalg.LinAlgError)


@contextmanager
def _as_runtime_error(name: str) -> Iterator[None]:
    """Raises RuntimeError, as all errors here are, where there is no result: a division by 0."""
    try:
        yield
    except _ERRORS as error:
        raise RuntimeError(f"{name}: {error}") from error


for _name in __all__:
    if inspect.isfunction(globals()[_name]):
        globals()[_name] = _as_runtime_error(_name)(globals()[_name])

__all__ += CONSTANTS
__all__ += ELEMENTWISE
