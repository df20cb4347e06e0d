"""BasisCurves of USD files as round curves."""

from __future__ import annotations

import numpy as np
import pytest
import stages

pytest.importorskip("pxr", reason="the extra `usd` is not installed")

LINEAR = """
def BasisCurves "Linear"
{
    uniform token type = "linear"
    int[] curveVertexCounts = [2, 3]
    point3f[] points = [(-0.5, -0.5, 0), (0.5, -0.5, 0), (-0.5, 0.5, 0), (0, 0.5, 0), (0.5, 0.5, 0)]
    float[] widths = [0.2, 0.4] (interpolation = "uniform")
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "uniform")
}
"""


def cubic(basis, points, wrap="nonperiodic", more=""):
    return f"""
def BasisCurves "Cubic"
{{
    uniform token basis = "{basis}"
    uniform token wrap = "{wrap}"
    int[] curveVertexCounts = [{len(points)}]
    point3f[] points = [{", ".join(str(tuple(p)) for p in points)}]
    float[] widths = [0.1] (interpolation = "constant")
    {more}
}}
"""


def test_linear_curves_have_their_widths_and_colors(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, LINEAR))
    mesh = asset.entities["/Linear"].mesh
    curves, radii = scene.read([mesh], ["mesh.curves", "mesh.radii"])[0]
    assert curves.tolist() == [2, 3] and asset.warnings == []
    np.testing.assert_allclose(radii, [0.1, 0.1, 0.2, 0.2, 0.2])
    frame = scene.render("above", spp=1, planes=["depth", "base_color"])
    for y, radius, color in ((-0.5, 0.1, (1, 0, 0)), (0.5, 0.2, (0, 1, 0))):
        row, column = 31 - int(np.floor(y * 32)), 32
        beside = (31.5 - row) / 32 - y
        z = np.sqrt(radius**2 - beside**2)
        assert frame["depth"][row, column] == pytest.approx(2 - z, abs=1e-5)
        np.testing.assert_allclose(frame["base_color"][row, column], color, atol=1e-5)


@pytest.mark.parametrize(
    ("basis", "wrap", "ends"),
    [
        ("bezier", "nonperiodic", [(-0.6, 0, 0), (0.6, 0, 0)]),
        ("catmullRom", "nonperiodic", [(-0.2, 0.6, 0), (0.2, 0.6, 0)]),
        ("catmullRom", "pinned", [(-0.6, 0, 0), (0.6, 0, 0)]),
        ("bspline", "pinned", [(-0.6, 0, 0), (0.6, 0, 0)]),
        ("bspline", "nonperiodic", [(-0.2, 0.5, 0), (0.2, 0.5, 0)]),
    ],
)
def test_cubic_curves_begin_and_end_where_their_bases_say(scene, tmp_path, basis, wrap, ends):
    points = [(-0.6, 0, 0), (-0.2, 0.6, 0), (0.2, 0.6, 0), (0.6, 0, 0)]
    asset = stages.put(scene, stages.written(tmp_path, cubic(basis, points, wrap)))
    mesh = asset.entities["/Cubic"].mesh
    found = mesh.positions[[0, -1]]
    np.testing.assert_allclose(found, ends, atol=1e-6)
    np.testing.assert_allclose(scene.read([mesh], ["mesh.radii"])[0][0], 0.05)


def test_points_that_move_are_keys(scene, tmp_path):
    points = [(-0.5, 0, 0), (-0.2, 0, 0), (0.2, 0, 0), (0.5, 0, 0)]
    more = """
    point3f[] points.timeSamples = {
        0: [(-0.5, 0, 0), (-0.2, 0, 0), (0.2, 0, 0), (0.5, 0, 0)],
        24: [(-0.5, 0.5, 0), (-0.2, 0.5, 0), (0.2, 0.5, 0), (0.5, 0.5, 0)],
    }"""
    path = stages.written(tmp_path, cubic("bezier", points, more=more))
    asset = stages.put(scene, path, times="all")
    mesh = asset.entities["/Cubic"].mesh
    assert mesh.positions.shape[0] == 2
    moved = mesh.positions[1] - mesh.positions[0]
    np.testing.assert_allclose(moved, np.broadcast_to((0, 0.5, 0), moved.shape), atol=1e-6)


@pytest.mark.parametrize(
    ("body", "warning"),
    [
        (cubic("bezier", [(0, 0, 0), (1, 0, 0), (1, 1, 0)]), "too few points for bezier"),
        (cubic("hermite", [(0, 0, 0)] * 4), "basis hermite"),
        (LINEAR.replace("[2, 3]", "[2, 2]"), "counts do not fit"),
        (LINEAR.replace("0.2, 0.4", "0.2, 0"), "widths that are not above 0"),
        (LINEAR.replace("float[] widths", "float[] others"), "it has no widths"),
    ],
)
def test_what_is_left_out_is_told(scene, tmp_path, body, warning):
    asset = stages.put(scene, stages.written(tmp_path, body))
    assert any(warning in text for text in asset.warnings), asset.warnings
