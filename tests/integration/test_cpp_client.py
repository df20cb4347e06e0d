"""The C++ client beside the Python client: the same scene, the examples, the installed package."""

import json
import os
import pathlib
import re
import subprocess

import heliograph as hg
import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]
PROGRAMS = pathlib.Path(os.environ.get("HELIOGRAPHD", ROOT / "build/cpu/bin/heliographd")).parent
BUILD = PROGRAMS.parent
PLANES = [
    *("beauty", "albedo_mean", "normal_mean", "variance", "samples", "depth", "distance"),
    *("position", "position_camera", "normal", "normal_camera", "geometric_normal", "tangent"),
    *("uv", "barycentric", "base_color", "roughness", "metallic", "transmission", "opacity"),
    *("emission", "instance", "semantic", "part", "material", "primitive", "nocs"),
    *("object_coordinates", "flow_forward", "flow_backward", "flow_forward_valid"),
    *("flow_backward_valid", "flow_forward_visible", "flow_backward_visible", "scene_flow"),
    *("coverage", "direct_diffuse", "indirect_diffuse", "direct_glossy", "indirect_glossy"),
    *("direct_transmission", "indirect_transmission", "direct_subsurface", "indirect_subsurface"),
    *("direct_volume", "indirect_volume", "emission_light", "environment_light"),
    *("ior", "diffuse_color"),
    *("ambient_occlusion", "cost", "beauty_still", "beauty:lamp", "shadow_catcher"),
]


def run(*command, **options):
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, timeout=120, **options
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


