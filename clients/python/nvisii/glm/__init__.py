"""The types and functions of GLM that scripts use, under GLM's names."""

from .matrices import mat2, mat3, mat4
from .quaternions import angleAxis, quat
from .vectors import (
    ivec2,
    ivec3,
    ivec4,
    u16vec2,
    u16vec3,
    u16vec4,
    vec2,
    vec3,
    vec4,
)

__all__ = [
    "angleAxis",
    "ivec2",
    "ivec3",
    "ivec4",
    "mat2",
    "mat3",
    "mat4",
    "quat",
    "u16vec2",
    "u16vec3",
    "u16vec4",
    "vec2",
    "vec3",
    "vec4",
]
