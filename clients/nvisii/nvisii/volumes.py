"""nvisii.volume: densities on a grid of voxels; one voxel is one unit of the entity's space."""

from __future__ import annotations

from typing import Any

import numpy as np

from .checks import above_zero, array, not_below_zero, number, whole
from .component import Component
from .glm.vectors import Numbers, floats, vec3
from .nodes import Nodes

_DENSEST = 1e9  # the largest density_scale, 1/m


class volume(Component):
    """Fog: it absorbs and scatters. An entity's transform usually scales it down."""

    def __init__(self, name: str, density: Any, origin: Any) -> None:
        super().__init__(name)
        self._density = density  # (X, Y, Z) float32
        self._origin = np.asarray(origin, dtype=float)  # lower corner of voxel [0, 0, 0]
        self._scale = 1.0
        self._scattering = 0.5
        self._absorption = 0.5
        self._gradient_factor = 0.5
        self._nodes: Nodes | None = None

    @classmethod
    def create_from_data(
        cls, name: str, width: int, height: int, depth: int, data: Any, background: float
    ) -> volume:
        """width * height * depth densities, x fastest, centred on the origin; values that equal
        the background are empty."""
        width, height = whole("width", width, 1), whole("height", height, 1)
        depth = whole("depth", depth, 1)
        values = array("data", data, "f4")
        if values.size != width * height * depth:
            raise RuntimeError(
                f"volume.create_from_data: {width}x{height}x{depth} are "
                f"{width * height * depth} values, not {values.size}"
            )
        values = values.reshape(depth, height, width).transpose(2, 1, 0)
        empty = np.float32(number("background", background))
        density = np.where(values == empty, np.float32(0), values)
        return cls(name, density, _centered(density.shape))

    @classmethod
    def create_sphere(cls, name: str) -> volume:
        """Makes a fog sphere of radius 100."""
        return cls._fog(name, 100, lambda x, y, z: np.sqrt(x * x + y * y + z * z) - 100)

    @classmethod
    def create_torus(cls, name: str) -> volume:
        """About +Y; radius 100 to the middle of a tube of radius 50."""

        def distance(x: Any, y: Any, z: Any) -> Any:
            return np.sqrt((np.sqrt(x * x + z * z) - 100) ** 2 + y * y) - 50

        return cls._fog(name, 150, distance)

    @classmethod
    def create_box(
        cls,
        name: str,
        size: Numbers = (100.0, 100.0, 100.0),
        center: Numbers = (0.0, 0.0, 0.0),
        half_width: float = 3.0,
    ) -> volume:
        """size: of the sides, in voxels. half_width: of the soft rim."""
        half, middle = np.array(floats(size, 3, "size")) / 2, np.array(floats(center, 3, "center"))

        def distance(x: Any, y: Any, z: Any) -> Any:
            q = [np.abs(a - m) - h for a, m, h in zip((x, y, z), middle, half)]
            outside = np.sqrt(sum(np.maximum(a, 0) ** 2 for a in q))
            return outside + np.minimum(np.maximum(np.maximum(q[0], q[1]), q[2]), 0)

        reach = float((half + np.abs(middle)).max())
        return cls._fog(name, reach, distance, above_zero("half_width", half_width))

    @classmethod
    def create_octahedron(cls, name: str) -> volume:
        """Makes a fog octahedron of radius 50: corners on the axes."""

        def distance(x: Any, y: Any, z: Any) -> Any:
            return (np.abs(x) + np.abs(y) + np.abs(z) - 50) / np.sqrt(np.float32(3))

        return cls._fog(name, 50, distance)

    @classmethod
    def create_from_file(cls, name: str, path: str) -> volume:
        """A NanoVDB or OpenVDB file; its first grid, in voxels, about the middle of its box."""
        from .models import read_volume

        density = read_volume(path)
        return cls(name, density, _centered(density.shape))

    @classmethod
    def _fog(cls, name: str, reach: float, distance: Any, half_width: float = 3.0) -> volume:
        """Density 0 at the surface, 1 from half_width inside on."""
        n = int(np.ceil(reach))
        axis = np.arange(-n, n + 1, dtype="f4")
        x, y, z = np.meshgrid(axis, axis, axis, indexing="ij", sparse=True)
        density = np.clip(-distance(x, y, z) / np.float32(half_width), 0, 1).astype("f4")
        filled = [np.flatnonzero(density.any(axis=others)) for others in ((1, 2), (0, 2), (0, 1))]
        if min(map(len, filled)) == 0:
            raise RuntimeError(f'volume "{name}" has no voxel inside')
        used = tuple(slice(k[0], k[-1] + 1) for k in filled)
        low = np.array([k[0] for k in filled])
        return cls(name, np.ascontiguousarray(density[used]), low - n - 0.5)

    # ------------------------------------------------------------ the medium

    def set_scale(self, scale: float) -> None:
        """Scales the mean free path of light: 2 makes the volume half as dense."""
        self._scale = above_zero("scale", scale)
        self.mark_dirty()

    def set_scattering(self, scattering: float) -> None:
        """Scattering coefficient of density 1, per voxel."""
        self._scattering = not_below_zero("scattering", scattering)
        self.mark_dirty()

    def set_absorption(self, absorption: float) -> None:
        """Absorption coefficient of density 1, per voxel."""
        self._absorption = not_below_zero("absorption", absorption)
        self.mark_dirty()

    def set_gradient_factor(self, gradient_factor: float) -> None:
        """Kept; volumes here have no surfaces."""
        self._gradient_factor = number("gradient_factor", gradient_factor)

    def _grid(self) -> dict[str, Any]:
        """The arguments of Edits.volume that are its voxels."""
        return {
            "density": np.maximum(self._density, 0),
            "origin": self._origin,
            "voxel_size": 1.0,
        }

    def _medium(self, units: float, tint: Any) -> dict[str, Any]:
        """Arguments of the medium besides the grid. units: voxels per metre of the world. tint:
        (3,), of scattered light."""
        extinction = self._scattering + self._absorption
        albedo = self._scattering / extinction if extinction else 0.0
        return {
            "density_scale": min(extinction / self._scale * units, _DENSEST),
            "albedo": tuple(float(np.clip(albedo * c, 0, 1)) for c in tint),
        }

    # ------------------------------------------------------------ the tree

    def _tree(self) -> Nodes:
        if self._nodes is None:
            self._nodes = Nodes(self._density, self._origin)
        return self._nodes

    def get_grid_type(self) -> str:
        return "float"

    def get_node_count(self, level: int) -> int:
        """Nodes of a level: 0 leaves of 8^3 voxels, 1 of 128^3, 2 of 4096^3, 3 the root."""
        return len(self._tree().boxes(level))

    def get_min_aabb_corner(self, level: int, node_idx: int) -> Any:
        """Lower corner of the box about the voxels of a node that are not empty."""
        return vec3(*self._tree().box(level, node_idx)[0].tolist())

    def get_max_aabb_corner(self, level: int, node_idx: int) -> Any:
        return vec3(*self._tree().box(level, node_idx)[1].tolist())

    def get_aabb_center(self, level: int, node_idx: int) -> Any:
        return vec3(*self._tree().box(level, node_idx).mean(axis=0).tolist())

    def get_max(self, level: int, node_idx: int) -> float:
        """The largest density in a node."""
        return self._tree().largest(level, node_idx)

    def _bounds(self) -> Any:
        """(2, 3) float64."""
        return np.stack([self._origin, self._origin + self._density.shape])


def _centered(shape: Any) -> Any:
    return -0.5 * np.asarray(shape, dtype=float)
