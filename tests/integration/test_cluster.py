"""A data set by several processes: shares, makers, Ray, SLURM's array. tests/fault/cluster.py kills
workers and daemons while they work."""

import os
import pathlib
import pickle
import re
import signal
import socket
import subprocess
import sys
import threading
import types

import heliograph as hg
import heliograph.datasets as hd
import pytest
from dataset_stage import shift, stage
from heliograph import cluster
from heliograph.cluster import _maker

ROOT = pathlib.Path(__file__).resolve().parents[2]
HERE = pathlib.Path(__file__).parent
OPTIONS = {"count": 10, "spp": 1, "seed": 3}


def ask_wrongly_at_seven(draw):
    draw.edit.material("floor/material", roughness=2.0 if draw.index == 7 else 0.5)


def end_at_five(draw):
    if draw.index == 5:
        os.kill(os.getpid(), signal.SIGKILL)


class Absent:
    """A Maker on a machine without heliograph."""

    def __init__(self, *_):
        raise ImportError("no heliograph here")

    def ready(self):
        pass


class Move:
    """A randomizer with a handle of the scene."""

    def __init__(self, entity):
        self.entity = entity

    def __call__(self, draw):
        draw.place([self.entity], [hg.Pose((draw.rng.uniform(-0.2, 0.2), 0.5, 0.2))])


def files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and "shards" not in path.parts
    }


@pytest.fixture
def staged(scene):
    stage(scene)
    return scene


@pytest.fixture(scope="module")
def ray():
    """A Ray of this module's own, whose workers find this file."""
    old = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE), old])
    with cluster._ray(3, 0) as initialized:
        yield initialized
    os.environ["PYTHONPATH"] = old


# ------------------------------------------------------------ without Ray


def test_shares_are_the_images_once():
    shares = [cluster.share(100, part, 7, block=3) for part in range(7)]
    assert sorted(sum(shares, [])) == list(range(100))
    assert max(map(len, shares)) - min(map(len, shares)) <= 3
    with pytest.raises(hg.InvalidArgument, match="part"):
        cluster.share(100, 7, 7)


@pytest.fixture
def maker(staged, tmp_path):
    """makes(randomizer): a Maker of a data set in tmp_path/made."""
    made = []

    def makes(randomizer):
        plan = {"cameras": "cam", "randomizer": randomizer, **OPTIONS}
        plan["writer"] = hd.Coco(tmp_path / "made")
        data = _maker.packed(pickle.Pickler, staged, plan)
        staged.save(tmp_path / "scene.helio")
        made.append(_maker.Maker(tmp_path / "scene.helio", data, {}, 2))
        return made[-1]

    yield makes
    for each in made:
        each.close()


def test_a_maker_makes_what_generate_makes(staged, maker, tmp_path):
    randomizer = Move(staged["behind"])
    one = maker(randomizer)
    shards = [one.make(first, min(first + 4, 10)) for first in (8, 0, 4)]
    assert [shard["images"] for shard in shards] == [2, 4, 4]
    assert all(shard["core_seconds"] > 0 for shard in shards)
    hd.generate(staged, "cam", randomizer, writer=hd.Coco(tmp_path / "alone"), **OPTIONS)
    pictures = {n: data for n, data in files(tmp_path / "alone").items() if n.endswith(".png")}
    assert len(pictures) == 10
    assert pictures.items() <= files(tmp_path / "made").items()


def test_a_maker_outlives_its_daemon(maker):
    one = maker(shift)
    assert one.make(0, 2)["images"] == 2
    os.kill(one._client.connection.daemon._process.pid, signal.SIGKILL)
    assert "killed by SIGKILL" in one.make(2, 4)["lost"]
    assert one.make(2, 4)["images"] == 2


def test_a_handle_of_another_scene_is_refused(client, staged, maker):
    with client.create_scene() as other:
        stage(other)
        with pytest.raises(hg.InvalidArgument, match="not the scene of the data set"):
            maker(Move(other["behind"]))


