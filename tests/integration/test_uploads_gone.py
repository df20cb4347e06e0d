"""Uploads that the daemon has no more, because it freed them, or the session that brought them
ended, or the daemon itself: sent again."""

import subprocess
import time

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from heliograph._wire.launch import find_program
from heliograph.cli import main
from heliograph.datasets.writers.drawn import drawn
from heliograph.datasets.writers.later import pixels_at
from heliograph.render import call

RNG = np.random.default_rng(0)


def texels():
    return RNG.integers(0, 255, (700, 700, 3)).astype("u1")


LIMITS = ("recent_seconds=1", "recent_bytes=1", "derived_bytes=1")
FRUGAL = ["--threads", "1", *(word for limit in LIMITS for word in ("--limit", limit))]


@pytest.fixture
def far():
    """A client whose session may end, and a scene that does not end with it."""
    with hg.connect(arguments=[*FRUGAL, "--grace", "0"]) as client:
        scene = client.create_scene("shared", lifetime="daemon")
        with scene.edit() as edit:
            mesh = edit.mesh("m", **hg.shapes.plane(2))
            edit.entity("q", mesh=mesh, material=edit.material("k"), category="plane")
            lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, 0, 4), (0, 0, 0)))
        yield client, scene


def end_session(client):
    """The next call opens another one, which has no uploads."""
    connection = client.connection
    link, connection._link = connection._link, None
    link.method("CloseSession")(
        hg._wire.connection.service.CloseSessionRequest(), metadata=link.metadata
    )
    link.close()


def wait_until_freed(client):
    """Bytes that no scene has."""
    end = time.monotonic() + 60
    while client.info().used["tenant_bytes"] > 100_000:
        assert time.monotonic() < end
        time.sleep(0.1)


def forget(client, scene):
    """The session ends, the device shows something else, and the daemon frees all uploads."""
    end_session(client)
    scene.render("cam", planes=["depth"], labels=False, size=(8, 8))
    wait_until_freed(client)


def test_an_edit_that_is_sent_again_has_its_buffers(far):
    """Vertices of 64 KiB and more lie in shared memory, and a use consumes them; the texture, which
    was sent before, is gone, so that the edit is refused once."""
    client, _ = far
    picture, ball = texels(), hg.shapes.sphere(segments=128)
    for name in ("first", "second"):
        with client.create_scene(name) as scene:
            with scene.edit() as edit:
                mesh = edit.mesh("ball", **ball)
                edit.material("paint", base_color=edit.texture("t", picture))
            assert len(mesh.positions) == len(ball["positions"])
        wait_until_freed(client)


def test_edits_overlays_and_assets(far, tmp_path):
    client, scene = far
    model = tmp_path / "model.obj"
    model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with scene.overlay() as overlay:
        overlay.material("k", base_color=overlay.texture("t", texels()))
        asset = overlay.import_file(model)
    want = scene.render("cam", spp=1, overlay=overlay, planes=["base_color"])["base_color"]
    forget(client, scene)
    found = scene.render("cam", spp=1, overlay=overlay, planes=["base_color"])["base_color"]
    assert np.array_equal(found, want)
    forget(client, scene)
    with scene.edit() as edit:
        edit.instance(asset, "again")
        edit.texture("u", texels())
        end_session(client)
    assert "again" in scene and "u" in scene


def test_generate(far, tmp_path):
    client, scene = far

    def paint(draw):
        draw.edit.material("k", base_color=draw.edit.texture("t", texels()))
        if draw.index % 2:
            end_session(client)

    writer = hd.Coco(tmp_path / "set")
    made = hd.generate(scene, "cam", paint, count=4, spp=1, credits=1, writer=writer)
    assert made.complete and hd.validate(tmp_path / "set").ok


def painted(scene):
    """An overlay that names a picture by its hash."""
    with scene.overlay() as overlay:
        overlay.material("k", base_color=overlay.texture("t", texels()))
    return overlay


def in_worlds(scene, overlay):
    """Its pose is handed over for one use, so a repetition hands over another."""
    worlds = hg.Worlds(1100, [overlay])
    worlds.set_transforms(["q"], np.tile(np.eye(4, dtype="f4"), (1100, 1, 1, 1)))
    return worlds, (np.arange(1100) == 0).astype("u1")


LOOK = {"planes": ["base_color"], "spp": 1, "size": (32, 24)}


