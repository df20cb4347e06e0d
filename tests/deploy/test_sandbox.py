"""The decoder under what a service manager or a container engine leaves it: under the shipped
unit's SystemCallFilter it decodes everything; where a layer of its sandbox is refused, nothing is
decoded and the daemon is not ready, unless the operator gave that layer up."""

import configparser
import contextlib
import os
import pathlib
import shutil
import subprocess
import time

import heliograph as hg
import pytest
from heliograph.scene import assets

ROOT = pathlib.Path(__file__).resolve().parents[2]
ASSETS = ROOT / "tests/assets"
DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd"))
FILTER = DAEMON.with_name("syscall-filter")
KEPT = pathlib.Path(__file__).with_name("system_service.txt")
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
FORMATS = {
    ".dae", ".exr", ".glb", ".gltf", ".hdr", ".ies", ".jpg", ".nvdb", ".obj", ".ply", ".png",
    ".stl", ".tif", ".vdb",
}  # fmt: skip


def expand(name: str) -> set[str]:
    """The system calls of a group, as the systemd of this machine has it."""
    if not name.startswith("@"):
        return {name}
    done = subprocess.run(
        ["systemd-analyze", "syscall-filter", name], capture_output=True, text=True, check=True
    )
    lines = [line.strip() for line in done.stdout.splitlines()[1:]]
    return set().union(*(expand(line) for line in lines if line and not line.startswith("#")))


def kept_groups() -> set[str]:
    return {line for line in KEPT.read_text().splitlines() if not line.startswith("#")}


def filter_of_unit(system_service: set[str]) -> set[str]:
    """System calls that the unit's SystemCallFilter allows."""
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read_string((ROOT / "deploy/heliographd.service").read_text())
    names = set(unit["Service"]["SystemCallFilter"].split())
    assert "@system-service" in names
    return system_service | (names - {"@system-service"})


@contextlib.contextmanager
def daemon(place, monkeypatch, *, under=(), flags=()):
    """A client of a private daemon that syscall-filter starts with the arguments `under`; once its
    readiness is known."""
    script = place / "heliographd"
    wrapped = " ".join(f"'{each}'" for each in (FILTER, *under, DAEMON))
    script.write_text(f'#!/bin/sh\nexec {wrapped} "$@"\n')
    script.chmod(0o755)
    monkeypatch.setenv("HELIOGRAPHD", str(script) if under else str(DAEMON))
    with hg.connect(arguments=["--log-level", "info", *flags]) as client:
        until = time.monotonic() + 30
        while client.info().not_ready.startswith("it starts") and time.monotonic() < until:
            time.sleep(0.05)
        yield client


def decode(client, path):
    """The decoded file, or why it is refused."""
    try:
        info = assets.decode_bundle(client, assets.Source(path))
        return info.SerializeToString(deterministic=True)
    except hg.HeliographError as error:
        return str(error)


@pytest.fixture
def triangle(tmp_path):
    path = tmp_path / "triangle.obj"
    path.write_text(TRIANGLE)
    return path


def check_unit(system_service, place, monkeypatch):
    files = sorted(path for path in ASSETS.rglob("*") if path.suffix in FORMATS)
    assert {path.suffix for path in files} == FORMATS
    allowed = place / "allowed"
    allowed.write_text("\n".join(filter_of_unit(system_service)) + "\n")
    with daemon(place, monkeypatch, under=("allow", allowed)) as client:
        info = client.info()
        assert info.ready, info.not_ready
        assert not info.refused
        filtered = {path: decode(client, path) for path in files}
    with daemon(place, monkeypatch) as client:
        plain = {path: decode(client, path) for path in files}
    assert sum(isinstance(answer, bytes) for answer in plain.values()) > 30
    assert filtered == plain


def test_the_unit_decodes_every_format(tmp_path, monkeypatch):
    check_unit(kept_groups(), tmp_path, monkeypatch)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_the_unit_decodes_every_format_with_the_systemd_here(tmp_path, monkeypatch):
    check_unit(expand("@system-service") | expand("@default"), tmp_path, monkeypatch)


def test_without_seccomp_the_unit_is_not_ready(tmp_path, monkeypatch, triangle):
    allowed = tmp_path / "allowed"
    allowed.write_text("\n".join(filter_of_unit(kept_groups()) - {"seccomp"}) + "\n")
    with daemon(tmp_path, monkeypatch, under=("allow", allowed)) as client:
        assert "seccomp" in client.info().not_ready
        assert "seccomp" in decode(client, triangle)


@pytest.mark.parametrize(
    ("call", "layer"),
    [
        ("unshare", "namespaces"),
        ("landlock_create_ruleset", "landlock"),
        ("landlock_restrict_self", "landlock"),
        ("capset", "capabilities"),
        ("prlimit64", "rlimits"),
        ("seccomp", "seccomp"),
    ],
)
def test_a_refused_layer_stops_all_decodes(call, layer, tmp_path, monkeypatch, triangle):
    refused = ("deny", call, "--")
    with daemon(tmp_path, monkeypatch, under=refused) as client:
        info = client.info()
        assert not info.ready
        assert any(each.startswith("decoder: ") and layer in each for each in info.refused)
        for reason in (info.not_ready, decode(client, triangle)):
            assert f"{layer}: " in reason
            assert (f"--decode-without {layer}" in reason) == (layer in ("namespaces", "landlock"))


@pytest.mark.parametrize(
    ("calls", "layers"),
    [
        (["unshare"], ["namespaces"]),
        (["unshare", "landlock_create_ruleset"], ["namespaces", "landlock"]),
    ],
)
def test_an_operator_may_give_layers_up(calls, layers, tmp_path, monkeypatch, triangle):
    flags = ("--decode-without", ",".join(layers))
    with daemon(tmp_path, monkeypatch, under=("deny", *calls, "--"), flags=flags) as client:
        info = client.info()
        assert info.ready, info.not_ready
        assert sorted(each.split(":")[0] for each in info.refused) == sorted(layers)
        assert isinstance(decode(client, triangle), bytes)
        lines = list(client.connection.daemon._lines)
        for layer in layers:
            assert any("without a layer" in line and layer in line for line in lines), lines


def test_a_layer_that_is_there_is_used_whatever_the_operator_gave_up(tmp_path, monkeypatch):
    with daemon(tmp_path, monkeypatch) as client:
        as_is = client.info().capabilities
    flags = ("--decode-without", "namespaces,landlock")
    with daemon(tmp_path, monkeypatch, flags=flags) as client:
        assert client.info().capabilities == as_is


@pytest.mark.parametrize("layer", ["seccomp", "rlimits", "nothing"])
def test_other_layers_cannot_be_given_up(layer):
    refused = subprocess.run(
        [DAEMON, "--decode-without", layer, "--probe", "live"], capture_output=True, text=True
    )
    assert refused.returncode == 64
    assert "--decode-without" in refused.stderr
