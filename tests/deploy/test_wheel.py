"""The wheels install in a root that has the C library, Python and the client's dependencies, and
show a picture there. The dependencies are those of .venv, so that nothing is fetched. That for GPUs
is made of the same programs: only its name, its metadata and who finds it are tried here."""

import hashlib
import importlib.metadata
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import time
import zipfile

import bare
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
DAEMON = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd"))
PYTHON = pathlib.Path(sys.executable).resolve()
STDLIB = pathlib.Path(sysconfig.get_path("stdlib"))
UNUSED = "test", "tests", "*-packages", "idlelib", "tkinter", "config-*", "EXTERNALLY-MANAGED"
DEPENDENCIES = (
    *("numpy", "grpcio", "protobuf", "googleapis-common-protos", "pillow", "pyyaml", "tqdm"),
    *("typing_extensions", "pip"),
)
PICTURE = """
import heliograph as hg
with hg.connect() as client, client.create_scene() as scene:
    with scene.edit() as edit:
        edit.sample_studio()
        lens = hg.Camera.from_fov(60, 64, 48, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -5, 2), (0, 0, 0.5)))
    scene.render("cam", spp=4).save("/tmp/first.png", exposure="auto")
"""
SET = """
import heliograph as hg, heliograph.datasets as hd
def move(draw):
    draw.place(["ball"], [hg.Pose((draw.rng.uniform(-1, 1), 0, 0.4))])
with hg.connect() as client, client.create_scene() as scene:
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.4))
        edit.entity("ball", mesh=mesh, category="ball")
        lens = hg.Camera.from_fov(60, 96, 64, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -5, 2), (0, 0, 0.5)))
    hd.generate(scene, "cam", move, count=100, spp=16, writer=hd.Coco("/tmp/set"))
assert hd.validate("/tmp/set").ok
"""
NVISII = """
import importlib.util
import nvisii
assert importlib.util.find_spec("nvisii").origin.endswith("site-packages/nvisii/__init__.py")
nvisii.initialize(headless=True)
place, lens = nvisii.transform.create("eye"), nvisii.camera.create("eye")
nvisii.set_camera_entity(nvisii.entity.create("eye", transform=place, camera=lens))
nvisii.set_dome_light_color((1, 0, 0))
nvisii.render_to_file(16, 16, 1, "/tmp/script.png")
"""
FOR_GPUS = """
import heliograph as hg
from heliograph._wire.launch import find_program
assert "/heliograph_server_cuda/bin/" in find_program(), find_program()
try:
    hg.connect(arguments=["--backend", "cuda"])
except hg.Unavailable as error:
    assert "the engine does not start" in str(error), error
else:
    raise AssertionError("there is a GPU")
"""


def tree_as(folder, uses_cuda):
    """The build tree, in a folder that remembers another HELIOGRAPH_CUDA."""
    build = DAEMON.parents[1]
    for path in build.iterdir():
        if path.name != "CMakeCache.txt":
            (folder / path.name).symlink_to(path)
    cache = re.sub(r"(?m)^(HELIOGRAPH_CUDA|NVCC):.*\n", "", (build / "CMakeCache.txt").read_text())
    cache += f"HELIOGRAPH_CUDA:BOOL={uses_cuda}\nNVCC:FILEPATH=/opt/nvcc\n"
    (folder / "CMakeCache.txt").write_text(cache)
    return folder


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """The folder of the four wheels."""
    folder = tmp_path_factory.mktemp("wheels")
    glibc = os.confstr("CS_GNU_LIBC_VERSION").split()[1]
    for uses_cuda in ("OFF", "ON"):
        build = tree_as(tmp_path_factory.mktemp("build"), uses_cuda)
        command = [sys.executable, ROOT / "scripts/wheel", "--build", build]
        subprocess.run([*command, "--output", folder, "--glibc", glibc], check=True)
    return folder


def carry_python(root):
    """This Python, and the client's dependencies in /deps."""
    shutil.copytree(STDLIB, root / str(STDLIB)[1:], ignore=shutil.ignore_patterns(*UNUSED))
    bare.carry(root, PYTHON)
    for name in DEPENDENCIES:
        found = importlib.metadata.distribution(name)
        for file in found.files:
            if ".." not in file.parts and "__pycache__" not in file.parts:
                place = root / "deps" / file
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(found.locate_file(file), place)
    objects = [PYTHON, *(root / "deps").rglob("*.so"), *(STDLIB / "lib-dynload").glob("*.so")]
    listed = subprocess.run(["ldd", *objects], capture_output=True, text=True).stdout
    for path in sorted(set(re.findall(r"=> (/\S+) \(", listed))):
        if not path.startswith(str(root)):
            bare.carry(root, pathlib.Path(path))


