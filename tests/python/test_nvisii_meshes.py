"""nvisii.mesh: how many vertices, which way they face, arrays of users; it needs no daemon."""

import math

import numpy as np
import nvisii
import pytest

# Vertices and triangles: tensor products of segments.
COUNTS = {
    "box": (24, 12),
    "rounded_box": (24 + 12 * 5 * 2 + 8 * 25, 12 + 12 * 8 + 8 * 32),
    "plane": (81, 128),
    "sphere": (33 * 17, 2 * 32 * 16),
    "icosphere": (20 * 15, 20 * 16),
    "icosahedron": (60, 20),
    "dodecahedron": (12 * 6, 12 * 5),
    "cylinder": (33 * 9, 2 * 32 * 8),
    "capped_cylinder": (33 * 2 + 2 * 33 * 2, 3 * 64),
    "cone": (33 * 9, 2 * 32 * 8),
    "capped_cone": (33 * 9 + 33 * 5, 2 * 32 * 12),
    "spherical_cone": (33 * 9 + 33 * 5, 2 * 32 * 12),
    "capsule": (33 * (5 + 9 + 9), 2 * 32 * 20),
    "tube": (2 * 33 * 9, 4 * 32 * 8),
    "capped_tube": (2 * 33 * 9 + 2 * 33 * 2, 4 * 32 * 8 + 4 * 32),
    "disk": (33 * 5, 2 * 32 * 4),
    "torus": (17 * 33, 2 * 16 * 32),
    "torus_knot": (9 * 97, 2 * 8 * 96),
    "spring": (9 * 33, 2 * 8 * 32),
    "teapotahedron": (32 * 81, 32 * 128),
    "triangle": (15, 16),
    "triangle_from_circumscribed_circle": (15, 16),
    "spherical_triangle_from_sphere": (15, 16),
    "spherical_triangle_from_triangle": (15, 16),
    "convex_polygon_from_circle": (1 + 4 * 5 * 4, 20 + 3 * 40),
    "wireframe_bounding_box": (12 * 24, 12 * 12),
}
# Volumes of what is closed, by formula; tessellated ones are smaller, by so much.
VOLUMES = {
    "box": (8, 0),
    "sphere": (4 / 3 * math.pi, 0.02),
    "icosphere": (4 / 3 * math.pi, 0.04),
    "capped_cylinder": (2 * math.pi, 0.01),
    "capped_cone": (2 / 3 * math.pi, 0.01),
    "capsule": (4 / 3 * math.pi + math.pi, 0.02),
    "capped_tube": (2 * math.pi * (1 - 0.75**2), 0.01),
    "torus": (2 * math.pi**2 * 0.25**2, 0.04),
    "rounded_box": (1.5**3 + 6 * 1.5**2 / 4 + 3 * math.pi * 1.5 / 16 + 4 / 3 * math.pi / 64, 0.01),
}
PATH = [(-1, 0, 0), (0, 0, 0.5), (1, 1, 0.5)]


@pytest.fixture(autouse=True)
def empty():
    yield
    nvisii.clear_all()


def check_faces(mesh):
    """Unit normals on the side from which triangles run counter-clockwise."""
    points = np.array(mesh.get_vertices())
    normals = np.array([list(n) for n in mesh.get_normals()])[:, :3]
    faces = np.array(mesh.get_triangle_indices()).reshape(-1, 3)
    a, b, c = (points[faces[:, i]] for i in range(3))
    flat = np.cross(b - a, c - a)
    large = np.linalg.norm(flat, axis=1) > 1e-6
    facing = (flat * normals[faces].mean(axis=1)).sum(axis=1)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    assert (facing[large] > 0).all()
    assert len(mesh.get_tex_coords()) == len(mesh.get_tangents()) == len(points)
    return float((np.cross(a, b) * c).sum() / 6)


