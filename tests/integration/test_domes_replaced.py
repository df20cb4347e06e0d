"""The texture that a dome makes goes with the next dome, unless something else uses it."""

import threading

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest

RNG = np.random.default_rng(0)


def image():
    return RNG.random((16, 32, 3)).astype("f4")


def names(scene):
    return {texture.name for texture in scene.find("dome/*")}


def put(scene, *args, **options):
    with scene.edit() as edit:
        edit.dome(*args, **options)


def test_a_dome_a_frame_leaves_one_texture(scene):
    for _ in range(30):
        put(scene, image())
        assert len(names(scene)) == 1


def test_many_domes_of_one_edit_leave_one_texture(scene):
    put(scene, image())
    with scene.edit() as edit:
        for _ in range(4):
            edit.dome(image())
        entity = edit.entity("behind")
    assert len(names(scene)) == 1 and entity.id == scene["behind"].id


def test_the_same_dome_stays(scene):
    same, other = image(), image()
    put(scene, same)
    (name,) = names(scene)
    put(scene, same, intensity=2.0)
    put(scene, intensity=3.0)
    with scene.edit() as edit:
        edit.dome(other)
        edit.dome(same)
    assert names(scene) == {name}


def test_what_else_uses_it_keeps_it(scene):
    put(scene, image())
    (kept,) = scene.find("dome/*")
    with scene.edit() as edit:
        edit.material("screen", emission=kept)
    for _ in range(3):
        put(scene, image())
    assert len(names(scene)) == 2 and kept.name in names(scene)
    with scene.edit() as edit:
        edit.dome(kept)
    assert names(scene) == {kept.name}


@pytest.mark.parametrize("end", [None, "mine"])
def test_no_dome_and_a_texture_of_ones_own(scene, end):
    put(scene, image())
    with scene.edit() as edit:
        mine = edit.texture("mine", image())
    put(scene, mine if end else None)
    assert names(scene) == set() and "mine" in scene
    put(scene, image())
    put(scene, image())
    assert len(names(scene)) == 1 and "mine" in scene


def test_clients_in_turn(client):
    with (
        client.create_scene("both", lifetime="daemon") as scene,
        hg.connect(client.address) as other,
    ):
        theirs = other.open_scene("both")
        for _ in range(3):
            put(scene, image())
            put(theirs, image())
            assert len(names(scene)) == 1
        put(theirs, None)
        put(scene, image())
        assert len(names(scene)) == 1
        scene.delete()


def test_threads_of_one_client(scene):
    def replace(images):
        for each in images:
            put(scene, each)

    threads = [
        threading.Thread(target=replace, args=([image() for _ in range(20)],)) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(names(scene)) == 1


def test_branches(scene):
    put(scene, image())
    branch = scene.branch()
    before = names(scene)
    for _ in range(3):
        put(branch, image())
    assert len(names(branch)) == 1 and names(branch) != before and names(scene) == before


def test_files_and_helpers(scene):
    for path in hd.randomizers.lighting.bundled_domes()[:2]:
        put(scene, path)
    for _ in range(2):
        with scene.edit() as edit:
            edit.sky(0.5)
        with scene.edit() as edit:
            edit.sample_studio()
    assert len(names(scene)) == 1
    assert scene.describe().counts.textures == 1


def test_overlays_leave_nothing(scene):
    with scene.edit() as edit:
        edit.sample_studio()
        camera = edit.entity("cam", camera=hg.Camera.from_fov(1.0, 32, 24))
    before = names(scene)
    for _ in range(3):
        with scene.overlay() as overlay:
            overlay.dome(image())
            overlay.dome(image())
        scene.render(camera, spp=1, overlay=overlay)
    assert names(scene) == before


def test_a_refused_edit_is_as_it_was(scene):
    put(scene, image())
    before = names(scene)
    with pytest.raises(hg.NotFound, match="nowhere"), scene.edit() as edit:
        edit.dome(image())
        edit.update("nowhere", visible=False)
    assert names(scene) == before
    put(scene, image())
    assert len(names(scene)) == 1 and names(scene) != before
