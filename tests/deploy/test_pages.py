"""The operator's page and the programs agree: each flag that it names is there, each limit has the
default that it gives."""

import os
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd"))
PAGE = (ROOT / "docs/operations.md").read_text()
# Of docker, and of tests/fault/fuzz_assets.py.
OTHERS = {"--read-only", "--network", "--cap-drop", "--security-opt", "--stop-timeout"}
OTHERS |= {"--seeds", "--keep"}
UNITS = {"MiB": 2**20, "GiB": 2**30, "M": 10**6}


def output_of(*command) -> str:
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout


def test_each_flag_is_one_of_a_program():
    python = sys.executable
    commands = [[DAEMON], [python, "-m", "heliograph", "info"], [python, ROOT / "scripts/replay"]]
    helps = "".join(output_of(*command, "--help") for command in commands)
    known = set(re.findall(r"--[a-z][a-z-]*", helps))
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", PAGE)) - OTHERS
    assert len(named) > 20
    assert named <= known


def test_each_limit_has_its_default():
    defaults = dict(re.findall(r"^  (\w+) .*\[(\d+)\]$", output_of(DAEMON, "--help"), re.MULTILINE))
    rows = re.findall(r"^\| `(\w+)` \| ([\d,^]+)(?: (MiB|GiB|M))? \|", PAGE, re.MULTILINE)
    assert len(rows) > 15
    for name, number, unit in rows:
        base, _, power = number.replace(",", "").partition("^")
        value = int(base) ** int(power or 1) * UNITS.get(unit, 1)
        assert int(defaults[name]) == value, name
