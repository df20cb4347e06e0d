"""Who owns the directory of a data set: the record alone, without a daemon."""

import contextlib
import errno
import json
import multiprocessing
import os
import socket
import subprocess
import sys
import threading

import heliograph as hg
import heliograph.datasets as hd
import pytest
from heliograph.datasets.folder import Folder
from heliograph.datasets.record import Record, claimed


class Scene:
    """All that a record wants of a scene."""

    def __init__(self, data=b"a scene"):
        self.data = data

    def save(self, path):
        path.write_bytes(self.data)


def described(seed=7, count=4, **more):
    return {"seed": seed, "count": count, "writer": {"format": "Coco"}, "version": "1", **more}


def claim(root, seed=7, scene=None, resume=True, **more):
    """A run's claim, while the block lasts."""
    record = Record(Folder(root), described(seed, **more))
    return claimed([record], scene or Scene(), () if resume else range(10))


def done(root, index=0):
    Folder(root).keep(index, {"record": 1}, "{}", b"")


def listed(root):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


def no_links(*_):
    raise OSError(errno.EPERM, "Operation not permitted")


def links_within_a_folder_alone(*_):
    """AFS."""
    raise OSError(errno.EXDEV, "Invalid cross-device link")


def lost_reply(source, target):
    """NFS: the server made the link, its answer was lost, and the call was made again."""
    LINK(source, target)
    LINK(source, target)


LINK = os.link
LINKS = {"links": LINK, "no links": no_links, "near links": links_within_a_folder_alone}


@pytest.fixture(params=LINKS)
def links(request, monkeypatch):
    monkeypatch.setattr(os, "link", LINKS[request.param])


