"""Today's clients against a daemon of the next version: what they do not know they ignore."""

import os
import pathlib
import subprocess

import heliograph as hg
import newer_daemon
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd")).parent
PLANES = ["beauty", "depth", "normal", "instance"]


@pytest.fixture(scope="module")
def newer(client):
    with newer_daemon.before(client.address) as (address, proxy):
        yield address, proxy


def furnish(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.5))
        edit.texture("big", np.zeros((600, 600, 4), "u1"))
        edit.entity("ball", mesh=ball, category="ball", transform=hg.Pose((0, 0, 0.5)))
        model = ROOT / "tests/assets/gltf/simple-instancing.glb"
        edit.import_file(model, name="model", transform=hg.Pose((2, 0, 0)))
        lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))


def tour(client, tmp_path):
    """Everything that the Python client asks a daemon."""
    with client.create_scene("tour") as scene:
        furnish(scene)
        found = [scene.render("cam", planes=PLANES, spp=2)]
        found += [r.frame for r in scene.render_batch([hg.Job("cam", planes=PLANES, spp=2)])]
        with scene.stream("cam", planes=PLANES, spp=2, policy="lossless") as live:
            live.finish()
            found += list(live)
        scene.save(tmp_path / "tour.helio")
        with client.load_scene(tmp_path / "tour.helio") as loaded, scene.branch() as branch:
            found += [s.render("cam", planes=PLANES, spp=2) for s in (loaded, branch)]
        hits = scene.cast_rays([[0.05, 0.02, 3]], [[0, 0, -1]])
        assert hits.t[0] == pytest.approx(2, abs=0.01)
        tracks = scene.tracks("cam", hits, [0.0])
        assert tracks["depth"].shape == (1, 1)
        assert scene["ball"].transform[2, 3] == 0.5 and client.open_scene("tour").revision == 1
        assert "ball" in scene.tree() and client.info().version and client.scenes()
        with pytest.raises(hg.NotFound, match="bal"):
            scene["bal"].id  # noqa: B018
    return [{plane: frame[plane].tobytes() for plane in PLANES} for frame in found]


def test_the_python_client_ignores_what_it_does_not_know(client, newer, tmp_path):
    address, proxy = newer
    with hg.connect(address) as other:
        found = tour(other, tmp_path)
    assert all(each == found[0] for each in found)
    assert tour(client, tmp_path)[0] == found[0]
    named = {"Render", "RenderBatch", "Stream", "Read", "Query", "Tracks", "DecodeAsset", "Apply"}
    assert named | {"ExportScene", "ImportScene", "UploadBlob", "BranchScene"} <= proxy.calls


@pytest.mark.parametrize("program", ["example_labels", "example_edit_loop"])
def test_the_cpp_client_ignores_what_it_does_not_know(client, newer, program):
    words = ["3"] if program.endswith("loop") else []
    run = [
        subprocess.run([PROGRAMS / program, address, *words], capture_output=True, text=True)
        for address in (newer[0], client.address)
    ]
    assert run[0].returncode == 0, run[0].stderr
    if not words:  # the other one prints times
        assert run[0].stdout == run[1].stdout


def test_clients_tell_that_the_daemon_no_longer_speaks_their_version(client):
    message = "speaks versions 2 to 3 of the protocol and this client 1"
    with newer_daemon.before(client.address, min_api=2) as (address, _):
        with pytest.raises(hg.FailedPrecondition, match=message):
            hg.connect(address)
        run = subprocess.run([PROGRAMS / "example_labels", address], capture_output=True, text=True)
        assert run.returncode != 0 and message in run.stderr
