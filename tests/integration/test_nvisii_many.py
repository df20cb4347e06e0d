"""import nvisii with very many entities, and with ever new ones."""

import gc
import pathlib
import tracemalloc

import heliograph as hg
import numpy as np
import nvisii
import nvisii.parts
import pytest
from heliograph._wire._proto import scene_pb2 as pb
from nvisii_world import ball

MANY = 150_000


def lattice(count):
    """Transforms of small balls that share everything else."""
    mesh, look = nvisii.mesh.create_sphere("m", 0.01, 4, 4), nvisii.material.create("m")
    places = [nvisii.transform.create(f"t{i}") for i in range(count)]
    for i, place in enumerate(places):
        nvisii.entity.create(f"e{i}", transform=place, mesh=mesh, material=look)
    return places


@pytest.fixture
def sent(monkeypatch):
    """Applied edits: (scene id, transaction)."""
    out = []
    apply = hg.Scene.apply

    def noted(self, transaction, expected=None):
        out.append((self.id, transaction))
        return apply(self, transaction, expected)

    monkeypatch.setattr(hg.Scene, "apply", noted)
    return out


def scene_of():
    return nvisii.session.session().mirror.scene


def test_more_than_a_message_takes_is_shown_at_once(camera, client, sent):
    places = lattice(MANY)
    nvisii.render(8, 8, 1)
    sizes = [transaction.ByteSize() for _, transaction in sent]
    assert len(sizes) >= 2 and max(sizes) < 2 * nvisii.parts.PART_BYTES
    assert scene_of().describe().counts.entities == MANY + 1  # and the camera
    for i, place in enumerate(places):
        place.set_position((i % 400 * 0.01 - 2, 0, i // 400 * 0.01 - 2))
    sent.clear()
    nvisii.render(8, 8, 1)
    ((_, moved),) = sent
    assert [edit.WhichOneof("action") for edit in moved.edits] == ["poses"]
    for i in (0, 205, MANY - 1):
        there = scene_of()[f"e{i}"].world_transform[:3, 3]
        np.testing.assert_allclose(there, (i % 400 * 0.01 - 2, 0, i // 400 * 0.01 - 2), atol=1e-5)


@pytest.fixture
def small_parts(monkeypatch):
    monkeypatch.setattr(nvisii.parts, "PART_BYTES", 20_000)


def third_is_refused(apply):
    """An apply whose third transaction has an edit of what is not there, at its end."""
    calls = []

    def refused(scene, transaction, expected=None):
        calls.append(transaction)
        if len(calls) == 3:
            transaction.edits.add(mode=pb.Edit.MODE_UPDATE).target.name = "nobody"
            transaction.edits[-1].entity.visible = False
        return apply(scene, transaction, expected)

    return refused


def test_parts_are_all_or_nothing(camera, client, sent, small_parts, monkeypatch):
    places = lattice(400)
    nvisii.render(8, 8, 1)
    assert len({scene for scene, _ in sent}) == 1 and len(sent) > 2  # all to a branch
    before, alive = scene_of().id, len(client.scenes())
    for i, place in enumerate(places):
        place.set_position((i, 0, 0))
        place.set_linear_velocity((1, 0, 0), frames_per_second=30)  # keys: an edit each
    sent.clear()
    with monkeypatch.context() as patch:
        patch.setattr(hg.Scene, "apply", third_is_refused(hg.Scene.apply))
        with pytest.raises(RuntimeError, match="nobody"):
            nvisii.render(8, 8, 1)
    assert len(sent) == 3
    assert scene_of().id == before and len(client.scenes()) == alive
    assert np.allclose(scene_of()["e7"].world_transform, np.eye(4))
    nvisii.render(8, 8, 1)
    assert scene_of().id != before and len(client.scenes()) == alive
    assert scene_of()["e7"].world_transform[0, 3] == pytest.approx(7, abs=0.05)
    for i in range(400):
        nvisii.entity.remove(f"e{i}")
    nvisii.render(8, 8, 1)
    assert scene_of().describe().counts.entities == 1


def visit(number):
    """One of everything comes, is shown and goes."""
    name, rng = f"thing{number}", np.random.default_rng(number)
    image = nvisii.texture.create_from_data(name, 64, 64, rng.random(64 * 64 * 4, np.float32))
    thing = ball(name)
    thing.get_material().set_base_color_texture(image)
    place = nvisii.transform.create(f"{name}/lamp", position=(0, 0, 3))
    nvisii.entity.create(f"{name}/lamp", transform=place, light=nvisii.light.create(name))
    nvisii.render(8, 8, 1)
    for kind in ("entity", "transform"):
        getattr(nvisii, kind).remove(f"{name}/lamp")
    for kind in ("texture", "entity", "transform", "mesh", "material", "light"):
        getattr(nvisii, kind).remove(name)


def resident(pid):
    pages = pathlib.Path(f"/proc/{pid}/statm").read_text().split()[1]
    return int(pages) * 4096


def test_what_comes_and_goes_leaves_nothing(camera, client):
    daemon = client.connection.daemon._process.pid
    for number in range(60):
        visit(number)
    counts = scene_of().describe().counts
    gc.collect()
    tracemalloc.start()
    there = resident(daemon)
    for number in range(60, 260):
        visit(number)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert scene_of().describe().counts == counts
    assert grown < 300_000  # a texture alone has 64 KiB, a visit's components 5 KiB
    assert resident(daemon) - there < 8 << 20  # of 200 textures and meshes: 50 MiB