def at_once(runs):
    """Errors of each of these, all of them begun by threads at the same moment and kept until
    each was answered."""
    barrier, raised = threading.Barrier(len(runs), timeout=30), [None] * len(runs)

    def run(number, claims):
        barrier.wait()
        with contextlib.ExitStack() as claimed:
            try:
                claimed.enter_context(claims)
            except Exception as error:  # what is no refusal counts as one that names nothing
                raised[number] = error
            barrier.wait()

    threads = [threading.Thread(target=run, args=each) for each in enumerate(runs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return raised


def test_of_many_that_differ_exactly_one_goes_on(tmp_path, links):
    for trial in range(20):
        root = tmp_path / str(trial)
        raised = at_once([claim(root, seed) for seed in range(6)])
        assert sum(error is None for error in raised) == 1
        assert all("another seed" in str(error) for error in raised if error)


def test_without_locks_between_machines_it_is_still_one(tmp_path, links, monkeypatch):
    monkeypatch.setattr(Folder, "alone", lambda self: contextlib.nullcontext())
    for trial in range(20):
        raised = at_once([claim(tmp_path / str(trial), seed) for seed in range(6)])
        assert sum(error is None for error in raised) == 1


def test_equal_runs_share_it(tmp_path, links):
    assert at_once([claim(tmp_path, resume=each % 2 == 0) for each in range(6)]) == [None] * 6


def test_of_two_that_want_the_same_directories_one_gets_all(tmp_path):
    for trial in range(20):
        a, b, c = (tmp_path / str(trial) / name for name in "abc")
        runs = []
        for seed, roots in enumerate([(a, b), (b, a), (b, c)]):
            records = [Record(Folder(root), described(seed)) for root in roots]
            runs.append(claimed(records, Scene()))
        raised = at_once(runs)
        assert sum(error is None for error in raised) == 1


def in_a_process(root, seed, barrier, answers):
    barrier.wait()
    try:
        with claim(root, seed):
            barrier.wait()
            record = json.loads((root / ".heliograph/dataset.json").read_text())
            answers.put((seed, record["seed"]))
    except hg.FailedPrecondition as error:
        answers.put((seed, str(error)))
        barrier.wait()


def test_of_many_processes_exactly_one_goes_on(tmp_path):
    context = multiprocessing.get_context("spawn")
    barrier, answers = context.Barrier(4, timeout=120), context.Queue()
    processes = [
        context.Process(target=in_a_process, args=(tmp_path, seed, barrier, answers))
        for seed in range(4)
    ]
    for process in processes:
        process.start()
    by_seed = dict(answers.get(timeout=120) for _ in processes)
    for process in processes:
        process.join()
    (winner,) = (seed for seed, answer in by_seed.items() if answer == seed)
    refusals = [answer for seed, answer in by_seed.items() if seed != winner]
    assert all("another seed, and a run is making it" in answer for answer in refusals)


# ------------------------------------------------------------ the file


def test_the_record_appears_whole(tmp_path, monkeypatch):
    seen = []

    def link(source, target):
        seen.append((json.loads(source.read_text())["seed"], target.exists()))
        LINK(source, target)

    monkeypatch.setattr(os, "link", link)
    with claim(tmp_path):
        pass
    assert seen == [(7, False)]


def test_a_lost_reply_is_no_refusal(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "link", lost_reply)
    with claim(tmp_path):
        done(tmp_path)
    with pytest.raises(hg.FailedPrecondition, match="another seed"), claim(tmp_path, 8):
        pass


def test_who_is_refused_changes_nothing(tmp_path):
    (tmp_path / "other.txt").write_text("another tool's")
    with claim(tmp_path):
        done(tmp_path)
        before = listed(tmp_path)
        for resume in (True, False):
            with pytest.raises(hg.FailedPrecondition, match="another scene, seed"):
                with claim(tmp_path, 8, Scene(b"another"), resume):
                    pass
        assert listed(tmp_path) == before
    assert (tmp_path / "other.txt").read_text() == "another tool's"


@pytest.mark.parametrize("text", ["[]", "{}", '{"format": "other", "count": 4}', "{", '"a"'])
def test_a_record_that_is_not_ours_is_refused(tmp_path, text):
    path = tmp_path / ".heliograph/dataset.json"
    path.parent.mkdir()
    path.write_text(text)
    with pytest.raises(hg.FailedPrecondition, match=r"dataset\.json: "), claim(tmp_path):
        pass
    assert path.read_text() == text


def test_images_without_a_record_are_nobodys(tmp_path):
    with claim(tmp_path):
        done(tmp_path)
    (tmp_path / ".heliograph/dataset.json").unlink()
    with pytest.raises(hg.FailedPrecondition, match=r"not its dataset.json: .*resume=False"):
        with claim(tmp_path, 8):
            pass
    some = Record(Folder(tmp_path), described(8))
    with pytest.raises(hg.FailedPrecondition, match="not its dataset.json"):
        with claimed([some], Scene(), [1, 2]):
            pass
    with claim(tmp_path, 8, resume=False):
        assert not Folder(tmp_path).has_images()


def test_a_part_that_is_made_again_forgets_its_own(tmp_path):
    with claim(tmp_path):
        for index in range(4):
            done(tmp_path, index)
    with claimed([Record(Folder(tmp_path), described())], Scene(), [1, 3]):
        assert [Folder(tmp_path).has(index) for index in range(4)] == [True, False, True, False]


def test_made_again_it_forgets_images_and_keeps_what_others_may_be_using(tmp_path):
    folder = Folder(tmp_path)
    with claim(tmp_path):
        folder.keep(0, {"record": 1}, '{"overlay_sha256":""}', b"large")
        folder.keep_blob(b"\1" * 32, b"an array")
        with claim_in_thread(tmp_path, resume=False):
            assert not folder.has_images() and folder.has_blob(b"\1" * 32)
            folder.keep(0, {"record": 2}, '{"overlay":{}}', b"small")
    assert folder.overlay(0) is None and folder.record(0) == {"record": 2}


@contextlib.contextmanager
def claim_in_thread(*arguments, **options):
    """The claim of another thread, whose mark is its own."""
    entered, over = threading.Event(), threading.Event()

    def run():
        with claim(*arguments, **options):
            entered.set()
            over.wait()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        assert entered.wait(30)
        yield
    finally:
        over.set()
        thread.join()


def test_more_images_are_the_same_data_set(tmp_path):
    with claim(tmp_path, count=4):
        done(tmp_path)
    with pytest.raises(hg.FailedPrecondition, match="of 4 images, count=3 is less"):
        with claim(tmp_path, count=3):
            pass
    few = Record(Folder(tmp_path), described(count=4))
    with claimed([few], Scene()):
        with claim_in_thread(tmp_path, count=6, version="2"):
            assert few.count() == 6  # it is not finished with four
        few.check()


def test_who_finds_another_record_at_the_end_says_so(tmp_path):
    record = Record(Folder(tmp_path), described())
    with claimed([record], Scene()):
        done(tmp_path)
        path = tmp_path / ".heliograph/dataset.json"
        path.write_text(path.read_text().replace('"seed": 7', '"seed": 8'))
        with pytest.raises(hg.FailedPrecondition, match="another seed"):
            record.check()


# ------------------------------------------------------------ a data set without an image


def test_a_run_without_an_image_leaves_no_record(tmp_path):
    with pytest.raises(ZeroDivisionError), claim(tmp_path):
        raise ZeroDivisionError
    with claim(tmp_path, 8):
        done(tmp_path)
    with pytest.raises(hg.FailedPrecondition, match="another seed"), claim(tmp_path, 7):
        pass


@pytest.mark.parametrize("file", ["images/000000.png", "notes.txt"])
def test_where_files_are_the_record_stays(tmp_path, file):
    with claim(tmp_path):
        Folder(tmp_path).put(file, "x")
    with pytest.raises(hg.FailedPrecondition, match="another seed: .*remove this one"):
        with claim(tmp_path, 8):
            pass


def test_while_another_run_is_under_way_the_record_stays(tmp_path):
    with contextlib.ExitStack() as other:
        with claim(tmp_path):
            other.enter_context(claim_in_thread(tmp_path))
        with pytest.raises(hg.FailedPrecondition, match="another seed, and a run is making it"):
            with claim(tmp_path, 8):
                pass


def test_who_enters_while_it_is_withdrawn_finds_it(tmp_path, monkeypatch):
    replace = os.replace

    def enters(source, target):
        replace(source, target)
        if target.name.endswith("withdrawn"):  # another machine, without a lock
            (tmp_path / ".heliograph/runs/elsewhere-1-1-run").write_text("")

    with claim(tmp_path):
        monkeypatch.setattr(os, "replace", enters)
    assert json.loads((tmp_path / ".heliograph/dataset.json").read_text())["seed"] == 7


KILLED = """
import os, sys
sys.path.insert(0, sys.argv[2])
import pathlib, test_dataset_record as t
with t.claim(pathlib.Path(sys.argv[1])):
    os.kill(os.getpid(), 9)
"""


def test_what_a_killed_run_begun_is_told_and_its_mark_goes(tmp_path):
    here = os.path.dirname(__file__)
    subprocess.run([sys.executable, "-c", KILLED, tmp_path / "set", here], check=False)
    marks = tmp_path / "set/.heliograph/runs"
    assert [path.name.split("-")[0] for path in marks.iterdir()] == [
        socket.gethostname().split("-")[0]
    ]
    with pytest.raises(hg.FailedPrecondition, match="another seed: .*or remove this one"):
        with claim(tmp_path / "set", 8):
            pass
    with claim(tmp_path / "set"):
        assert len(list(marks.iterdir())) == 1
    assert not list(marks.iterdir())


def test_a_mark_of_another_container_is_not_taken_for_a_dead_one(tmp_path):
    """It may have this host's name, and a process of a number that no process has here."""
    subprocess.run([sys.executable, "-c", KILLED, tmp_path, os.path.dirname(__file__)], check=False)
    (mark,) = (tmp_path / ".heliograph/runs").iterdir()
    here = os.stat("/proc/self/ns/pid").st_ino
    theirs = mark.rename(mark.with_name(mark.name.replace(f"-{here}-", f"-{here + 1}-")))
    partial = tmp_path / ".heliograph/partial" / theirs.name
    partial.write_text("half a picture")
    with pytest.raises(hg.FailedPrecondition, match="a run is making it, or was killed on anoth"):
        with claim(tmp_path, 8):
            pass
    with claim(tmp_path):
        assert theirs.exists() and partial.exists()


# ------------------------------------------------------------ where it is


def test_a_relative_directory_stays_where_it_is(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    record = {"record": 1, "attempt": 0, "split": "", "sha256": ""}
    with claim("set"):
        Folder("set").keep(0, record, "{}", b"")
    writer, kept, found = hd.Coco("set"), hd.KeptImage("set", 0), hd.KeptImage.find("set/000000")
    monkeypatch.chdir("elsewhere")
    assert writer.directory == tmp_path / "set" == found.folder.root
    writer.put("images/a.txt", "x")
    assert (tmp_path / "set/images/a.txt").exists() and kept.folder.manifest(0) == "{}"
    assert not list((tmp_path / "elsewhere").iterdir())


@pytest.mark.parametrize("images", ["a.exr", ["a.exr"], "."])
def test_a_picture_by_its_relative_path_stays_where_it_is(tmp_path, monkeypatch, images):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "a.exr").write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    dome = hd.random_dome(images)
    monkeypatch.chdir("elsewhere")
    assert dome.images.listed == [tmp_path / "a.exr"]
