"""A bundle starts in a root that has the C library and nothing else, and shows there what the build
tree's programs show here, to the bit. It is made without the Python client, which pip fetches."""

import hashlib
import json
import os
import pathlib
import re
import subprocess
import time

import bare
import heliograph as hg
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd"))
ASSETS = ROOT / "tests/assets"
PICTURES = "gradient.hdr", "gradient.jpg", "gradient16.png", "gradient_float.tif", "t08.exr"
PROGRAM = "/opt/heliograph/bin/heliographd"


def bundle(archive, *flags):
    command = [ROOT / "scripts/bundle", "--build", DAEMON.parents[1], "--without-python"]
    return subprocess.run([*command, "--output", archive, *flags], capture_output=True, text=True)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A root with the libraries of libc6 and a bundle in /opt/heliograph."""
    root = tmp_path_factory.mktemp("root")
    bare.make_root(root)
    (root / "opt/heliograph").mkdir(parents=True)
    archive = tmp_path_factory.mktemp("archive") / "bundle.tar"
    done = bundle(archive, "--glibc", os.confstr("CS_GNU_LIBC_VERSION").split()[1])
    assert done.returncode == 0, done.stderr
    subprocess.run(
        ["tar", "-C", root / "opt/heliograph", "--strip-components=1", "-xf", archive], check=True
    )
    return root


@pytest.fixture(scope="module")
def enter(root):
    """The command that runs a program of the root in it."""
    return bare.enter(root)


def pixels(client):
    """A scene of files of every decoder's library, rendered."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(ASSETS / "picture/gradient_rec2020.exr")
            edit.import_file(ASSETS / "gltf/Fox.glb", name="fox", transform=hg.Pose((0, 1, 0)))
            edit.import_file(ASSETS / "volume/smoke.vdb", name="smoke")
            ball = edit.mesh("ball", **hg.shapes.sphere(0.4))
            for x, name in enumerate(PICTURES):
                texture = edit.texture(None, ASSETS / "picture" / name)
                paint = edit.material(None, base_color=texture)
                edit.entity(None, mesh=ball, material=paint, transform=hg.Pose((x - 2, -1, 0.4)))
            lens = hg.Camera.from_fov(60, 64, 48, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -5, 2), (0, 0, 0.5)))
        frame = scene.render("cam", spp=4, planes=["beauty", "instance"])
        assert len(set(frame["instance"].ravel())) > len(PICTURES)
        return frame["beauty"].tobytes()


def test_it_renders_in_a_bare_root(root, enter):
    socket = ["--socket", "/run/heliograph.sock"]
    daemon = subprocess.Popen([*enter, PROGRAM, *socket], stderr=subprocess.PIPE, text=True)
    probe = [*enter, PROGRAM, *socket, "--probe", "ready"]
    try:
        deadline = time.monotonic() + 30
        while subprocess.run(probe, stderr=subprocess.DEVNULL).returncode:
            assert daemon.poll() is None, daemon.stderr.read()
            assert time.monotonic() < deadline, "not ready in 30 s"
            time.sleep(0.1)
        with hg.connect(f"unix://{root}/run/heliograph.sock") as bundled, hg.connect() as built:
            is_same = pixels(bundled) == pixels(built)
    finally:
        daemon.terminate()
        errors = daemon.communicate(timeout=30)[1]
    assert daemon.returncode == 0, errors
    assert is_same


def test_it_carries_a_licence_for_each_library(root):
    licences = root / "opt/heliograph/licences"
    packages = (licences / "PACKAGES").read_text().splitlines()
    assert all((licences / line.split()[0]).stat().st_size for line in packages)
    assert {"libgcc-s1", "libstdc++6", "libtbb12"} <= {line.split()[0] for line in packages}
    assert not list(root.glob("opt/heliograph/lib/libc.so*"))


def test_it_names_all_that_is_inside(root):
    """Every program and library by its hash, every package as dpkg knows it, one of PyPI and one
    that was compiled in."""
    folder = root / "opt/heliograph"
    document = json.loads((folder / "sbom.cdx.json").read_text())
    assert (document["bomFormat"], document["specVersion"]) == ("CycloneDX", "1.5")
    parts = [document["metadata"]["component"], *document["components"]]
    listed = {
        file["name"]: file["hashes"][0]["content"]
        for part in parts
        for file in part.get("components", ())
    }
    here = {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.read_bytes()[:4] == b"\x7fELF"
    }
    assert listed == here and any(name.startswith("lib/libgrpc++.so") for name in here)
    others = {"assimp", "basis-universal", "openimageio", "openvdb"}
    components = [part for part in document["components"] if part["name"] not in others]
    named = {part["name"]: part for part in document["components"]}
    pictures, textures, volumes, models = (
        named[n] for n in ("openimageio", "basis-universal", "openvdb", "assimp")
    )
    assert pictures["purl"].startswith("pkg:pypi/openimageio@") and len(pictures["components"]) == 2
    licences = (textures, "Apache-2.0"), (volumes, "MPL-2.0"), (models, "BSD-3-Clause")
    for part, licence in licences:
        assert part["purl"].startswith(f"pkg:generic/{part['name']}@")
        assert part["licenses"] == [{"expression": licence}]
    assert (folder / "licences/openvdb").read_text().startswith("Mozilla Public License")
    assert (folder / "licences/assimp").read_text().startswith("Open Asset Import Library")
    assert (folder / "licences/basis_universal/LICENSE").stat().st_size > 10_000
    names = [part["name"] for part in components]
    query = ["dpkg-query", "-W", "-f", "${Package} ${Version}\n", *names]
    known = subprocess.run(query, capture_output=True, text=True, check=True).stdout.splitlines()
    assert sorted(known) == sorted(f"{p['name']} {p['version']}" for p in components)
    assert {"nlohmann-json3-dev", "libglm-dev", "libspdlog-dev"} <= set(names)
    assert len({part["purl"] for part in components}) == len(names)
    assert all(part["licenses"] and part["purl"].startswith("pkg:deb/") for part in components)


def test_it_names_what_would_not_start_on_an_older_system(tmp_path):
    done = bundle(tmp_path / "bundle.tar", "--glibc", "2.17")
    assert done.returncode == 1 and not (tmp_path / "bundle.tar").exists()
    assert re.search(r"(bin|lib)/\S+ needs glibc 2\.\d\d, newer than 2.17", done.stderr)
