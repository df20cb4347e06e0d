"""The page of `heliograph view` in a headless Chromium: what a user does with the mouse."""

import io

import browser
import heliograph as hg
import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.skipif(
    browser.program() is None,
    reason=f"NO BROWSER: none of {', '.join(browser.NAMES)} is on PATH, the page was not tested; "
    "apt-get install --no-install-recommends chromium-headless-shell",
)

# The picture of the camera at rest, in full size.
RESTS = "shown && shown.final && !moving && !sending && shown.width === current().width"
WAIT = "new Promise((done) => setTimeout(done, 50))"


@pytest.fixture(scope="module")
def page(client, tmp_path_factory):
    """A red cube beside a child of it, seen from the front on a small page."""
    with client.create_scene("shelf") as scene:
        with scene.edit() as edit:
            edit.dome(np.ones((2, 4, 3), "f4"))
            edit.mesh("cube/mesh", **hg.shapes.cube(0.8))
            edit.material("red", base_color=(0.8, 0.02, 0.02))
            edit.entity("cube", mesh="cube/mesh", material="red", category="cube")
            edit.entity("cube/<b>lid</b>", parent="cube", transform=hg.Pose((0, 0, 1)))
            lens = hg.Camera.from_fov(40, 64, 48, degrees=True)
            edit.entity("eye", camera=lens, transform=hg.look_at((0, -3, 0.2), (0, 0, 0)))
        folder = tmp_path_factory.mktemp("chromium")
        with (
            hg.Viewer(scene, "eye", spp=4) as viewer,
            browser.Browser(folder, viewer.url, (560, 360)) as page,
        ):
            page.scene = scene
            page.until(RESTS)
            yield page


def stage(page):
    """The middle of the picture, page pixels."""
    box = page.run("(({x, y, width, height}) => [x, y, width, height])"
                   "(document.getElementById('picture').getBoundingClientRect())")  # fmt: skip
    return box[0] + box[2] / 2, box[1] + box[3] / 2


def pixels(page):
    page.run(WAIT)
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)


def test_it_shows_the_scene_and_says_nothing_bad(page):
    x, y = (round(v) for v in stage(page))
    red, _, blue = pixels(page)[y, x]
    assert red > 2 * blue
    assert page.run("document.title") == "shelf"
    assert page.run("document.getElementById('progress').textContent") == "4 samples a pixel"
    assert page.run("document.getElementById('error').textContent") == ""
    assert page.console == []


def test_dragging_orbits_and_the_wheel_zooms(page):
    x, y = stage(page)
    before = page.run("({...orbit})")
    page.drag((x, y), (x + 60, y + 20))
    after = page.until(f"{RESTS} && {{...orbit}}")
    assert after["azimuth"] < before["azimuth"] and after["elevation"] > before["elevation"]
    assert after["target"] == before["target"]
    pose = np.array(page.run("shown.pose"))
    assert np.allclose((np.linalg.inv(pose)[:3, 3]), page.run("eyeOf(orbit)"), atol=1e-4)
    page.mouse("mouseWheel", x, y, deltaX=0, deltaY=200)
    assert page.run("orbit.distance") > after["distance"]
    page.drag((x, y), (x + 30, y), button="right")
    assert page.run("orbit.target") != after["target"]
    page.run("document.getElementById('all').click()")
    page.until(RESTS)


def test_a_click_selects_and_the_tree_follows(page):
    x, y = stage(page)
    page.click(x, y)
    page.until("selected && selected.rows")
    assert page.run("document.querySelector('#tree .selected').textContent").endswith("cube")
    assert "red" in page.run("document.getElementById('about').textContent")
    page.run("document.querySelector('#tree .selected .fold').click()")
    names = page.run("[...document.querySelectorAll('#tree .name')].map((e) => e.textContent)")
    assert "<b>lid</b>" in names and not page.run("document.querySelector('#tree b')")
    page.run("{ const f = document.getElementById('filter'); f.value = 'ey';"
             "f.dispatchEvent(new Event('input')); }")  # fmt: skip
    assert page.run("document.querySelectorAll('#tree .row').length") == 1
    page.run("{ const f = document.getElementById('filter'); f.value = '';"
             "f.dispatchEvent(new Event('input')); select(null); }")  # fmt: skip


def after(page, script):
    """The page's pixels when what a script asks for is there."""
    serial = page.run("shown.serial")
    page.run(script)
    page.until(f"shown.serial > {serial} && shown.final && !sending")
    return pixels(page)


def test_layers_planes_and_exposure(page):
    x, y = (round(v) for v in stage(page))
    choose = "{{ const s = document.getElementById('{}'); s.value = '{}';"
    choose += "s.dispatchEvent(new Event('{}')); }}"
    plain = pixels(page)
    toggle = "document.querySelector('[data-layer=cuboids]').click()"
    drawn = after(page, toggle)
    assert (np.abs(drawn - plain)[60 : y + 60, x - 80 : x + 80].max(axis=2) > 60).any()
    after(page, toggle)
    red, green, blue = after(page, choose.format("plane", "depth", "change"))[y, x]
    assert red == green == blue
    assert page.run("document.getElementById('progress').textContent") == "exact"
    after(page, choose.format("plane", "beauty", "change"))
    assert after(page, choose.format("exposure", -8, "input"))[y, x].max() < 40
    assert page.run("document.getElementById('stops').textContent") == "-8.0"
    after(page, "document.getElementById('auto').click()")


def test_it_follows_the_scene(page):
    with page.scene.edit() as edit:
        edit.entity("newcomer", transform=hg.Pose((0, 0, 3)))
    page.until(
        "[...document.querySelectorAll('#tree .name')].some((e) => e.textContent == 'newcomer')"
    )
    assert page.console == []
