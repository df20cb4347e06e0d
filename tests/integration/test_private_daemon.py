"""A private daemon's beginning and end: closed streams, odd folders, what keeps it, no warnings."""

import contextlib
import gc
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
from test_client_session import gone, simple

ONE_THREAD = ("--threads", "1")
CONNECTS = (
    "import heliograph as hg, os\n"
    "with hg.connect(arguments=('--threads', '1')) as c:\n"
    "    c.info(); folder = c.connection.daemon._folder\n"
    "    print(folder, oct(os.stat(folder).st_mode))\n"
)


def run(code, **environment):
    """A program in a Python that makes every warning an error; what it printed on both streams."""
    done = subprocess.run(
        [sys.executable, "-X", "dev", "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def folder_of(client):
    return client.connection.daemon._folder


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&-", "<&- 2>&-", "<&- >&- 2>&-"])
def test_standard_streams_may_be_closed(closed, tmp_path):
    code = CONNECTS + f"open({str(tmp_path / 'done')!r}, 'w').close()\n"
    shell = f'exec "$0" -c "$1" {closed}'
    done = subprocess.run(["bash", "-c", shell, sys.executable, code], timeout=60, check=False)
    assert done.returncode == 0 and (tmp_path / "done").exists()


@pytest.mark.parametrize("code", ["client.close()", "client.connection.daemon.stop()", "pass"])
def test_nothing_warns(code):
    begin = "import heliograph as hg\nclient = hg.connect()\nscene = client.create_scene()\n"
    assert run(begin + code) == ""


def test_nothing_warns_where_clients_are_collected():
    code = (
        "import heliograph as hg, gc, time\n"
        "for _ in range(2):\n"
        "    client = hg.connect(); scene = client.create_scene('demo')\n"
        "del client, scene; gc.collect(); time.sleep(1)\n"
    )
    assert run(code) == ""


def test_nothing_warns_in_a_forked_child():
    code = (
        "import heliograph as hg, os, sys\n"
        "client = hg.connect()\n"
        "pid = os.fork()\n"
        "if pid == 0: client.info(); sys.exit()\n"
        "assert os.waitpid(pid, 0)[1] == 0\n"
        "client.info(); client.close()\n"
    )
    assert run(code) == ""


def test_a_cell_that_is_run_again_leaves_no_daemon():
    pids, folders = [], []
    for _ in range(3):
        client = hg.connect(arguments=ONE_THREAD)
        scene = client.create_scene("demo")
        pids.append(client.connection.daemon._process.pid)
        folders.append(folder_of(client))
    assert scene.name == "demo"
    assert gone(pids[0]) and gone(pids[1])
    client.info()
    client.close()
    assert not any(map(os.path.exists, folders))


@pytest.mark.parametrize("kept", ["scene", "handle", "frame", "plane", "edit", "overlay"])
def test_what_is_in_use_keeps_the_daemon(kept):
    client = hg.connect(arguments=ONE_THREAD)
    scene = client.create_scene("demo")
    simple(scene)
    size = (320, 200)  # large enough for shared memory
    frame = scene.render("cam", spp=1, planes=["beauty", "depth"], size=size)
    held = {
        "scene": scene,
        "handle": scene["ball"],
        "frame": frame,
        "plane": frame["depth"],
        "edit": scene.edit(),
        "overlay": scene.overlay(),
    }[kept]
    daemon = client.connection.daemon
    pid, folder = daemon._process.pid, daemon._folder
    del client, scene, frame, daemon
    gc.collect()
    assert not gone(pid, 0.5)
    del held
    gc.collect()
    assert gone(pid)
    deadline = time.monotonic() + 5
    while os.path.exists(folder) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not os.path.exists(folder)


def test_a_child_that_lets_go_leaves_the_daemon_to_its_parent():
    client = hg.connect(arguments=ONE_THREAD)
    pid = os.fork()
    if pid == 0:
        del client
        gc.collect()
        os._exit(0)
    assert os.waitpid(pid, 0)[1] == 0
    client.info()
    client.close()


LONG = "long-" * 30


@pytest.mark.parametrize("name", [LONG, "not/there", "two words", "größe-目录", "50%25#?&"])
@pytest.mark.parametrize("variable", ["TMPDIR", "XDG_RUNTIME_DIR"])
def test_any_folder_for_temporary_files(name, variable):
    with tempfile.TemporaryDirectory(prefix="hg", dir="/tmp") as short:
        _check_folder(Path(short) / name, name, variable)


def _check_folder(folder, name, variable):
    if name != "not/there":
        folder.mkdir()
    environment = {"XDG_RUNTIME_DIR": "", "TMPDIR": "/tmp", variable: str(folder)}
    where, mode = run(CONNECTS, **environment).rsplit(maxsplit=1)
    assert mode == "0o40700" and not os.path.exists(where)
    fits = folder.exists() and len(os.fsencode(folder)) < 60
    assert where.startswith(f"{folder}/") == fits


@pytest.mark.parametrize("name", [b"\xff\xfe", b"file"])
def test_no_folder_for_temporary_files(tmp_path, name):
    folder = os.path.join(os.fsencode(tmp_path), name)
    if name == b"file":
        open(folder, "w").close()
    else:
        os.mkdir(folder)
    run(CONNECTS, TMPDIR=os.fsdecode(folder), XDG_RUNTIME_DIR="")
    run(CONNECTS, TMPDIR="/tmp", XDG_RUNTIME_DIR=os.fsdecode(folder))


def test_frames_outlive_their_daemon():
    client = hg.connect(arguments=ONE_THREAD)
    scene = client.create_scene("demo")
    simple(scene)
    depth = scene.render("cam", spp=1, planes=["depth"], size=(320, 200))["depth"]
    before = np.array(depth)
    client.close()
    assert np.array_equal(depth, before)


def test_a_link_in_the_place_of_a_long_address(tmp_path):
    folder = tmp_path / LONG
    folder.mkdir()
    with pytest.raises(hg.Unavailable, match="symbolic link"):
        hg.connect(f"unix://{folder}/heliograph.sock")
    with hg.connect(arguments=ONE_THREAD) as client:
        link = tmp_path / "two words"
        link.symlink_to(folder_of(client))
        with hg.connect(f"unix://{link}/heliograph.sock", timeout=5) as other:
            other.info()
        with contextlib.suppress(FileNotFoundError):
            link.unlink()