@pytest.fixture(scope="module")
def python(tmp_path_factory, wheels):
    """python(*arguments) runs Python in the root, which has the wheels in /wheels."""
    root = tmp_path_factory.mktemp("root")
    bare.make_root(root)
    enter = bare.enter(root)
    carry_python(root)
    shutil.copytree(wheels, root / "wheels")
    variables = {"PYTHONPATH": "/deps", "PATH": os.environ["PATH"], "HOME": "/tmp"}
    place = re.sub("^(/usr(?=/lib/))?/", "/", str(PYTHON))

    def run(*arguments):
        start = time.monotonic()
        done = subprocess.run([*enter, place, *arguments], env=variables, capture_output=True)
        assert done.returncode == 0, done.stderr.decode()
        return time.monotonic() - start

    run.root = root
    return run


def test_they_install_and_show_a_picture_and_make_a_data_set(python):
    pip = "-m", "pip", "install", "--no-index", "--find-links", "/wheels"
    installing = python(*pip, "heliograph[server]")
    first = python("-c", PICTURE)
    data_set = python("-c", SET)
    print(f"installed in {installing:.1f} s, first picture {first:.2f} s, set {data_set:.1f} s")
    assert (python.root / "tmp/first.png").stat().st_size > 500
    assert len(list((python.root / "tmp/set").rglob("*.png"))) == 100
    assert installing <= 60 and first <= 5 and data_set <= 60


def test_nvisii_is_a_wheel_of_its_own_that_brings_the_client(python):
    pip = "-m", "pip", "install", "--no-index", "--find-links", "/wheels"
    python(*pip, "heliograph-nvisii", "heliograph-server")
    python("-c", NVISII)
    assert (python.root / "tmp/script.png").stat().st_size > 50
    python("-m", "pip", "uninstall", "--yes", "heliograph-nvisii")
    python("-c", "import heliograph, importlib.util as u; assert u.find_spec('nvisii') is None")


def test_that_for_gpus_goes_first_and_renders_where_there_is_none(python):
    pip = "-m", "pip", "install", "--no-index", "--find-links", "/wheels"
    python(*pip, "heliograph[server,server-cuda]")
    python("-c", FOR_GPUS + PICTURE)
    python("-m", "pip", "uninstall", "--yes", "heliograph-server")
    python("-c", FOR_GPUS + PICTURE)


def test_what_they_are_and_how_large(wheels):
    client, scripts, *servers = sorted(wheels.iterdir())
    assert client.name.endswith("-py3-none-any.whl") and scripts.name.endswith("-py3-none-any.whl")
    roots = {name.split("/")[0] for name in zipfile.ZipFile(scripts).namelist()}
    assert roots == {"nvisii", "heliograph_nvisii-" + client.name.split("-")[1] + ".dist-info"}
    for server, package in zip(
        servers, ("heliograph_server", "heliograph_server_cuda"), strict=True
    ):
        assert re.fullmatch(rf"{package}-[\d.]+-py3-none-manylinux_\S+\.whl", server.name)
        assert server.stat().st_size <= 60e6
        with zipfile.ZipFile(server) as archive:
            assert archive.testzip() is None
            assert f"{package}/bin/heliographd" in archive.namelist()
            assert f"{package}/licences/PACKAGES" in archive.namelist()
            info = "-".join(server.name.split("-")[:2]) + ".dist-info"
            metadata = archive.read(f"{info}/METADATA").decode()
        assert f"\nName: {package.replace('_', '-')}\n" in metadata
        assert ("architectures" in metadata) == (package == "heliograph_server_cuda")
    assert any("/_proto/" in name for name in zipfile.ZipFile(client).namelist())


def test_each_says_what_it_is_made_of(wheels):
    for path in sorted(wheels.iterdir()):
        package = path.name.split("-")[0]
        info = "-".join(path.name.split("-")[:2]) + ".dist-info"
        with zipfile.ZipFile(path) as archive:
            document = json.loads(archive.read(f"{info}/sboms/{package}.cdx.json"))
            files = {name: archive.read(name) for name in archive.namelist()}
        parts = [document["metadata"]["component"], *document["components"]]
        listed = {
            file["name"]: file["hashes"][0]["content"]
            for part in parts
            for file in part.get("components", ())
        }
        here = {
            name: hashlib.sha256(data).hexdigest()
            for name, data in files.items()
            if data.startswith(b"\x7fELF")
        }
        assert listed == here and bool(here) == package.startswith("heliograph_server")
        assert f"{info}/sboms/{package}.cdx.json,sha256=" in files[f"{info}/RECORD"].decode()
