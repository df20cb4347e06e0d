"""Uploads that the daemon has no more, because the session that brought them ended: sent again."""

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest

RNG = np.random.default_rng(0)


def texels():
    return RNG.integers(0, 255, (700, 700, 3)).astype("u1")


@pytest.fixture
def far():
    """A client whose session may end, and a scene that does not end with it."""
    with hg.connect(arguments=("--threads", "1", "--grace", "0")) as client:
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


def test_edits_overlays_and_assets(far, tmp_path):
    client, scene = far
    model = tmp_path / "model.obj"
    model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with scene.overlay() as overlay:
        overlay.material("k", base_color=overlay.texture("t", texels()))
        asset = overlay.import_file(model)
    want = scene.render("cam", spp=1, overlay=overlay, planes=["base_color"])["base_color"]
    end_session(client)
    found = scene.render("cam", spp=1, overlay=overlay, planes=["base_color"])["base_color"]
    assert np.array_equal(found, want)
    end_session(client)
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
