"""Volumes through the client: arrays and files give the same picture; what is bad is refused."""

from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
import volume_files as files
from refusals import NAN, check, edited

ASSETS = Path(__file__).parent.parent / "assets/volume"
LINK = ASSETS.parent / "mesh/link_6.stl"
PLANES = ["beauty", "depth", "instance", "direct_volume"]
SCALE, ORIGIN = 0.25, (-1.0, -1.0, -1.0)
TRANSLATION = tuple(o + 0.5 * SCALE for o in ORIGIN)  # samples lie at the voxels' centres


@pytest.fixture(scope="module")
def brick():
    """8^3 voxels, 0 at the faces: a file's grid fades to 0 there. Multiples of 1/8, below 2."""
    values = np.zeros((8, 8, 8), "f4")
    values[1:7, 1:7, 1:7] = np.random.default_rng(3).integers(1, 16, (6, 6, 6)) / 8
    return values


def shot(client, put):
    """A picture of what put(edit) makes, with the label 3."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=1.0)
            lens = hg.Camera.from_fov(45, 32, 24, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((1, -4, 2), (0, 0, 0)))
            put(edit)
        return scene.render("cam", spp=16, planes=PLANES)


def of_array(density, **medium):
    def put(edit):
        medium.setdefault("voxel_size", SCALE)
        volume = edit.volume("smoke", density=density, origin=ORIGIN, **medium)
        edit.entity("smoke/0", volume=volume, label=3)

    return put


def of_file(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    return lambda edit: edit.import_file(path, label=3)


def assert_same(a, b):
    for plane in PLANES:
        np.testing.assert_array_equal(a[plane], b[plane], plane)


@pytest.mark.parametrize("kind", [files.FLOAT, files.FP4, files.FP8, files.FP16, files.FPN])
@pytest.mark.parametrize("packed", [False, True])
def test_nanovdb_files_and_arrays_are_the_same(client, brick, tmp_path, kind, packed):
    data = files.nvdb(brick, SCALE, TRANSLATION, kind, packed)
    expected = shot(client, of_array(brick))
    assert (expected["instance"] == 3).any()
    assert_same(shot(client, of_file(tmp_path, "a.nvdb", data)), expected)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("compression", [0, files.ZIP, files.ACTIVE_MASK, 3])
def test_openvdb_files_and_arrays_are_the_same(client, brick, tmp_path, compression, half):
    data = files.vdb(brick, SCALE, TRANSLATION, compression, half)
    assert_same(shot(client, of_file(tmp_path, "a.vdb", data)), shot(client, of_array(brick)))


@pytest.mark.parametrize("compression", [0, files.ZIP])
def test_openvdb_files_of_an_old_version_are_read(client, brick, tmp_path, compression):
    data = files.vdb(brick, SCALE, TRANSLATION, compression, version=files.OLD)
    assert_same(shot(client, of_file(tmp_path, "a.vdb", data)), shot(client, of_array(brick)))


def test_openvdb_itself_wrote_what_is_read(client):
    """Blosc, a temperature in halves, a vector grid."""
    density = np.load(ASSETS / "smoke.npz")["density"].astype("f4") / 64
    on = (density > 0)[..., None]
    look = {"temperature_scale": 4.0, "emission_scale": 1e-3}

    def from_file(edit):
        edit.import_file(ASSETS / "smoke.vdb", name="smoke", label=3)
        edit.volume("smoke/smoke", **look)

    def from_arrays(edit):
        voxel = np.array([0.125, 0.125, 0.25])
        volume = edit.volume(
            "smoke",
            density=density,
            temperature=512 * density,
            color=np.stack([on[..., 0], density, 1 - density], axis=-1) * on,
            voxel_size=voxel,
            origin=np.array([0.5, -1, 0.25]) - voxel / 2,
            **look,
        )
        edit.entity("smoke/0", volume=volume, label=3)

    assert_same(shot(client, from_file), shot(client, from_arrays))


def test_level_sets_become_fog(client, brick, tmp_path):
    distance = 1 - brick  # voxels; negative inside
    data = files.vdb(distance, SCALE, TRANSLATION, kind="level set", background=1.0)
    put = of_file(tmp_path, "a.vdb", data)
    assets = []
    frame = shot(client, lambda edit: assets.append(put(edit)))
    assert any("level set" in warning for warning in assets[0].warnings)
    assert_same(frame, shot(client, of_array(np.clip(brick - 1, 0, 1))))


def test_level_sets_become_a_mesh(scene, tmp_path):
    """A ball of 2.5 voxels is seen where it is; what has no level set is refused by name."""
    radius, band = 2.5, 3.0
    place = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1) - 3.5
    distance = np.clip(np.linalg.norm(place, axis=-1) - radius, -band, band).astype("f4")
    ball, fog = tmp_path / "ball.vdb", tmp_path / "fog.vdb"
    ball.write_bytes(files.vdb(distance, SCALE, TRANSLATION, kind="level set", background=band))
    fog.write_bytes(files.vdb(distance + band, SCALE, TRANSLATION))
    with scene.edit() as edit:
        asset = edit.import_file(ball, surface=True, label=3)
        lens = hg.Camera.from_fov(45, 33, 33, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -4, 0), (0, 0, 0)))
    assert not asset.warnings and len(asset.meshes) == 1
    frame = scene.render("cam", planes=["depth", "normal", "instance"])
    assert frame["instance"][16, 16] == 3
    assert frame["depth"][16, 16] == pytest.approx(4 - radius * SCALE, abs=0.15 * SCALE)
    np.testing.assert_allclose(frame["normal"][16, 16], (0, -1, 0), atol=0.02)
    for path, message in (fog, "no grid is a level set"), (LINK, "other files have none"):
        with (
            pytest.raises(hg.InvalidArgument, match=f"surface: .*{message}"),
            scene.edit() as edit,
        ):
            edit.import_file(path, surface=True)


def test_axes_say_how_arrays_run(client, brick):
    expected = shot(client, of_array(brick))
    assert_same(shot(client, of_array(brick.transpose(2, 1, 0), axes="zyx")), expected)
    assert_same(shot(client, of_array(brick.transpose(1, 0, 2), axes="yxz")), expected)
    turned = shot(client, of_array(brick.transpose(2, 1, 0)))
    assert (turned["beauty"] != expected["beauty"]).any()


def test_arrays_of_other_sizes_fill_the_same_box(client, brick):
    color = np.zeros((2, 1, 1, 3))
    color[0] = 1, 0, 0
    color[1] = 0, 1, 0
    frame = shot(client, of_array(brick, color=color, albedo=1.0))
    left, right = frame["direct_volume"][:, :12], frame["direct_volume"][:, 20:]
    assert left[..., 0].sum() > 2 * left[..., 1].sum()
    assert right[..., 1].sum() > 2 * right[..., 0].sum()
    assert frame["direct_volume"][..., 2].max() == 0


def test_scenes_with_volumes_come_back_from_their_file(client, brick, tmp_path):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(color=1.0)
            camera = hg.Camera.from_fov(45, 32, 24, degrees=True)
            edit.entity("cam", camera=camera, transform=hg.look_at((1, -4, 2), (0, 0, 0)))
            of_array(brick, temperature=1000 * brick, anisotropy=0.5)(edit)
        before = scene.render("cam", spp=4, planes=PLANES)
        assert scene["smoke"].parameters["anisotropy"] == 0.5
        scene.save(tmp_path / "scene.helio")
    with client.load_scene(tmp_path / "scene.helio") as scene:
        assert_same(scene.render("cam", spp=4, planes=PLANES), before)


def test_parameters_change_field_by_field(client, brick):
    def put(edit):
        of_array(brick, density_scale=5.0, albedo=0.3)(edit)
        edit.volume("smoke", density_scale=None, albedo=0.8)

    assert_same(shot(client, put), shot(client, of_array(brick)))


def test_a_volume_moves_with_its_entity(client, brick):
    """Backward flow of its pixels is the motion of the point that they show."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            lens = hg.Camera(width=64, height=64, fx=64, fy=64, cx=31.5, cy=31.5)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -4, 0), (0, 0, 0)))
            of_array(brick, density_scale=4.0)(edit)
        with scene.edit() as edit:
            edit.advance(0.1)
            edit.update("smoke/0", transform=hg.Pose((0.1, 0, 0)))
        frame = scene.render("cam", planes=["instance", "depth", "flow_backward", "position"])
        own = frame["instance"] == 3
        assert own.sum() > 100
        np.testing.assert_allclose(
            frame["flow_backward"][own][:, 0], -0.1 * 64 / frame["depth"][own], rtol=1e-4
        )
        np.testing.assert_allclose(frame["flow_backward"][own][:, 1], 0, atol=1e-4)


