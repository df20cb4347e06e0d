"""How generate() goes on, ends and is interrupted."""

import os
import pathlib
import socket
import subprocess
import sys
import tracemalloc

import heliograph as hg
import heliograph.datasets as hd
import pytest
from balls import BALLS, files, make, scatter, spin, stage

__all__ = ["stage"]


def test_resuming_makes_what_is_missing_alone(stage, tmp_path):
    make(stage, tmp_path)
    whole = files(tmp_path)
    (tmp_path / ".heliograph/records/000001.json").unlink()
    (tmp_path / "images/000001.png").unlink()
    again = make(stage, tmp_path)
    assert (again.images, again.skipped) == (1, 2)
    assert files(tmp_path) == whole
    more = make(stage, tmp_path, count=4)
    assert (more.images, more.skipped) == (1, 3)
    with pytest.raises(hg.FailedPrecondition, match="another options.spp, seed"):
        make(stage, tmp_path, count=4, seed=1, spp=3)
    with pytest.raises(hg.FailedPrecondition, match="a data set of 4 images, count=3 is less"):
        make(stage, tmp_path)
    assert make(stage, tmp_path, count=4, resume=False).images == 4
    again = make(stage, tmp_path, count=4, resume=False, indices=[1, 3])
    assert (again.images, again.complete) == (2, True)  # the others stay


def test_a_relative_directory_stays_where_it_was_named(stage, tmp_path, monkeypatch):
    scene, balls, cam = stage
    other = tmp_path / "other"
    other.mkdir()
    monkeypatch.chdir(tmp_path)

    def leaves(draw):
        os.chdir(other)
        scatter(balls)(draw)
        spin(draw)

    writers = [hd.Coco("Coco"), hd.WebDataset("WebDataset"), hd.Bop("Bop")]
    options = {"count": 3, "spp": 2}
    assert hd.generate(scene, cam, leaves, writer=writers, **options).complete
    assert hd.generate(scene, cam, leaves, writer=writers, **options).skipped == 3
    assert not list(other.iterdir())
    make(stage, None, writer=[hd.Coco(tmp_path / "whole/Coco")])
    assert files(tmp_path / "Coco").keys() == files(tmp_path / "whole/Coco").keys()
    monkeypatch.chdir(tmp_path)
    kept = hd.KeptImage.find("Coco/images/000001.png")
    os.chdir(other)
    assert kept.is_same(kept.render(scene.client))


SPLITS = {"train": 0.5, "val": 0.5}


@pytest.mark.parametrize("other", [{"seed": 1}, {"splits": None}, {"count": 5}])
def test_no_file_of_another_data_set_is_among_those_made_again(stage, tmp_path, other):
    same = {"count": 6, "splits": SPLITS, "resume": False}

    def again(**options):
        return make(stage, None, writer=hd.Yolo(tmp_path), **{**same, **options})

    again()
    whole = files(tmp_path)
    with pytest.raises(hg.FailedPrecondition, match=rf"{tmp_path} is a data set .*remove th"):
        again(**other)
    assert files(tmp_path) == whole
    assert again().images == 6
    assert files(tmp_path) == whole


def test_a_directory_without_files_takes_another_data_set(stage, tmp_path):
    with pytest.raises(hg.InvalidArgument, match="height: is 0"):
        make(stage, tmp_path, size=(64, 0))
    assert make(stage, tmp_path).images == 3
    with pytest.raises(hg.FailedPrecondition, match="another options.size: write to another"):
        make(stage, tmp_path, size=(64, 32))


def test_a_run_that_is_refused_writes_nothing_and_does_not_draw(stage, tmp_path):
    scene, _, cam = stage
    one, two = hd.Coco(tmp_path / "one"), hd.Coco(tmp_path / "two")
    make(stage, None, writer=two)
    whole = files(tmp_path)
    drawn = []
    for writers in ([one, two], [two, one]):
        with pytest.raises(hg.FailedPrecondition, match="two is a data set with another seed"):
            hd.generate(scene, cam, drawn.append, count=3, spp=2, seed=9, writer=writers)
    assert files(tmp_path) == whole and not drawn


def test_what_a_killed_process_left_goes_and_what_other_hosts_write_stays(stage, tmp_path):
    host, dead = socket.gethostname(), 99999999
    folder = hd.Coco(tmp_path).folder
    with folder.file("train-000000.tar") as path:
        path.write_bytes(b"")
        mine = path.name.replace(f"-{os.getpid()}-", f"-{dead}-")
    others = [f"{host}-worker-1-4242-1-000000.png", f"{host}-{dead}-1234-1-000000.png"]
    partial = tmp_path / ".heliograph/partial"
    for name in (mine, *others):
        (partial / name).write_bytes(b"x")
    make(stage, tmp_path)
    assert sorted(path.name for path in partial.iterdir()) == sorted(others)