def of_worlds(scene, overlay):
    worlds, mask = in_worlds(scene, overlay)
    return scene.render_worlds("cam", worlds, mask=mask, **LOOK).frame(0)["base_color"]


def of_a_batch_of_worlds(scene, overlay):
    worlds, mask = in_worlds(scene, overlay)
    (result,) = scene.render_batch([hg.Job("cam", worlds=worlds, mask=mask, **LOOK)])
    return result.frame.frame(0)["base_color"]


def of_a_batch(scene, overlay):
    (result,) = scene.render_batch([hg.Job("cam", overlay=overlay, **LOOK)])
    return result.frame["base_color"]


def of_a_stream_that_is_finished(scene, overlay):
    with scene.stream("cam", overlay=overlay, timeout=60, **LOOK) as live:
        live.finish()
        (frame,) = (each for each in live if each.is_final)
    return frame["base_color"]


@pytest.mark.parametrize(
    "look", [of_worlds, of_a_batch_of_worlds, of_a_batch, of_a_stream_that_is_finished]
)
def test_whatever_names_an_overlay(far, look):
    client, scene = far
    overlay = painted(scene)
    want = scene.render("cam", overlay=overlay, **LOOK)["base_color"]
    forget(client, scene)
    assert np.array_equal(look(scene, overlay), want)


def test_what_writers_ask(far):
    """Requests of the image's scene and of its picture at another time, when the frame is there."""
    client, scene = far
    overlay = painted(scene)
    frame = scene.render("cam", overlay=overlay, spp=1)
    image = hd.Image(0, frame, overlay=overlay)
    forget(client, scene)
    assert np.array_equal(pixels_at(scene, image, hd.Picture(), 0.0), hd.Picture().pixels(frame))
    forget(client, scene)
    with drawn(scene, image) as branch:
        assert "t" in branch and "t" not in scene


def test_an_image_of_a_data_set(tmp_path, monkeypatch):
    """All that it names is freed between its upload and its render."""
    model = tmp_path / "model.obj"
    corners = np.round(RNG.random((60_000, 3)), 6)
    faces = np.arange(1, 59_998).reshape(-1, 3)
    model.write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
        + "".join(f"f {a} {b} {c}\n" for a, b, c in faces)
    )
    with hg.connect(arguments=FRUGAL) as client:
        with client.create_scene() as scene:
            with scene.edit() as edit:
                edit.entity("q", mesh=edit.mesh("m", **hg.shapes.plane(2)), category="plane")
                lens = hg.Camera.from_fov(1, 32, 24)
                edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 4)))

            def randomize(draw):
                material = draw.edit.material("k", base_color=draw.edit.texture("t", texels()))
                draw.edit.update("q", material=material)
                draw.edit.import_file(model)

            hd.generate(scene, "cam", randomize, count=1, spp=1, writer=hd.Coco(tmp_path / "set"))
        run, waits = call.run, [1]

        def late(*arguments):
            if waits:
                wait_until_freed(client)
            waits.clear()
            return run(*arguments)

        monkeypatch.setattr(call, "run", late)
        image = hd.KeptImage(tmp_path / "set", 0)
        assert image.is_same(image.render(client)) and not waits


def test_a_command_whose_daemon_is_restarted(tmp_path, monkeypatch, capsys):
    """It is killed when the image is about to be rendered."""
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    flags = [find_program(), "--threads", "1", "--socket", str(folder / "s")]
    daemons = []

    def start():
        daemons.append(subprocess.Popen(flags, stderr=subprocess.DEVNULL))

    run = call.run

    def failing(*arguments):
        if len(daemons) == 1:
            daemons[0].kill()
            daemons[0].wait()
            start()
        return run(*arguments)

    with hg.connect(arguments=("--threads", "1")) as client, client.create_scene() as scene:
        with scene.edit() as edit:
            edit.entity("cam", camera=hg.Camera.from_fov(1, 8, 8))
        writer = hd.Exr(tmp_path / "set")
        hd.generate(scene, "cam", lambda draw: None, count=1, spp=1, writer=writer)
    monkeypatch.setattr(call, "run", failing)
    start()
    try:
        while not (folder / "s").exists():
            time.sleep(0.05)
        arguments = ["rerender", str(tmp_path / "set/000000"), "--address", f"unix://{folder}/s"]
        assert main(arguments) == 0, capsys.readouterr().err
        assert capsys.readouterr().out == "the same bytes\n" and len(daemons) == 2
    finally:
        for daemon in daemons:
            daemon.kill()
            daemon.wait()