def test_amodal_labels_see_a_volume_behind_a_surface(client, brick):
    labels = ["boxes", "amodal", "amodal_masks"]
    with client.create_scene() as scene:
        with scene.edit() as edit:
            lens = hg.Camera(width=64, height=64, fx=64, fy=64, cx=31.5, cy=31.5)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -4, 0), (0, 0, 0)))
            of_array(brick, density_scale=4.0)(edit)
        alone = scene.render("cam", planes=["instance"], labels=labels)
        own = alone["instance"] == 3
        np.testing.assert_array_equal(alone.amodal_mask(3), own)
        assert alone.labels["inside"][0] == alone.labels["visible"][0] == own.sum() > 100
        with scene.edit() as edit:
            wall = edit.mesh("wall", **hg.shapes.plane(2))
            upright = np.array([[1, 0, 0, -1], [0, 0, -1, -2], [0, 1, 0, 0], [0, 0, 0, 1.0]])
            edit.entity("wall/0", mesh=wall, transform=upright, label=5)
        hidden = scene.render("cam", planes=["instance"], labels=labels)
        np.testing.assert_array_equal(hidden.amodal_mask(3), own)
        left = hidden["instance"] == 3
        assert 0 < left.sum() < own.sum() and not (left & ~own).any()
        assert hidden.labels["visible"][0] == left.sum()
        assert hidden.labels["inside"][0] == own.sum()


