"""examples/protocol/minimal_client.py, with stubs of its own, against a real daemon."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]


def stubs(folder):
    plugin = shutil.which("grpc_python_plugin")
    sources = sorted(map(str, (ROOT / "proto/heliograph/v1").glob("*.proto")))
    command = ["protoc", "-I", str(ROOT / "proto"), f"--plugin=protoc-gen-grpc={plugin}"]
    command += [f"--python_out={folder}", f"--grpc_out={folder}", *sources]
    subprocess.run(command, check=True)
    for package in ("heliograph", "heliograph/v1"):  # before the installed client's package
        (folder / package / "__init__.py").touch()
    return folder


def test_a_client_of_the_protocol_alone(client, tmp_path):
    program = ROOT / "examples/protocol/minimal_client.py"
    out = tmp_path / "planes.npz"
    command = [sys.executable, str(program), client.address.removeprefix("unix://"), str(out)]
    environment = {**os.environ, "PYTHONPATH": str(stubs(tmp_path))}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    assert "NOT_FOUND edits[0].target ['plate']" in run.stdout
    assert "watched 3 shown [2, 3]" in run.stdout
    planes = np.load(out)
    assert planes["beauty"].shape == (32, 32, 4) and planes["beauty"].dtype == np.float32
    assert set(np.unique(planes["instance"])) == {0, 7, 8}
    assert np.allclose(planes["depth"][planes["instance"] == 7], 3)  # metres
    assert np.allclose(planes["depth"][planes["instance"] == 8], 2.5)
