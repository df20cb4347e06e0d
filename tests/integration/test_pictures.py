"""Pictures to look at: labels drawn where they are, contact sheets, what a notebook shows."""

import io

import heliograph as hg
import numpy as np
import pytest
from heliograph import tonemap
from PIL import Image

PLANES = ["beauty", "depth", "instance", "flow_backward", "flow_backward_valid"]
LABELS = {"boxes": True, "amodal": True, "amodal_masks": True, "keypoints": True}


@pytest.fixture(scope="module")
def frame(client):
    """A cube before a ball, both lit; the ball moved right by 0.1 m; a keypoint on it is hidden."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(np.ones((2, 4, 3), "f4"))
            edit.mesh(
                "ball/mesh",
                **hg.shapes.sphere(0.5),
                keypoints={"a": (-0.5, 0, 0), "b": (0, 0.5, 0)},
            )
            edit.mesh("cube/mesh", **hg.shapes.cube(0.3))
            edit.material("black", base_color=0)
            edit.entity("ball", mesh="ball/mesh", material="black", category="toy")
            edit.entity(
                "cube",
                mesh="cube/mesh",
                material="black",
                category="box <b>",
                transform=hg.Pose((0.3, -1, 0)),
            )
            lens = hg.Camera.from_fov(50, 160, 120, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))
        with scene.edit() as edit:
            edit.advance(0.1)
            edit.entity("ball", transform=hg.Pose((0.1, 0, 0)))
        yield scene.render("cam", spp=4, planes=PLANES, labels=LABELS, hold=True)


def changed(frame, *layers, **options):
    """(H, W) bool: where layers are drawn."""
    plain = frame.picture(options.get("plane", "")).astype(int)
    plain = plain[..., None] if plain.ndim == 2 else plain
    return np.abs(frame.annotated(*layers, **options).astype(int) - plain).max(axis=2) > 40


def test_boxes_lie_on_the_boxes(frame):
    drawn = changed(frame, "boxes", only="cube")
    x0, y0, x1, y1 = frame.labels["bbox_visible"][frame.labels["name"].index("cube")]
    assert drawn[y0, x0:x1].all() and drawn[y0:y1, x1 - 1].all()
    inside = drawn[y0 + 4 : y1 - 4, x0 + 4 : x1 - 4]
    assert not inside.any() and not drawn[:, x1 + 3 :].any()


def test_masks_cover_exactly_the_visible_pixels(frame):
    label = frame.labels["label"][frame.labels["name"].index("ball")]
    masks = (frame.annotated("masks", only=label) != frame.image()).any(axis=2)
    assert np.array_equal(masks, frame["instance"] == label)
    edge = changed(frame, "outlines", only=int(label))
    assert edge.any() and not (edge & (frame["instance"] != label)).any()


def test_the_amodal_outline_is_drawn_where_the_ball_is_hidden(frame):
    label = frame.labels["label"][frame.labels["name"].index("ball")]
    drawn = changed(frame, "amodal", only="toy")
    assert (drawn & (frame["instance"] != label)).any()
    assert not (drawn & ~frame.amodal_mask(label)).any()


def test_cuboids_and_axes_start_at_the_corners_and_the_origin(frame):
    i = frame.labels["name"].index("cube")
    drawn = changed(frame, "cuboids", only="cube")
    for x, y in np.floor(frame.labels["corners_image"][i] + 0.5).astype(int):
        assert drawn[y - 1 : y + 2, x - 1 : x + 2].any()
    axes = frame.annotated("axes", only="cube").astype(int)
    at = frame.K @ frame.labels["camera_from_object_cv"][i][:3, 3]
    x, y = (at[:2] / at[2] + 0.5).astype(int)
    along_x = axes[y - 1 : y + 2, x + 6]
    assert (along_x[:, 0] - along_x[:, 2]).max() > 80  # x, to the right, is red
    assert (axes[y - 8, x - 1 : x + 2, 2] - axes[y - 8, x - 1 : x + 2, 0]).max() > 80  # z is blue


def test_keypoints_and_their_skeleton(frame):
    keypoint = frame.labels["keypoint_name"].index("a")
    x, y = np.floor(frame.labels["keypoint_image"][keypoint] + 0.5).astype(int)
    assert changed(frame, "keypoints")[y, x]
    lines = changed(frame, "keypoints", skeleton=[("a", "b")])
    assert lines.sum() > changed(frame, "keypoints").sum()
    assert np.array_equal(lines, changed(frame, "keypoints", skeleton=[(0, 1)]))


def test_flow_arrows_are_where_something_moved(frame):
    drawn = changed(frame, "flow")
    moved = np.hypot(*np.moveaxis(frame["flow_backward"], 2, 0)) > 0.5
    assert drawn[moved].any()
    assert not drawn[:, 120:].any()
    assert changed(frame, "wheel")[90:, 120:].any()


def test_flow_colors_are_those_of_baker():
    flow = np.array([[[1, 0], [0, 1], [-1, 0], [0, 0], [np.nan, 0]]], dtype="f4")
    right, down, left, still, unknown = tonemap.colors_of_flow(flow)[0].astype(int)
    assert right[0] == 255 and right[2] < 60  # red
    assert down[0] > 200 and down[1] > 200 and down[2] == 0  # yellow
    assert left[2] == 255 and left[0] == 0  # blue to cyan
    assert still.tolist() == [255, 255, 255] and unknown.tolist() == [0, 0, 0]


def test_scale_enlarges_and_text_stays_inside(frame):
    big = frame.annotated(scale=3)
    assert big.shape == (360, 480, 3) and big.dtype == np.uint8
    assert changed(frame, "names", plane="depth").any()
    assert changed(frame, "categories").any()


@pytest.mark.parametrize(
    ("layers", "options", "message"),
    [
        (["boxen"], {}, "none of masks"),
        (["boxes"], {"scale": 0}, "scale"),
        (["keypoints"], {"skeleton": [("a",)]}, "skeleton"),
    ],
)
def test_what_is_refused(frame, layers, options, message):
    with pytest.raises(hg.InvalidArgument, match=message):
        frame.annotated(*layers, **options)


def test_what_a_layer_lacks_is_named(client):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.entity("cam", camera=hg.Camera.from_fov(50, 16, 12, degrees=True))
        frame = scene.render("cam", spp=1)
    with pytest.raises(hg.InvalidArgument, match="render with labels=True"):
        frame.annotated("boxes")
    with pytest.raises(hg.InvalidArgument, match=r"planes=\[\.\.\., 'flow_forward'\]"):
        frame.annotated("flow")


def test_axes_need_a_pinhole(client):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("m", **hg.shapes.cube(0.4))
            edit.entity("cube", mesh="m")
            lens = hg.Camera.fisheye(180, 64, 64, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0.3, -0.5, 0.3), (0, 0, 0)))
        frame = scene.render("cam", planes=["depth"], labels=True)
    with pytest.raises(hg.Unimplemented, match="pinhole"):
        frame.annotated("axes")
    assert frame.annotated("cuboids").shape == (64, 64, 3)


def test_contact_sheets(frame, tmp_path):
    path = frame.image().save(tmp_path / "one.png")
    sheet = hg.contact_sheet([frame, frame["instance"].astype("u1"), path], columns=2)
    assert sheet.shape[1] == 2 * 170 + 10 and sheet.shape[0] == 2 * 130 + 10
    assert np.array_equal(sheet[10:130, 10:170], frame.image())
    assert np.array_equal(sheet[140:260, 10:170], frame.image())
    named = hg.contact_sheet({"a": frame, "b": frame}, size=(40, 40), columns=1)
    assert named.shape[1] == 60 and not np.array_equal(named, hg.contact_sheet(
        {"a": frame, "c": frame}, size=(40, 40), columns=1))  # fmt: skip
    assert hg.contact_sheet(frame).shape[1] > 3 * 160  # all planes
    for given, options in (([], {}), ([np.zeros((2, 2))], {}), ([frame], {"columns": 0}),
                           ([frame], {"captions": ["a", "b"]})):  # fmt: skip
        with pytest.raises(hg.InvalidArgument):
            hg.contact_sheet(given, **options)


def test_a_picture_shows_itself(frame, monkeypatch):
    picture = frame.picture("depth")
    assert isinstance(picture, hg.Picture) and isinstance(picture, np.ndarray)
    assert np.array_equal(Image.open(io.BytesIO(picture._repr_png_())), picture)
    assert (picture / 2)._repr_png_() is None
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(hg.FailedPrecondition, match="save"):
        frame.show()
    shown = []
    monkeypatch.setattr(hg.Picture, "show", lambda picture: shown.append(picture))
    frame.show()
    frame.show("beauty", "depth")
    assert np.array_equal(shown[0], frame.image(exposure="auto"))
    assert shown[1].shape[1] > 320


def test_a_notebook_shows_frames_and_scenes(frame, client):
    html = frame._repr_html_()
    assert "data:image/png;base64," in html and "160 x 120" in html and "120x160x2" in html
    with client.create_scene("a<b>") as scene:
        with scene.edit() as edit:
            edit.entity("arm")
            edit.entity("<i>hand</i>", parent="arm")
        text, html = scene.tree(), scene._repr_html_()
        with scene.edit() as edit:
            edit.instances("many", transforms=np.tile(np.eye(4), (600, 1, 1)))
        long = scene._repr_html_()
    assert text.splitlines() == ["entity arm", "  entity <i>hand</i>"]
    assert "&lt;i&gt;hand" in html and "<i>" not in html and "a&lt;b&gt;" in html
    assert "102 more" in long and len(long) < 100_000