CUBE = np.ones((2, 2, 2))
ROWS = {
    "flat": ({"density": np.ones((4, 4))}, hg.InvalidArgument, "density", "needs shape"),
    "empty": ({"density": np.ones((4, 0, 4))}, hg.InvalidArgument, "density", "axis 1"),
    "negative": ({"density": -CUBE}, hg.InvalidArgument, "density.values[0][0][0]", "0 or more"),
    "nan": ({"density": NAN * CUBE}, hg.InvalidArgument, "density[0][0][0]", "finite"),
    "no density": ({"albedo": 0.5}, hg.InvalidArgument, "density", "needs density"),
    "no box": ({"temperature": CUBE}, hg.InvalidArgument, "density", "give density"),
    "color": ({"density": CUBE, "color": np.full((1, 1, 1, 3), 2)}, hg.InvalidArgument,
              "color.values", "0 to 1"),
    "color shape": ({"density": CUBE, "color": CUBE}, hg.InvalidArgument, "color", "needs shape"),
    "albedo": ({"density": CUBE, "albedo": 1.5}, hg.InvalidArgument, "albedo", "0"),
    "anisotropy": ({"density": CUBE, "anisotropy": 1}, hg.InvalidArgument, "anisotropy", "0.99"),
    "scale": ({"density": CUBE, "density_scale": -1}, hg.InvalidArgument, "density_scale", "0"),
    "kelvin": ({"density": CUBE, "temperature_scale": -1}, hg.InvalidArgument,
               "temperature_scale", "0"),
    "glow": ({"density": CUBE, "emission_scale": NAN}, hg.InvalidArgument, "emission_scale", ""),
    "voxels": ({"density": CUBE, "voxel_size": 0}, hg.InvalidArgument, "voxel_size", "above 0"),
    "origin": ({"density": CUBE, "origin": (0, 0)}, hg.InvalidArgument, "origin", "shape"),
    "axes": ({"density": CUBE, "axes": "xyw"}, hg.InvalidArgument, "axes", "some order"),
    "unknown": ({"dens": CUBE}, hg.InvalidArgument, "dens", "density"),
}  # fmt: skip


@pytest.mark.parametrize("row", ROWS)
def test_bad_volumes_are_refused(world, row):
    medium, kind, field, message = ROWS[row]
    check(world, edited(lambda edit: edit.volume("thing", **medium)), (kind, field), message)


def test_bad_files_are_refused(world, brick, tmp_path):
    nvdb = files.nvdb(brick, SCALE, TRANSLATION)
    vdb = files.vdb(brick, SCALE, TRANSLATION, files.ZIP)
    blosc = bytearray(nvdb)
    blosc[14] = 2
    old = bytearray(nvdb)
    old[8:12] = (29 << 21).to_bytes(4, "little")
    for name, data, kind, message in (
        ("a.nvdb", nvdb[:-100], hg.InvalidArgument, "truncated"),
        ("a.nvdb", bytes(blosc), hg.InvalidArgument, "density: compressed data is damaged"),
        ("a.nvdb", bytes(old), hg.Unimplemented, "version 29"),
        ("a.nvdb", b"not a volume" * 9, hg.InvalidArgument, "not a NanoVDB"),
        ("a.vdb", b"not a volume" * 9, hg.InvalidArgument, "not a VDB"),
        ("a.vdb", vdb[:-10], hg.InvalidArgument, "leaves the file"),
        ("a.vdb", vdb.replace(b"Tree_float", b"Tree_vec2s"), hg.InvalidArgument, "no grid"),
    ):
        put = of_file(tmp_path, name, data)
        check(world, edited(put), (kind, name), message)


def test_a_bomb_is_refused(world, brick, tmp_path):
    """A tile of 4096^3 voxels of fog takes a few bytes in a file."""
    data = bytearray(files.vdb(brick, SCALE, TRANSLATION))
    at = data.index((1).to_bytes(4, "little") + bytes(4) + bytes(4) + (1).to_bytes(4, "little"))
    data[at + 8 : at + 12] = (1).to_bytes(4, "little")  # one tile
    tile = np.array([4096, 0, 0], "<i4").tobytes() + np.float32(1).tobytes() + b"\1"
    data[at + 16 : at + 16] = tile
    for field in range(3):  # the grid grew: move the offsets behind it
        place = data.index(b"Tree_float_5_4_3") + 16 + 4 + 8 * field
        offset = int.from_bytes(data[place : place + 8], "little")
        data[place : place + 8] = (offset + (len(tile) if field else 0)).to_bytes(8, "little")
    put = of_file(tmp_path, "bomb.vdb", bytes(data))
    check(world, edited(put), (hg.ResourceExhausted, "bomb.vdb"), "decode_ limit")