def test_an_exception_names_its_image_and_keeps_what_is_done(stage, tmp_path):
    scene, balls, cam = stage

    def randomize(draw):
        if draw.index == 5:
            draw.edit.update("nobody", visible=False)

    with pytest.raises(hg.NotFound, match="image 5: .*nobody"):
        hd.generate(scene, cam, randomize, count=40, spp=2, writer=hd.Coco(tmp_path), credits=2)
    done = list((tmp_path / ".heliograph/records").iterdir())
    assert 3 <= len(done) < 10
    assert not list((tmp_path / ".heliograph/partial").iterdir())
    again = hd.generate(scene, cam, spin, count=40, spp=2, writer=hd.Coco(tmp_path))
    assert again.skipped == len(done) and again.complete


def test_what_is_none_of_ours_is_raised_with_its_image(stage, tmp_path):
    scene, _, cam = stage
    with pytest.raises(RuntimeError, match="image 0: KeyError: 'bolt'") as raised:
        hd.generate(scene, cam, lambda draw: {}["bolt"], count=2, writer=hd.Coco(tmp_path))
    assert isinstance(raised.value.__cause__, KeyError)


KILLED = """
import os, sys, threading
sys.path.insert(0, sys.argv[2])
import heliograph as hg, heliograph.datasets as hd
import balls as t

class Fatal(hd.Coco):
    def write(self, image):
        if image.index == 9:
            os.kill(os.getpid(), 9)
        return super().write(image)

Fatal.__name__ = "Coco"
with hg.connect() as client, client.create_scene() as scene:
    t.make((scene, *t.furnished(scene)), None, count=20, writer=Fatal(sys.argv[1]), seed=3)
"""


def test_a_killed_run_goes_on_to_the_same_bytes(stage, tmp_path):
    arguments = [sys.executable, "-c", KILLED, tmp_path / "killed", pathlib.Path(__file__).parent]
    assert subprocess.run(arguments, check=False).returncode == -9
    done = len(list((tmp_path / "killed/.heliograph/records").iterdir()))
    assert 4 <= done < 20
    again = make(stage, tmp_path / "killed", count=20, seed=3)
    assert (again.skipped, again.complete) == (done, True)
    make(stage, tmp_path / "whole", count=20, seed=3)
    assert files(tmp_path / "killed") == files(tmp_path / "whole")
    assert hd.validate(tmp_path / "killed").ok


INTERRUPTED = """
import os, signal, sys, threading
import heliograph as hg, heliograph.datasets as hd

def slow(draw):  # after the first two, which are made by then
    side = 8 if draw.index < 2 else 4096
    draw.edit.update(draw.camera, camera=hg.Camera.from_fov(50, side, side, degrees=True))
    if draw.index == 5:
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()

with hg.connect() as client, client.create_scene() as scene:
    with scene.edit() as edit:
        edit.dome(color=1)
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.2))
        edit.entity("ball", mesh=mesh, category="ball")
        cam = edit.entity("cam", camera=hg.Camera.from_fov(1, 8, 8), transform=hg.Pose((0, 0, 1)))
    writer = hd.Coco(sys.argv[1])
    try:
        for indices in (range(2), range(9)):
            hd.generate(scene, cam, slow, count=9, spp=1000, writer=writer, indices=indices)
    except KeyboardInterrupt:
        print("interrupted", scene.render(cam, spp=1)["beauty"].shape)
"""


def test_an_interrupt_cancels_what_is_under_way(tmp_path):
    command = [sys.executable, "-c", INTERRUPTED, tmp_path]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=120)
    assert done.stdout == "interrupted (8, 8, 4)\n", done.stderr
    assert len(list((tmp_path / ".heliograph/records").iterdir())) == 2


class Small(hd.Writer):
    """Nothing but a record."""

    planes, labels = (), ("boxes",)

    def write(self, image):
        return image.frame.labels["bbox_visible"].tolist()

    def finish(self, records):
        assert all(len(record) == BALLS for _, record in records)


def test_memory_does_not_grow_with_the_images(stage, tmp_path):
    scene, balls, cam = stage

    def used(count):
        tracemalloc.reset_peak()
        hd.generate(scene, cam, scatter(balls), count=count, writer=Small(tmp_path))
        return tracemalloc.get_traced_memory()[1]

    used(20)
    tracemalloc.start()
    try:
        few = used(60)
        many = used(360)  # five times as many new ones
    finally:
        tracemalloc.stop()
    assert many < few + 500_000


def test_progress_is_of_images(stage, tmp_path):
    reports = []
    make(stage, tmp_path, progress=reports.append)
    assert reports[-1].done == reports[-1].total == 3
    assert [p.done for p in reports] == sorted(p.done for p in reports)
