"""The gateway of `heliograph view` without a browser: who may ask, what it answers, how it ends."""

import http.client
import io
import json
import os
import pathlib
import signal
import subprocess
import sys
from urllib.parse import urlsplit

import heliograph as hg
import numpy as np
import pytest
from PIL import Image

LOOK = {"eye": [0, -3, 0], "target": [0, 0, 0], "fov": 40, "width": 64, "height": 48}


class Page:
    """A browser's side of it."""

    def __init__(self, url):
        parts = urlsplit(url)
        self.host, self.root = parts.netloc, parts.path
        self.session = self.post("open", {})["session"]
        self.serial = 0

    def send(self, method, path, body=None, **headers):
        connection = http.client.HTTPConnection(self.host, timeout=60)
        try:
            data = None if body is None else json.dumps(body)
            kind = {} if body is None else {"Content-Type": "application/json"}
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request(method, path, data, {**kind, **named})
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

    def post(self, route, body):
        status, _, data = self.send("POST", self.root + route, body)
        assert status == 200, data
        return json.loads(data)

    def want(self, **wish):
        self.post(f"want?session={self.session}", wish)

    def picture(self, good=lambda shown: shown["samples"] >= 4):
        """Description of the first picture that is good, and its pixels."""
        for _ in range(50):
            path = f"{self.root}picture?session={self.session}&after={self.serial}"
            status, headers, data = self.send("GET", path)
            assert status == 200
            shown = json.loads(headers["X-Picture"])
            assert shown["serial"] > self.serial
            self.serial = shown["serial"]
            if shown["error"] or good(shown):
                return shown, np.asarray(Image.open(io.BytesIO(data))) if data else None
        raise AssertionError("no picture is good")


@pytest.fixture(scope="module")
def world(client):
    with client.create_scene("world") as scene:
        with scene.edit() as edit:
            edit.dome(np.ones((2, 4, 3), "f4"))
            edit.mesh("cube/mesh", **hg.shapes.cube(0.8))
            edit.material("red", base_color=(0.8, 0.02, 0.02))
            edit.entity("cube", mesh="cube/mesh", material="red", category="cube")
            lens = hg.Camera.from_fov(50, 64, 48, degrees=True)
            edit.entity("eye", camera=lens, transform=hg.look_at((2, -3, 2), (0, 0, 0)))
        yield scene


@pytest.fixture
def viewer(world):
    with hg.Viewer(world, "eye", spp=8) as viewer:
        yield viewer


def test_a_picture_refines_and_follows_the_camera(viewer):
    page = Page(viewer.url)
    page.want(**LOOK, exposure=0)
    shown, pixels = page.picture(lambda shown: shown["final"])
    assert (shown["samples"], shown["width"], shown["height"]) == (8, 64, 48)
    assert pixels.shape == (48, 64, 3)
    middle = pixels[24, 32].astype(int)
    assert middle[0] > 2 * middle[2] and pixels[2, 2].min() > 150  # the red cube; the dome
    page.want(eye=[0, -3, 0], target=[3, 0, 0])
    shown, pixels = page.picture(lambda shown: shown["pose"][0][0] < 0.99)
    assert pixels[24, 32].min() > 150
    assert shown["K"][0][2] == 31.5


def test_restyling_renders_nothing(viewer):
    page = Page(viewer.url)
    page.want(**LOOK, exposure=0)
    before, dark = page.picture(lambda shown: shown["final"])
    page.want(exposure=-3)
    after, darker = page.picture()
    assert after["samples"] == before["samples"] and after["seconds"] == before["seconds"]
    assert darker.mean() < 0.7 * dark.mean()


def test_planes_and_layers(viewer):
    page = Page(viewer.url)
    page.want(**LOOK, plane="instance")
    _, plain = page.picture(lambda shown: True)
    assert plain[24, 32].any() and not plain[2, 2].any()
    page.want(layers=["boxes", "masks", "cuboids", "axes", "amodal", "keypoints", "names"])
    shown, drawn = page.picture(lambda shown: shown["width"] > 0)
    assert shown["error"] == "" and (drawn != plain).any()


def test_it_follows_edits_and_looks_through_cameras(viewer, world):
    page = Page(viewer.url)
    page.want(camera="eye")
    _, before = page.picture()
    with world.edit() as edit:
        edit.entity("cube", transform=hg.Pose((0, 0, 50)))
    now = world.revision
    _, after = page.picture(lambda shown: shown["revision"] == now)
    with world.edit() as edit:
        edit.entity("cube", transform=hg.Pose((0, 0, 0)))
    assert before[24, 32, 0] > 2 * before[24, 32, 2] and after[24, 32].std() < 5


def test_picking_and_what_is_said_of_objects(viewer, world):
    page = Page(viewer.url)
    page.want(**LOOK)
    page.picture()
    hit = page.post(f"pick?session={page.session}", {"at": [0.5, 0.5]})
    assert hit["id"] == str(world["cube"].id) and hit["position"][1] == pytest.approx(
        -0.4, abs=0.01
    )
    assert page.post(f"pick?session={page.session}", {"at": [0.02, 0.02]}) == {}
    page.want(camera="eye")
    page.picture(lambda shown: shown["camera"] == "eye")
    assert page.post(f"pick?session={page.session}", {"at": [0.5, 0.5]})["id"] == hit["id"]
    status, _, data = page.send("GET", f"{page.root}object?id={hit['id']}")
    rows = dict(json.loads(data)["rows"])
    assert status == 200 and rows["material"] == "red" and rows["mesh"] == "cube/mesh"
    scene = json.loads(page.send("GET", page.root + "scene")[2])
    assert [hit["id"], "entity", "cube", "0"] in [row[:4] for row in scene["objects"]]
    assert scene["cameras"]["eye"]["eye"] == pytest.approx([2, -3, 2], abs=1e-5)
    assert np.allclose(scene["bounds"], [[-0.4] * 3, [0.4] * 3], atol=1e-5)


