"""import nvisii: scripts of its users, against a daemon."""

import os
import pathlib
import subprocess
import sys

import heliograph as hg
import numpy as np
import nvisii
import pytest
from nvisii_world import ball, rows
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]


def test_the_smallest_script_runs(tmp_path):
    script = (ROOT / "examples/nvisii_figure.py").read_text()
    assert script.count("samples_per_pixel=1024") == 1
    (tmp_path / "script.py").write_text(script.replace("1024", "4"))
    command = [sys.executable, "script.py"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    picture = np.asarray(Image.open(tmp_path / "image.png")).astype(float)
    assert picture.shape == (512, 512, 4) and (picture[..., 3] == 255).all()
    middle, corner = picture[200:300, 200:300].mean((0, 1)), picture[:40, :40].mean((0, 1))
    assert middle[2] > 1.3 * middle[0] and abs(middle - corner).max() > 20


def test_a_white_ball_under_a_white_dome_vanishes(camera):
    ball(base_color=(1, 1, 1), specular=0, roughness=1)
    image = rows(nvisii.render(48, 48, 256, seed=3), 48, 48)
    assert image.dtype == np.float32
    assert abs(image[..., :3].mean() - 1) < 0.01 and (image[..., 3] == 1).all()


def test_the_first_row_of_a_flat_array_is_the_bottom(camera):
    ball(position=(0, 0, -1), base_color=(0, 0, 0), specular=0)
    flat = nvisii.render(32, 32, 4)
    assert len(flat) == 32 * 32 * 4
    assert flat[: 16 * 32 * 4].mean() < flat[16 * 32 * 4 :].mean()


def test_ten_thousand_positions_are_one_message(camera, monkeypatch):
    mesh, look = nvisii.mesh.create_sphere("m", 0.01, 4, 4), nvisii.material.create("m")
    places = [nvisii.transform.create(f"t{i}") for i in range(10_000)]
    for i, place in enumerate(places):
        nvisii.entity.create(f"e{i}", transform=place, mesh=mesh, material=look)
    nvisii.render(8, 8, 1)
    sent = []
    scene = nvisii.session.session().mirror.scene
    apply = type(scene).apply
    monkeypatch.setattr(
        type(scene), "apply", lambda self, t, e=None: (sent.append(t), apply(self, t, e))[1]
    )
    for i, place in enumerate(places):
        place.set_position((i % 100 * 0.03 - 1.5, 0, i // 100 * 0.03 - 1.5))
    nvisii.render(8, 8, 1)
    (transaction,) = sent
    assert [edit.WhichOneof("action") for edit in transaction.edits] == ["poses"]
    lattice = scene["e205"].world_transform
    assert np.allclose(lattice[:3, 3], (-1.35, 0, -1.44), atol=1e-6)
    sent.clear()
    nvisii.render(8, 8, 1)
    assert sent == []


def test_components_are_shared_swapped_and_removed(camera):
    thing = ball(base_color=(0, 0, 0), specular=0)

    def middle():
        return rows(nvisii.render(17, 17, 4), 17, 17)[8, 8, :3].tolist()

    assert middle() == pytest.approx([0, 0, 0], abs=0.02)
    nvisii.material.get("ball").set_base_color((1, 0, 0))
    red = middle()
    assert red[0] > 0.5 and red[1] < 0.05
    thing.clear_mesh()
    assert middle() == [1, 1, 1]
    thing.set_mesh(nvisii.mesh.get("ball"))
    assert middle() == pytest.approx(red, abs=0.1)
    nvisii.transform.get("ball").set_position((3, 0, 0))
    assert middle() == [1, 1, 1]
    nvisii.entity.remove("ball")
    nvisii.mesh.remove("ball")
    nvisii.transform.remove("ball")
    nvisii.material.remove("ball")
    ball(base_color=(0, 1, 0), specular=0)
    assert middle()[1] > 0.5


def test_the_daemon_of_the_environment_is_used(client):
    program = (
        "import nvisii; nvisii.initialize(headless=True); "
        "print(nvisii.session.session().client.address)"
    )
    environment = {**os.environ, "HELIOGRAPH_ADDRESS": client.address}
    run = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True
    )
    assert run.stdout.strip() == client.address, run.stderr


def test_what_is_missing_is_a_runtime_error():
    with pytest.raises(RuntimeError, match="not initialized"):
        nvisii.render(8, 8, 1)
    nvisii.initialize(headless=True)
    try:
        with pytest.raises(RuntimeError, match="already initialized"):
            nvisii.initialize(headless=True)
        with pytest.raises(RuntimeError, match="set_camera_entity"):
            nvisii.render(8, 8, 1)
        assert nvisii.should_window_close() is True
    finally:
        nvisii.deinitialize()


def test_a_private_daemon_keeps_no_picture_of_before():
    nvisii.initialize(headless=True)
    try:
        place = nvisii.transform.create("eye")
        eye = nvisii.entity.create("eye", transform=place, camera=nvisii.camera.create("eye"))
        nvisii.set_camera_entity(eye)
        nvisii.render(8, 8, 1)
        mirror = nvisii.session.session().mirror
        before = mirror.scene.revision
        ball()
        nvisii.render(8, 8, 1)
        with pytest.raises(hg.HeliographError, match="revision"):
            mirror.scene.render(mirror._camera, revision=before)
    finally:
        nvisii.deinitialize()


def test_a_second_session_has_its_dome_again():
    for _ in range(2):
        nvisii.initialize(headless=True)
        try:
            eye = nvisii.entity.create(
                "eye", transform=nvisii.transform.create("eye"), camera=nvisii.camera.create("eye")
            )
            nvisii.set_camera_entity(eye)
            assert nvisii.render(8, 8, 1)[:3].min() > 0.05  # the sky that is there by default
        finally:
            nvisii.deinitialize()


def test_old_names_of_render_to_file(camera, tmp_path):
    for name, render in (("a.png", nvisii.render_to_png), ("a.hdr", nvisii.render_to_hdr)):
        render(8, 8, 1, image_path=str(tmp_path / name))
        assert (tmp_path / name).stat().st_size > 60


def test_max_entities_limits_nothing(camera):
    mesh, look = nvisii.mesh.create_box("m", (0.01,) * 3), nvisii.material.create("m")
    for i in range(11_000):
        place = nvisii.transform.create(f"t{i}", position=(i % 160 * 0.02 - 1.6, 0, i * 1e-4))
        nvisii.entity.create(f"e{i}", transform=place, mesh=mesh, material=look)
    ids = np.array(nvisii.render_data(16, 16, 0, 1, 0, "entity_id")).reshape(16, 16, 4)[..., 0]
    assert (ids < 11_001).any()


def test_randomized_scenes_do_not_grow_in_the_daemon(camera):
    fog = nvisii.volume.create_from_data("fog", 4, 4, 4, np.ones(64), 0.0)
    cloud = nvisii.entity.create(
        "cloud",
        transform=nvisii.transform.create("cloud", scale=(0.1, 0.1, 0.1)),
        volume=fog,
        material=nvisii.material.create("cloud"),
    )
    scene = nvisii.session.session().mirror.scene
    sizes = []
    for i in range(4):
        nvisii.set_dome_light_sky((i, 1, 2))
        cloud.get_transform().set_position((0.1 * i, 0, 0))
        ball(f"ball{i}", radius=0.1 + 0.1 * i)
        nvisii.render(8, 8, 1)
        sizes.append(len(scene.find("*")))
        for kind in (nvisii.entity, nvisii.mesh, nvisii.material, nvisii.transform):
            kind.remove(f"ball{i}")
    assert len(set(sizes)) == 1


def test_a_scale_of_0_is_flat_or_nothing(camera):
    thing = ball(base_color=(0, 0, 0), specular=0, roughness=1)
    place = thing.get_transform()

    def dark():
        image = rows(nvisii.render(32, 32, 4), 32, 32)[..., :3].mean(axis=2)
        return int((image < 0.5).sum())

    whole = dark()
    place.set_scale((1, 0, 1))
    assert 0.8 * whole < dark() < whole
    place.set_scale((0, 0, 0))
    assert dark() == 0
    place.set_scale((1, 1, 0), previous=True)
    nvisii.render_data(8, 8, 0, 1, 0, "diffuse_motion_vectors")
    place.clear_motion()
    place.set_parent(nvisii.transform.create("above", scale=(0, 1, 1)))
    place.set_scale((1, 1, 1))
    assert dark() < whole / 8
    nvisii.transform.remove("above")
    assert dark() == whole


def test_a_volume_of_scale_0_shows_nothing(camera):
    place = nvisii.transform.create("fog", scale=(0, 0, 0))
    fog = nvisii.volume.create_from_data("fog", 4, 4, 4, np.ones(64), 0.0)
    look = nvisii.material.create("fog", base_color=(0, 0, 0))
    nvisii.entity.create("fog", transform=place, volume=fog, material=look)
    assert nvisii.render(9, 9, 4).min() == 1
    place.set_scale((0.3, 0.3, 0.3))
    assert nvisii.render(9, 9, 4).min() < 0.5
