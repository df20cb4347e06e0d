"""generate() on disks that are full or closed, with daemons that die, and interrupted twice: what
it says, and that it goes on to the same bytes."""

import contextlib
import os
import pathlib
import resource
import signal
import subprocess
import sys
import time

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from balls import files, furnished, make, scatter, stage

HERE = pathlib.Path(__file__).parent
sys.path.append(str(HERE.parent / "fault"))
from served import Served  # noqa: E402

__all__ = ["stage"]


def before_image(writer, number, happens):
    """The class of a writer, before whose image something happens."""

    class Disturbed(writer):
        def write(self, image):
            if image.index == number:
                happens()
            return super().write(image)

    Disturbed.__name__ = writer.__name__
    return Disturbed


@contextlib.contextmanager
def disk(path, options):
    """A file system of its own at path, where this user may mount one."""
    path.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", path]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no tmpfs can be mounted here: {done.stderr.strip()}")
    try:
        yield path
    finally:
        subprocess.run(["umount", path], check=True)


def goes_on(stage, root, whole, killed=False, **options):
    """Makes what is missing; all is as of a whole run. killed: files that were being
    written may be left until then."""
    partial = root / ".heliograph/partial"
    assert killed or not list(partial.glob("*"))
    again = make(stage, root, **options)
    assert not list(partial.glob("*"))
    assert again.complete and again.images > 0
    make(stage, whole, **options)
    assert files(root) == files(whole)
    assert hd.validate(root).ok


def test_a_file_that_cannot_grow_is_told(stage, tmp_path):
    root = tmp_path / "set"
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    message = r"image 1: .*images/000001.png: cannot be written .*make room there and call generate"

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, old[1]))

    try:
        with pytest.raises(hg.ResourceExhausted, match=message):
            make(stage, None, writer=before_image(hd.Coco, 1, limit)(root), credits=1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert len(list((root / ".heliograph/records").iterdir())) == 1
    goes_on(stage, root, tmp_path / "whole")


@pytest.mark.parametrize("writer", [hd.Coco, hd.Exr, hd.WebDataset, hd.Parquet])
def test_a_disk_that_is_full_is_told(stage, tmp_path, writer):
    with disk(tmp_path / "disk", "size=8m") as room:
        root = room / "set"

        def fill():
            with contextlib.suppress(OSError), open(room / "ballast", "wb", 0) as ballast:
                while True:
                    ballast.write(bytes(4096))

        with pytest.raises(hg.ResourceExhausted, match=r"image \d: .*No space left .*make room"):
            make(stage, None, writer=before_image(writer, 2, fill)(root), count=5, credits=1)
        (room / "ballast").unlink()
        assert not list((root / ".heliograph/partial").glob("*"))
        again = make(stage, None, writer=writer(root), count=5)
        assert again.complete and (again.skipped, again.images) == (2, 3)
        make(stage, None, writer=writer(tmp_path / "whole"), count=5)
        assert files(root) == files(tmp_path / "whole")


def test_a_directory_that_is_closed_is_told(stage, tmp_path):
    (tmp_path / "file").write_text("")
    for root in (tmp_path / "file", tmp_path / "file/set"):
        with pytest.raises(hg.FailedPrecondition, match=r"cannot be written .*may write to"):
            make(stage, root)
    with disk(tmp_path / "closed", "ro") as closed:
        with pytest.raises(hg.FailedPrecondition, match=r"Read-only file system.*may write to"):
            make(stage, closed / "set")


def test_a_daemon_that_dies_is_told_and_another_one_goes_on(stage, tmp_path):
    root = tmp_path / "set"

    message = r"image \d+: heliographd died \(killed by SIGKILL\).*images that are done stay"
    with hg.connect() as client:
        daemon = client.connection.daemon
        with pytest.raises(hg.Unavailable, match=message), client.create_scene() as scene:
            own = scene, *furnished(scene)
            deadly = before_image(hd.Coco, 5, lambda: os.kill(daemon._process.pid, signal.SIGKILL))
            make(own, None, writer=deadly(root), count=20, seed=2)
    done = len(list((root / ".heliograph/records").iterdir()))
    assert 3 <= done < 20
    goes_on(stage, root, tmp_path / "whole", count=20, seed=2)


def test_a_daemon_that_comes_back_serves_the_same_scene(stage, tmp_path):
    flags = ("--state-dir", tmp_path / "state")
    noise = np.random.default_rng(0).random((300, 600, 3)).astype("f4")  # a blob

    def run(scene, balls, writer):
        def randomize(draw):
            scatter(balls)(draw)
            draw.edit.dome(noise * (1 + draw.index % 3))

        return hd.generate(scene, "cam", randomize, count=12, spp=2, writer=writer)

    daemons = [Served(tmp_path, *flags)]
    try:
        with hg.connect(daemons[0].socket) as client:
            scene = client.create_scene("room", lifetime="disk")
            balls, _ = furnished(scene)
            dies = before_image(hd.Coco, 4, daemons[0].process.kill)
            with pytest.raises(hg.Unavailable, match="images that are done stay"):
                run(scene, balls, dies(tmp_path / "set"))
            daemons[0].process.wait(30)
            daemons.append(Served(tmp_path, *flags))
            again = run(scene, balls, hd.Coco(tmp_path / "set"))
            assert again.complete and 3 <= again.skipped < 12
    finally:
        for daemon in daemons:
            daemon.stop()
    scene, balls, _ = stage
    run(scene, balls, hd.Coco(tmp_path / "whole"))
    assert files(tmp_path / "set") == files(tmp_path / "whole")


TWICE = """
import os, signal, sys, threading, time
sys.path.insert(0, sys.argv[2])
import heliograph as hg, heliograph.datasets as hd
import balls as t

class Slow(hd.Coco):
    def write(self, image):
        if image.index == 4:
            print("writing", flush=True)
        if image.index >= 4:
            time.sleep(3)  # a slow disk
        return super().write(image)

Slow.__name__ = "Coco"
with hg.connect() as client, client.create_scene() as scene:
    try:
        t.make((scene, *t.furnished(scene)), None, count=12, writer=Slow(sys.argv[1]), seed=3)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
        raise
"""


def test_interrupted_twice_it_ends_at_once_and_goes_on(stage, tmp_path):
    root = tmp_path / "set"
    command = [sys.executable, "-c", TWICE, root, HERE]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        try:
            assert process.stdout.readline() == "writing\n"
            process.send_signal(signal.SIGINT)
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            start = time.monotonic()
            out, _ = process.communicate(timeout=60)
            assert out == "interrupted\n"
            assert time.monotonic() - start < 15
        finally:
            process.kill()
    assert process.returncode not in (0, None)
    goes_on(stage, root, tmp_path / "whole", killed=True, count=12, seed=3)
