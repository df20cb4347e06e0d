"""data.yaml as people write it for Ultralytics: the validator reads what the trainer reads."""

import clean_yolo
import heliograph.datasets as hd
import pytest

FOLDERS = "train: images/train\nval: images/val\n"
SHAPE = "kpt_shape: [2, 3]\n"


@pytest.mark.parametrize(
    "text",
    [
        f"{FOLDERS}{SHAPE}names: ['bolt, big', \"nut: #2\"]\n",
        f"{FOLDERS}{SHAPE}nc: 2\nnames: [bolt,\n  nut]\n",
        f"{FOLDERS}kpt_shape:\n- 2\n- 3\nnames: {{0: bolt, 1: 'nut, small'}}\n",
        f"---\n{FOLDERS}{SHAPE}names:\n- bolt\n- nut\ndownload: |\n  {'import os; ' * 40}\n",
        f"{FOLDERS}{SHAPE}names:\n  0: b\u00f6lt\n  1: \U0001f529\n",
        f"train: [images/train]\nval: [images/val]\n{SHAPE}names: [bolt, nut]\n",
    ],
)
def test_data_as_people_write_it(tmp_path, text):
    clean_yolo.make(tmp_path)
    (tmp_path / "data.yaml").write_text(text, encoding="utf-8")
    report = hd.validate(tmp_path)
    assert report.ok, report


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{FOLDERS}names: [bolt\n", "line 4, column 1"),
        (f"{FOLDERS}names: &n [bolt, nut]\nmore: *n\n", "line 4 has an alias"),
        ("bolt nut\n", "holds a str: needs lines of `name: value`"),
        ("", "holds a NoneType"),
        (f"{FOLDERS}names: 2020-20-20\n", "is no YAML (month must be in 1..12"),
        (f"{FOLDERS}names: {'[' * 5000}\n", "is no YAML"),
        (f"{FOLDERS}names: !!python/name:os.system\n", "could not determine a constructor"),
        ("\x00", "is no YAML"),
    ],
)
def test_what_is_no_data_is_told(tmp_path, text, message):
    clean_yolo.make(tmp_path)
    (tmp_path / "data.yaml").write_text(text)
    report = hd.validate(tmp_path)
    (fault,) = report.faults
    assert (fault.check, fault.file) == ("yolo.format", "data.yaml") and message in fault.message