def test_a_slurm_array(tmp_path):
    """make.sh as SLURM runs it, one task after the other, the second one twice."""
    outputs = []
    for task in (0, 1, 1, 2):
        environment = {
            **os.environ,
            "PYTHON": sys.executable,
            "SLURM_ARRAY_TASK_ID": str(task),
            "SLURM_ARRAY_TASK_COUNT": "3",
            "SLURM_SUBMIT_DIR": str(ROOT),
        }
        command = ["bash", ROOT / "examples/slurm/make.sh", tmp_path / "set", "7"]
        done = subprocess.run(
            [*command, "--size", "48", "32", "--spp", "1"],
            env=environment,
            capture_output=True,
            text=True,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        outputs.append(done.stdout)
    assert "task 0 of 3: 3 images, 0 were there" in outputs[0]
    assert "task 1 of 3: 0 images, 2 were there" in outputs[2]
    assert ["all images are there" in text for text in outputs] == [False, False, False, True]
    assert re.search(r"\d core-seconds an image", outputs[3])
    assert len(list((tmp_path / "set").rglob("*.png"))) == 7
    assert hd.validate(tmp_path / "set").ok


def test_gpus_that_this_machine_lacks_are_refused(staged, tmp_path, monkeypatch):
    ends = []
    ray = types.SimpleNamespace(
        is_initialized=lambda: False,
        init=lambda **_: None,
        cluster_resources=lambda: {"CPU": 1.0, "GPU": 2.0},
        shutdown=lambda: ends.append(1),
    )
    monkeypatch.setitem(sys.modules, "ray", ray)
    with pytest.raises(hg.InvalidArgument, match="gpus: .*needs 3 and .* finds 2 ") as caught:
        cluster.generate(
            staged, "cam", shift, writer=hd.Coco(tmp_path), workers=1, gpus=3, **OPTIONS
        )
    assert caught.value.field == "gpus" and ends == [1]


# ------------------------------------------------------------ with Ray


def listeners():
    """Addresses on which processes below this one listen."""
    ours, parents = {os.getpid()}, {}
    for path in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
    while new := {child for child, parent in parents.items() if parent in ours} - ours:
        ours |= new
    sockets = set()
    for process in ours:
        for file in pathlib.Path(f"/proc/{process}/fd").glob("*"):
            try:
                sockets.add(os.readlink(file))
            except OSError:
                continue
    found = set()
    for table, width in (("tcp", 8), ("tcp6", 32)):
        for line in pathlib.Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in sockets:
                raw = bytes.fromhex(fields[1][:width])
                packed = b"".join(raw[i : i + 4][::-1] for i in range(0, len(raw), 4))
                family = socket.AF_INET if width == 8 else socket.AF_INET6
                found.add(socket.inet_ntop(family, packed))
    return found


def test_ray_makes_the_same_files(ray, staged, tmp_path):
    alone, made = hd.Coco(tmp_path / "alone"), hd.Coco(tmp_path / "made")
    hd.generate(staged, "cam", shift, writer=alone, **OPTIONS)
    shown = []
    done = cluster.generate(
        staged, "cam", shift, writer=made, workers=2, shard=3, progress=shown.append, **OPTIONS
    )
    assert (done.images, done.skipped, done.lost) == (10, 0, 0)
    assert 0 < done.core_seconds < 1000 and "core-seconds an image" in str(done)
    assert files(tmp_path / "made") == files(tmp_path / "alone")
    assert [shown[0].done, shown[-1].done, shown[-1].total] == [0, 10, 10]
    assert len(list((tmp_path / "made/.heliograph/shards").iterdir())) == 4
    again = cluster.generate(staged, "cam", shift, writer=made, workers=2, shard=3, **OPTIONS)
    assert (again.images, again.skipped) == (0, 10)


def test_of_two_calls_at_once_one_is_refused(ray, staged, tmp_path):
    barrier, results = threading.Barrier(2), {}

    def run(seed):
        options = {**OPTIONS, "seed": seed, "writer": hd.Coco(tmp_path / "set"), "workers": 1}
        barrier.wait()
        try:
            results[seed] = cluster.generate(staged, "cam", shift, **options).images
        except hg.FailedPrecondition as error:
            results[seed] = str(error)

    threads = [threading.Thread(target=run, args=(seed,)) for seed in (7, 8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (winner,) = (seed for seed in results if results[seed] == 10)
    assert "another seed" in results[15 - winner]
    hd.generate(
        staged, "cam", shift, writer=hd.Coco(tmp_path / "alone"), **{**OPTIONS, "seed": winner}
    )
    assert files(tmp_path / "set") == files(tmp_path / "alone")


def test_ray_listens_on_the_loopback_address_alone(ray):
    assert listeners() and listeners() <= {"127.0.0.1", "::1", "::ffff:127.0.0.1"}


def test_an_error_in_a_worker_is_raised_here(ray, staged, tmp_path):
    with pytest.raises(hg.InvalidArgument, match="image 7: .*roughness"):
        cluster.generate(
            staged,
            "cam",
            ask_wrongly_at_seven,
            writer=hd.Coco(tmp_path),
            workers=1,
            shard=5,
            **OPTIONS,
        )
    assert len(list(tmp_path.rglob("*.png"))) >= 5


def test_a_shard_that_ends_its_workers_is_named(ray, staged, tmp_path):
    with pytest.raises(hg.Unavailable, match="images 4 to 7: .*lost 2 times"):
        cluster.generate(
            staged,
            "cam",
            end_at_five,
            writer=hd.Coco(tmp_path),
            workers=1,
            shard=4,
            tries=2,
            **OPTIONS,
        )


def test_workers_that_never_start_end_the_call(ray, staged, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "Maker", Absent)
    with pytest.raises(hg.Unavailable, match="(?s)ended 2 times before .*no heliograph here"):
        cluster.generate(
            staged, "cam", shift, writer=hd.Coco(tmp_path), workers=2, tries=2, **OPTIONS
        )
