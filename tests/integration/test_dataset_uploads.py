"""Files and arrays of its randomizers that a data set keeps."""

import shutil
from pathlib import Path

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from balls import files, furnished, scatter, stage
from PIL import Image

__all__ = ["stage"]

BOLT = Path(__file__).parents[2] / "examples/assets/bolt/bolt.glb"


@pytest.fixture
def pictures(tmp_path):
    """A dome and two textures, as files."""
    shutil.copy(hd.bundled_domes()[0], tmp_path / "sky.exr")
    rng = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        Image.fromarray(rng.integers(0, 255, (32, 32, 3), np.uint8)).save(tmp_path / name)
    return tmp_path


def noise(seed):
    """Above 1 MiB: a blob."""
    return np.random.default_rng(seed).random((300, 600, 3)).astype("f4")


def kept(root, name):
    return sorted(path.name for path in (root / ".heliograph" / name).glob("*"))


def again(root, index):
    """True if an image has its bytes in a daemon that has seen nothing of its files."""
    image = hd.KeptImage(root, index)
    with hg.connect() as other:
        frame = image.render(other)
    picture = (root / f"images/{index:06d}.png").read_bytes()
    return image.is_same(frame) and image.picture.encode(frame) == picture


def test_files_that_a_randomizer_shows_are_kept_once(stage, pictures, tmp_path):
    scene, balls, cam = stage

    def randomize(draw):
        scatter(balls)(draw)
        draw.edit.dome(pictures / "sky.exr")
        paint = draw.edit.texture("paint", pictures / ("a.png", "b.png")[draw.index % 2])
        paper = draw.edit.material("paper", base_color=paint)
        draw.edit.update("ball/0", material=paper)
        draw.edit.import_file(BOLT, name="bolt", category="ball", transform=hg.Pose(scale=5))

    def run(root):
        hd.generate(scene, cam, randomize, count=3, spp=2, writer=hd.Coco(root))
        return files(root)

    whole = run(tmp_path / "set")
    assert len(kept(tmp_path / "set", "blobs")) == len(kept(tmp_path / "set", "decodings")) == 4
    assert whole == run(tmp_path / "same")
    for name in ("sky.exr", "a.png", "b.png"):
        (pictures / name).unlink()
    assert again(tmp_path / "set", 0) and again(tmp_path / "set", 1)
    for name in kept(tmp_path / "set", "blobs"):
        (tmp_path / f"set/.heliograph/blobs/{name}").unlink()
    with pytest.raises(hg.NotFound, match="sky.exr: the data set was not copied whole"):
        again(tmp_path / "set", 0)


def test_a_file_that_was_imported_before_is_kept_when_a_draw_places_it(client, tmp_path):
    model = tmp_path / "bolt.glb"
    shutil.copy(BOLT, model)
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            bolt = edit.import_file(model, category="bolt")
            lens = hg.Camera.from_fov(50, 40, 30, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -0.4, 0.2), (0, 0, 0)))

        def place(draw):
            draw.edit.instance(bolt, "another", transform=hg.Pose((0.05, 0, 0)))

        hd.generate(scene, "cam", place, count=1, spp=2, writer=hd.Coco(tmp_path / "set"))
        assert again(tmp_path / "set", 0)
        model.write_bytes(b"something else")
        with pytest.raises(hg.FailedPrecondition, match=r"image 0: .*bolt.glb is not what it was"):
            hd.generate(scene, "cam", place, count=1, spp=2, writer=hd.Coco(tmp_path / "late"))


def test_a_model_of_the_daemons_own_is_kept_by_its_name(tmp_path):
    shutil.copy(BOLT, tmp_path / "bolt.glb")
    root, flags = tmp_path / "set", ["--asset-root", str(tmp_path)]

    def randomize(draw):
        draw.edit.import_file(server_path="bolt.glb", name="bolt", category="ball")

    with hg.connect(arguments=flags) as client:
        with client.create_scene() as scene:
            _, cam = furnished(scene)
            hd.generate(scene, cam, randomize, count=1, spp=2, writer=hd.Coco(root))
        assert not kept(root, "blobs")
    image = hd.KeptImage(root, 0)
    with hg.connect(arguments=flags) as other:
        assert image.is_same(image.render(other))
    with pytest.raises(hg.HeliographError, match="asset"), hg.connect() as other:
        image.render(other)


def test_a_file_that_is_gone_when_the_draw_ends_is_kept(stage, pictures, tmp_path):
    scene, _, cam = stage

    def randomize(draw):
        passing = shutil.copy(pictures / "a.png", pictures / "passing.png")
        draw.edit.dome(passing)
        Path(passing).unlink()

    hd.generate(scene, cam, randomize, count=1, spp=2, writer=hd.Coco(tmp_path / "set"))
    assert again(tmp_path / "set", 0)


def test_a_daemon_that_decodes_otherwise_is_told(stage, pictures, tmp_path):
    scene, _, cam = stage
    writer = hd.Coco(tmp_path / "set")
    show = lambda draw: draw.edit.dome(pictures / "a.png")  # noqa: E731
    hd.generate(scene, cam, show, count=1, spp=2, writer=writer)
    (decoding,) = (tmp_path / "set/.heliograph/decodings").iterdir()
    hd.generate(
        scene, cam, lambda draw: draw.edit.dome(pictures / "b.png"), count=2, spp=2, writer=writer
    )
    other = next(p for p in decoding.parent.iterdir() if p != decoding)
    decoding.write_bytes(other.read_bytes())
    with pytest.raises(hg.FailedPrecondition, match=r"does not decode b.png as the one that"):
        again(tmp_path / "set", 0)


def test_rejected_draws_leave_nothing(stage, pictures, tmp_path):
    scene, _, cam = stage
    passing = np.empty((300, 600, 3), "f4")
    answers = []

    def randomize(draw):
        number = 10 * draw.index + draw.attempt
        if draw.attempt == 0:
            Image.fromarray(np.full((4, 4, 3), number, np.uint8)).save(pictures / "passing.png")
            draw.edit.texture("unused", pictures / "passing.png")
        mark = draw.mark()
        draw.edit.dome(noise(100 + number))
        draw.rewind(mark)
        passing[:] = noise(number)
        draw.edit.dome(passing)
        passing[:] = 0  # what was uploaded counts

    def accept(labels):
        answers.append(len(answers) % 2 == 1)
        return answers[-1]

    options = {"count": 2, "spp": 2, "accept": accept, "credits": 1}
    done = hd.generate(scene, cam, randomize, writer=hd.Coco(tmp_path / "set"), **options)
    assert done.rejected == 2
    assert len(kept(tmp_path / "set", "blobs")) == 2 and not kept(tmp_path / "set", "decodings")
    assert again(tmp_path / "set", 0) and again(tmp_path / "set", 1)
    assert all(again_blob(tmp_path / "set", name) for name in kept(tmp_path / "set", "blobs"))


def again_blob(root, name):
    """True if an image's overlay names a blob."""
    overlays = [hd.KeptImage(root, i).overlay.SerializeToString() for i in range(2)]
    return any(bytes.fromhex(name) in overlay for overlay in overlays)