@pytest.mark.parametrize("name", COUNTS)
def test_counts_and_faces(name):
    mesh = getattr(nvisii.mesh, f"create_{name}")("m")
    assert (len(mesh.get_vertices()), len(mesh.get_triangle_indices()) // 3) == COUNTS[name]
    volume = check_faces(mesh)
    if name in VOLUMES:
        exact, loss = VOLUMES[name]
        assert exact * (1 - loss) - 1e-6 <= volume <= exact + 1e-6


@pytest.mark.parametrize(
    ("name", "arguments", "vertices"),
    [
        ("convex_polygon", {"vertices": [(0, 0), (2, 0), (2, 1), (0, 1)], "rings": 2}, 9),
        ("line", {"start": (0, 0, 0), "stop": (0, 0, 2), "radius": 0.1}, 2 * 17),
        ("tube_from_polyline", {"path": PATH, "radius": 0.1}, 3 * 17),
        ("rectangle_tube_from_polyline", {"path": PATH, "size": (0.1, 0.2)}, 3 * 36),
        (
            "rounded_rectangle_tube_from_polyline",
            {"path": PATH, "radius": 0.05, "size": (0.1, 0.2)},
            3 * (36 + 4 * 5),
        ),
    ],
)
def test_polygons_and_tubes(name, arguments, vertices):
    mesh = getattr(nvisii.mesh, f"create_{name}")("m", **arguments)
    assert len(mesh.get_vertices()) == vertices
    check_faces(mesh)


def test_sizes_are_halves_and_sweeps_cut():
    box = nvisii.mesh.create_box("b", size=(1, 2, 3))
    assert box.get_min_aabb_corner() == [-1, -2, -3] and box.get_max_aabb_corner() == [1, 2, 3]
    assert box.get_center() == [0, 0, 0] and box.get_aabb_center() == [0, 0, 0]
    assert box.get_bounding_sphere_radius() == pytest.approx(math.sqrt(14))
    half = nvisii.mesh.create_sphere("h", 2.0, sliceSweep=math.pi, segmentSweep=math.pi / 2)
    assert half.get_min_aabb_corner() == pytest.approx([-2, 0, 0], abs=1e-6)
    assert half.get_max_aabb_corner() == pytest.approx([2, 2, 2], abs=1e-6)
    down = nvisii.mesh.create_plane("p", flip_z=True)
    assert down.get_normals()[0] == [0, 0, -1, 0]
    cylinder = nvisii.mesh.create_cylinder("c", radius=0.5, size=2)
    assert cylinder.get_max_aabb_corner() == pytest.approx([0.5, 0.5, 2])


def test_arrays_of_users():
    square = [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]
    made = nvisii.mesh.create_from_data(
        "indexed", positions=square, indices=[0, 1, 2, 0, 2, 3], texcoords=[0, 0, 1, 0, 1, 1, 0, 1]
    )
    assert made.get_vertices()[2] == [1, 1, 0]
    assert made.get_normals()[0] == pytest.approx([0, 0, 1, 0])
    assert made.get_tangents()[0] == pytest.approx([1, 0, 0, 1])
    assert made.get_tex_coords()[1] == [1, 0]
    assert made.get_triangle_indices() == [0, 1, 2, 0, 2, 3]
    corners = np.array(square, "f4").reshape(4, 3)
    soup = nvisii.mesh.create_from_data("soup", positions=corners[[0, 1, 2, 0, 2, 3]])
    assert len(soup.get_vertices()) == 4 and soup.get_triangle_indices() == [0, 1, 2, 0, 2, 3]
    wide = nvisii.mesh.create_from_data(
        "wide",
        positions=np.column_stack([corners, np.ones(4)]),
        position_dimensions=4,
        normals=[0, 0, 1, 0] * 4,
        normal_dimensions=4,
        colors=[1, 0, 0] * 4,
        indices=[0, 1, 2],
    )
    assert wide.get_vertices() == corners.tolist() and wide.get_colors()[3] == [1, 0, 0, 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"positions": [0, 0, 0, 1]}, "no multiple of 3"),
        ({"positions": [0.0] * 12}, "no whole triangles"),
        ({"positions": [0.0] * 9, "indices": [0, 1]}, "no whole triangles"),
        ({"positions": [0.0] * 9, "indices": [0, 1, 3]}, r"must be in \[0, 3\)"),
        ({"positions": [0.0] * 9, "normals": [0, 0, 1]}, "1 for 3 positions"),
        ({"positions": [0.0] * 9, "position_dimensions": 2}, "3 or 4 dimensions"),
        ({"positions": [math.nan] * 9}, "finite"),
        ({"positions": ["a"] * 9}, "positions: needs numbers"),
        ({"positions": [[0, 0, 0], [1]]}, "positions: needs numbers"),
    ],
)
def test_wrong_arrays_are_refused(arguments, message):
    with pytest.raises(RuntimeError, match=message):
        nvisii.mesh.create_from_data("m", **arguments)
    assert nvisii.mesh.get("m") is None


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("sphere", {"radius": 1e39}),
        ("disk", {"radius": 0}),
        ("torus_knot", {"p": 0, "q": 0}),
        ("icosphere", {"radius": -1}),
        ("icosahedron", {"radius": -1}),
        ("dodecahedron", {"radius": 0}),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_sizes_without_a_surface_are_refused(name, arguments):
    with pytest.raises(RuntimeError, match="no surface|not above 0"):
        getattr(nvisii.mesh, f"create_{name}")("m", **arguments)
    assert nvisii.mesh.get("m") is None


def test_normals_can_be_made_smooth():
    mesh = nvisii.mesh.create_from_data(
        "roof",
        positions=[-1, 0, 0, 1, 0, 0, 0, 1, 1, 0, -1, 1],
        normals=[1, 0, 0] * 4,
        indices=[0, 1, 2, 1, 0, 3],
    )
    mesh.generate_smooth_normals()
    assert mesh.get_normals()[0] == pytest.approx([0, 0, 1, 0], abs=1e-6)
    mesh.generate_smooth_tangents()
    mesh.compute_metadata()
    assert mesh.get_center() == [0, 0, 0.5]