def build(scene: hg.Scene) -> None:
    """As clients/cpp/tests/same_scene.cpp."""
    y, x = np.mgrid[0:16, 0:16]
    channel = np.arange(3)
    light = ((x // 4 + y // 4) % 2 == 0)[..., None]
    checks = np.where(light, 230 - 40 * channel, 30 + 15 * channel).astype("u1")
    with scene.edit() as edit:
        edit.categories("ball", "box")
        edit.sample_studio(floor=12)
        ball = edit.mesh("ball/mesh", **hg.shapes.sphere(0.4, 48))
        edit.mesh("ring/mesh", **hg.shapes.torus())
        edit.mesh("box/mesh", **hg.shapes.cube(0.3))
        can = hg.shapes.cylinder(0.2, 0.5, 32)
        edit.mesh("can/mesh", **can, keypoints={"top": (0, 0, 0.25)})
        texture = edit.texture("checks", checks, filter="nearest")
        edit.material("gold", **hg.materials.gold)
        edit.material("glass", **hg.materials.glass)
        use = hg.Tex(texture, factor=(0.9, 0.8, 0.7))
        edit.material("checked", base_color=use, roughness=0.4, clearcoat=0.5)
        pose = hg.Pose((-0.5, 0.1, 0.4))
        edit.entity("ball", mesh=ball, material="gold", category="ball", transform=pose)
        pose = hg.Pose((0.6, -0.4, 0.35), euler=(0.3, 0.5, 0.7), scale=0.8)
        edit.entity("ring", mesh="ring/mesh", material="glass", label=7, transform=pose)
        pose = hg.Pose((0.5, 0.6, 0.3), wxyz=(0.9, 0.1, 0.2, 0.3))
        edit.entity("can", mesh="can/mesh", material="checked", category="can", transform=pose)
        poses = [hg.Pose((-1 + 0.5 * i, -0.9, 0.15), xyzw=(0, 0, 0.1 * i, 1)) for i in range(5)]
        edit.instances("box", mesh="box/mesh", material="checked", category="box", transforms=poses)
        lamp = hg.Light(lumen=300, shape="rectangle", width=0.5, height=0.25, temperature=3200)
        pose = hg.look_at((0, -1, 2), (0, 0, 0))
        edit.entity("lamp", light=lamp, light_group="lamp", transform=pose)
        lens = hg.Camera.from_fov(
            47, 160, 120, degrees=True, distortion=(-0.1, 0.02, 0.001, -0.002)
        )
        edit.entity("camera", camera=lens, transform=hg.look_at((1.2, -2.9, 1.6), (0, 0, 0.3)))
    with scene.edit() as edit:
        edit.advance(1 / 24)
        edit.update("ball", transform=hg.Pose((-0.45, 0.12, 0.42)))


def test_the_same_scene_in_both_languages_gives_the_same_bytes(client, scene, tmp_path):
    run(PROGRAMS / "same_scene", client.address, tmp_path, *PLANES)
    build(scene)
    labels = {"boxes": True, "amodal": True, "amodal_masks": True, "keypoints": True}
    frame = scene.render("camera", planes=PLANES, spp=8, seed=5, labels=labels, hold=True)
    different = [
        name for name in frame if frame[name].tobytes() != (tmp_path / f"{name}.raw").read_bytes()
    ]
    assert different == []
    assert len(frame.planes) == len(PLANES)
    for name in frame.labels:
        column = frame.labels[name]
        if isinstance(column, np.ndarray) and name != "entity":
            assert column.tobytes() == (tmp_path / f"labels.{name}.raw").read_bytes(), name
    with client.load_scene(tmp_path / "scene.helio") as loaded:  # written by C++
        again = loaded.render("camera", planes=["beauty"], spp=8, seed=5)
    assert again["beauty"].tobytes() == frame["beauty"].tobytes()


def test_the_first_frame(tmp_path):
    out = run(PROGRAMS / "example_first_frame", tmp_path / "out.ppm")
    assert 2.4 < float(re.findall(r"is ([0-9.]+) m away", out)[0]) < 2.8
    assert (tmp_path / "out.ppm").stat().st_size == 640 * 480 * 3 + len("P6\n640 480\n255\n")


def test_the_edit_loop(client):
    lines = run(PROGRAMS / "example_edit_loop", client.address, 3).splitlines()
    assert len(lines) == 3
    assert all(float(line.split()[-2]) > 0.5 for line in lines)


def test_the_labels(client):
    out = run(PROGRAMS / "example_labels", client.address)
    assert sorted(line.split(":")[0] for line in out.splitlines()) == [
        *("ball/0", "ball/1", "ball/2", "post/0"),
    ]
    assert out.count(", 0 strays") == 4


def test_the_batch(client):
    lines = run(PROGRAMS / "example_batch", client.address, 6).splitlines()
    assert sorted(line.split(":")[0] for line in lines) == [f"job {i}" for i in range(6)]


def test_the_live_picture(client):
    lines = run(PROGRAMS / "example_live", client.address, 3).splitlines()
    assert [line for line in lines if line.endswith(": 64 samples")] == [
        f"move {i}: 64 samples" for i in range(3)
    ]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("prefix")
    run("cmake", "--install", BUILD, "--component", "heliograph_client", "--prefix", prefix)
    return prefix


@pytest.fixture(scope="module")
def robot(package, tmp_path_factory):
    """A program of another project, which finds the installed package."""
    build = tmp_path_factory.mktemp("robot")
    source = ROOT / "clients/cpp/tests/downstream"
    run("cmake", "-S", source, "-B", build, f"-DCMAKE_PREFIX_PATH={package}")
    run("cmake", "--build", build)
    return build / "robot"


def test_a_project_uses_the_installed_package(client, robot):
    assert float(run(robot, client.address)) == 2.5


def test_loopback_tcp_with_its_token(robot, tmp_path):
    read, write = os.pipe()
    daemon = subprocess.Popen(
        [PROGRAMS / "heliographd", "--socket", tmp_path / "socket", "--ready-fd", str(write)]
        + ["--listen", "127.0.0.1:0", "--token-file", tmp_path / "token", "--log-level", "off"],
        pass_fds=(write,),
    )
    os.close(write)
    try:
        with os.fdopen(read) as ready:
            address = json.loads(ready.readline())["listen"][0]
        token = (tmp_path / "token").read_text().strip()
        assert float(run(robot, address, token)) == 2.5
        refused = subprocess.run([robot, address, "wrong"], capture_output=True, text=True)
        assert refused.returncode == 1
        assert refused.stderr.startswith("UNAUTHENTICATED")
    finally:
        daemon.terminate()
        assert daemon.wait(10) == 0


def test_the_installed_headers_show_no_protobuf_and_no_grpc(package):
    headers = sorted((package / "include/heliograph").glob("*.h"))
    assert len(headers) > 10
    for header in headers:
        assert not re.search(r"#include [<\"](google|grpc|wire|.*\.pb)", header.read_text()), header


def test_the_client_alone_needs_nothing_of_the_renderer(tmp_path):
    log = run("cmake", "-S", ROOT, "-B", tmp_path, "-G", "Ninja", "-DHELIOGRAPH_DAEMON=OFF")
    assert "embree" not in (tmp_path / "CMakeCache.txt").read_text().lower()
    assert "Build files have been written" in log
    targets = run("ninja", "-C", tmp_path, "-t", "targets", "all")
    assert "libheliograph_client.a" in targets
    assert "heliographd" not in targets