def test_saving_gives_the_picture_as_png(viewer):
    page = Page(viewer.url)
    assert page.send("GET", f"{page.root}save?session={page.session}")[0] == 404
    page.want(**LOOK)
    page.picture()
    status, headers, data = page.send("GET", f"{page.root}save?session={page.session}")
    assert status == 200 and "attachment" in headers["Content-Disposition"]
    assert Image.open(io.BytesIO(data)).size == (64, 48)


def test_several_pages_look_from_where_they_like(viewer):
    left, right = Page(viewer.url), Page(viewer.url)
    left.want(**LOOK)
    right.want(**{**LOOK, "eye": [0, 0, 4], "width": 32})
    assert left.picture()[0]["width"] == 64
    assert right.picture()[0]["width"] == 32
    left.post(f"close?session={left.session}", {})
    assert left.send("GET", f"{left.root}picture?session={left.session}")[0] == 404
    right.want(width=40)
    assert right.picture(lambda shown: shown["width"] == 40)


def test_who_may_not_ask(viewer):
    page = Page(viewer.url)
    port = page.host.partition(":")[2]
    scene = page.root + "scene"
    wrong = "/" + "A" * len(viewer.token) + "/scene"
    for path in (wrong, "/", "/scene", scene[:-7] + "x/scene", "/%00/scene", "//scene"):
        status, _, data = page.send("GET", path)
        assert status == 403 and json.loads(data) == {"error": "forbidden"}
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1.evil.example", "", "0.0.0.0"):
        assert page.send("GET", scene, Host=host)[0] == 403, host
    for host in ("localhost:1234", "127.0.0.1", "[::1]:80"):
        assert page.send("GET", scene, Host=host)[0] == 200, host
    assert page.send("GET", scene, Sec_Fetch_Site="cross-site")[0] == 403
    assert page.send("POST", page.root + "open", {}, Origin="http://evil.example")[0] == 403
    status, headers, _ = page.send("GET", scene, Origin=f"http://{page.host}")
    assert status == 200
    assert not any(name.lower().startswith("access-control") for name in headers)
    assert page.send("OPTIONS", scene)[0] == 501


def test_what_is_refused(viewer):
    page = Page(viewer.url)
    want = f"{page.root}want?session={page.session}"
    wishes = [{"eye": [0, 1]}, {"eye": [0, 0, None]}, {"width": 1e9}, {"fov": 0}, {"spp": 9}]
    wishes += [{"layers": ["x"]}, {"exposure": "much"}, {"plane": 3}, [1], {"eye": [0, 0, 0]}]
    for wish in wishes:
        status, _, data = page.send("POST", want, wish)
        assert status == 400 and json.loads(data)["error"], wish
    status, _, _ = page.send("POST", want, None, Content_Type="text/plain")
    assert status == 400
    assert page.send("POST", want, {"plane": "x" * 70_000})[0] == 413
    assert page.send("POST", f"{page.root}want?session=no", {})[0] == 404
    assert page.send("GET", page.root + "no")[0] == 404
    assert page.send("GET", page.root + "object?id=x")[0] == 400
    page.want(**LOOK, plane="no_such_plane")
    assert "no_such_plane" in page.picture()[0]["error"]
    page.want(plane="beauty")
    assert page.picture()[0]["error"] == ""


def test_the_page_loads_nothing_from_elsewhere(viewer):
    page = Page(viewer.url)
    status, headers, data = page.send("GET", page.root)
    text, policy = data.decode(), headers["Content-Security-Policy"]
    assert status == 200 and headers["Content-Type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in policy and "unsafe" not in policy
    assert "://" not in text and "{{nonce}}" not in text and viewer.token not in text
    again = page.send("GET", page.root)[1]["Content-Security-Policy"]
    assert again != policy  # a nonce is used once
    assert headers["Referrer-Policy"] == "no-referrer" and headers["Cache-Control"] == "no-store"


def test_too_many_pages_are_refused(viewer):
    for _ in range(16):
        last = Page(viewer.url)
    status, _, data = last.send("POST", last.root + "open", {})
    assert status == 400 and "16 pages" in json.loads(data)["error"]


def test_the_command_shows_a_model_and_ends_by_interrupt():
    model = pathlib.Path(__file__).parents[1] / "assets/mesh/spot_control_mesh.obj"
    command = [sys.executable, "-m", "heliograph", "view", str(model), "--spp", "4"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ) as process:
        try:
            page = Page(process.stdout.readline().strip())
            page.want(**LOOK)
            assert page.picture()[1].shape == (48, 64, 3)
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=30) == 0
        finally:
            process.kill()


def test_the_command_says_what_it_needs():
    for arguments in ([], ["a.glb", "--scene", "x"], ["--scene", "x"]):
        command = [sys.executable, "-m", "heliograph", "view", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 2 and "--scene" in done.stderr
