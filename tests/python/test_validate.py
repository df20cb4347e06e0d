"""validate(): clean sets have no faults, and each planted fault is named by its check, by it alone.

The sets are made by arithmetic and others' libraries, not by the product's writers.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import clean_bop
import clean_coco
import clean_colmap
import clean_dataset
import clean_exr
import clean_flo
import clean_frame
import clean_kitti
import clean_ndds
import clean_nerf
import clean_parquet
import clean_tapvid
import clean_webdataset
import clean_yolo
import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from heliograph.cli import main
from heliograph.datasets.validation import FORMATS

SETS = {
    "coco": clean_coco,
    "bop": clean_bop,
    "kitti": clean_kitti,
    "flo": clean_flo,
    "ndds": clean_ndds,
    "yolo": clean_yolo,
    "tapvid": clean_tapvid,
    "nerf": clean_nerf,
    "colmap": clean_colmap,
    "exr": clean_exr,
    "webdataset": clean_webdataset,
    "parquet": clean_parquet,
    "frame": clean_frame,
    "dataset": clean_dataset,
}
FAULTS = [(name, fault) for name, module in SETS.items() for fault in module.FAULTS]


@pytest.fixture(scope="session")
def clean(tmp_path_factory):
    made: dict[str, Path] = {}

    def get(name: str) -> Path:
        if name not in made:
            made[name] = tmp_path_factory.mktemp("clean") / name
            SETS[name].make(made[name])
        return made[name]

    return get


@pytest.mark.parametrize("name", SETS)
def test_clean_sets_have_no_faults(name, clean):
    report = hd.validate(clean(name), name)
    assert report.ok, str(report)
    assert report.checked[name] > 0
    if name != "dataset":  # it is beside another format's files
        assert hd.validate(clean(name)).formats == [name]


@pytest.mark.parametrize(("name", "fault"), FAULTS, ids=[" ".join(f) for f in FAULTS])
def test_planted_faults_are_named(name, fault, clean, tmp_path):
    expected, plant = SETS[name].FAULTS[fault]
    root = tmp_path / name
    shutil.copytree(clean(name), root)
    plant(root)
    report = hd.validate(root, name)
    assert set(report.counts) == {expected}, str(report)
    assert report.faults and not report.ok
    assert all(len(found.message) > 20 for found in report.faults)


def test_the_command(clean, tmp_path, capsys):
    assert main(["validate", str(clean("coco")), "--processes", "0"]) == 0
    assert "no faults" in capsys.readouterr().out
    root = tmp_path / "bad"
    shutil.copytree(clean("coco"), root)
    clean_coco.annotation(1, area=1)(root)
    assert main(["validate", str(root), "--json"]) == 1  # by processes
    found = json.loads(capsys.readouterr().out)
    assert found["counts"] == {"coco.area": 1} and not found["ok"]
    assert found["faults"][0]["file"] == clean_coco.INSTANCES
    assert main(["validate", str(tmp_path / "none")]) == 2
    assert main(["validate", str(tmp_path)]) == 2
    with pytest.raises(SystemExit) as ended:
        main(["validate", str(root), "--format", "jpeg2000"])
    assert ended.value.code == 2


def test_faults_are_counted_beyond_the_limit(clean, tmp_path):
    root = tmp_path / "coco"
    shutil.copytree(clean("coco"), root)
    for number in range(1, 5):
        clean_coco.annotation(number, area=1)(root)
    report = hd.validate(root, limit=2)
    assert report.counts == {"coco.area": 4} and len(report.faults) == 2
    assert "4 faults, the first 2" in str(report)


def test_a_saved_frame_by_its_own_name(clean, tmp_path, capsys):
    root = clean("frame")
    whole = hd.validate(root / "a.npz")
    assert whole.ok and whole.formats == ["frame"] and whole.checked == {"frame": 1}
    assert whole.left_out == []
    planes = hd.validate(root / "b.exr")
    assert planes.ok
    left = {each.check: each.reason for each in planes.left_out}
    assert set(left) >= {"frame.poses", "frame.boxes", "frame.instance"}
    assert all("no label rows" in reason for reason in left.values())
    assert main(["validate", str(root / "b.exr"), "--processes", "0"]) == 0
    assert "frame.poses: left out 1 times: the file has no label rows" in capsys.readouterr().out
    bad = tmp_path / "bad.npz"
    shutil.copy(root / "a.npz", bad)
    clean_frame.FAULTS["distance is depth"][1](tmp_path, "bad.npz")
    assert set(hd.validate(bad).counts) == {"frame.distance"}


def test_what_is_too_coarse_is_left_out(clean, tmp_path):
    arrays = dict(np.load(clean("frame") / "a.npz"))
    arrays["position_camera"] = arrays["position_camera"].astype(np.float16)
    np.savez(tmp_path / "half.npz", **arrays)
    report = hd.validate(tmp_path)
    assert report.ok, str(report)
    assert [each.check for each in report.left_out] == ["frame.projection"]
    assert "position_camera is float16" in report.left_out[0].reason


def interrupted(tmp_path, writer, there):
    """A set of 3 images, of which so many were made."""
    clean_dataset.make(tmp_path)
    own = tmp_path / clean_dataset.OWN
    record = json.loads((own / "dataset.json").read_text())
    clean_dataset.put(own / "dataset.json", {**record, "writer": {"format": writer}})
    for index in range(there, 3):
        for folder in ("records", "manifests"):
            (own / f"{folder}/{index:06d}.json").unlink()


@pytest.mark.parametrize("there", [0, 1, 2])
def test_an_interrupted_set_is_told_as_such(tmp_path, capsys, there):
    interrupted(tmp_path, "Coco", there)
    (tmp_path / "images").mkdir()
    report = hd.validate(tmp_path)
    assert report.formats == ["dataset"] and not report.ok
    (fault,) = report.faults
    assert fault.check == "dataset.counts"
    text = f"{there} of 3 images of a Coco set are there, the first that is missing is 00000{there}"
    assert text in fault.message and "call generate() again" in fault.message
    assert main(["validate", str(tmp_path), "--processes", "0"]) == 1
    assert text in capsys.readouterr().out


def test_an_interrupted_set_beside_anothers_files(tmp_path, clean):
    shutil.copytree(clean("coco"), tmp_path, dirs_exist_ok=True)
    interrupted(tmp_path, "Yolo", 1)
    report = hd.validate(tmp_path)
    assert report.formats == ["coco", "dataset"]
    assert "1 of 3 images of a Yolo set are there" in str(report)


def test_a_whole_set_of_a_writer_of_ones_own(tmp_path):
    interrupted(tmp_path, "Mine", 3)
    report = hd.validate(tmp_path)
    assert report.ok and report.formats == ["dataset"]
    assert [each.check for each in report.left_out] == ["dataset.files"]
    assert "Mine is no format" in report.left_out[0].reason


def test_what_cannot_be_validated_is_refused(tmp_path):
    with pytest.raises(hg.InvalidArgument, match="no known format"):
        hd.validate(tmp_path)
    with pytest.raises(hg.InvalidArgument, match="coco"):
        hd.validate(tmp_path, "tiff")
    with pytest.raises(hg.NotFound):
        hd.validate(tmp_path / "none")
    for field, value in (("limit", 0), ("processes", -1)):
        with pytest.raises(hg.InvalidArgument, match=f"{field}: {value} is outside"):
            hd.validate(tmp_path, **{field: value})
    (tmp_path / "a.png").write_bytes(b"")
    (fault,) = hd.validate(tmp_path / "a.png").faults
    assert fault.message.startswith("is no .exr or .npz of Frame.save")


def test_the_page_has_the_checks():
    script = Path(__file__).parents[2] / "scripts/validate_doc"
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", SETS)
def test_every_check_finds_a_fault(name):
    found = {check for check, _ in SETS[name].FAULTS.values()}
    assert found == {f"{name}.{check}" for check in FORMATS[name].checks}
