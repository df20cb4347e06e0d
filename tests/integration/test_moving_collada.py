"""COLLADA with skins, morph targets and clips: imported, animated, against arithmetic and against
the same file at rest."""

from __future__ import annotations

import re

import numpy as np
import pytest
from banner import ROOT, TURN, build, check
from banner_collada import Collada
from oracle_motion import between

PLANES = ["depth", "position", "instance"]
AXES = [("Y_UP", 1.0), ("Z_UP", 0.01), ("Z_UP", 1.0)]


class File:
    """The objects that `build` imports."""

    def __init__(self, path, text: str) -> None:
        self.path = path
        path.write_text(text)


@pytest.fixture(params=AXES, ids=lambda p: f"{p[0]}-{p[1]:g}")
def collada(request):
    return Collada(*request.param)


def banner_at(collada, time):
    u = float(between(time, (0.0, 1.0), (0.0, 1.0)))
    return collada.banner.shape(ROOT, TURN * u, u)


@pytest.mark.parametrize("time", [-0.5, 0.3, 0.75])
def test_a_clip_moves_joints_and_morph_targets(scene, collada, tmp_path, time):
    asset = build(scene, File(tmp_path / "a.dae", collada.by_hand()), animation=0)
    assert asset.warnings == []
    planes = [*PLANES, "flow_forward", "scene_flow"]
    frame = scene.render("cam", planes=planes, time=time, frame_interval=0.6)
    check(frame, banner_at(collada, time), banner_at(collada, time + 0.6))


def test_without_a_clip_it_rests(scene, collada, tmp_path):
    build(scene, File(tmp_path / "a.dae", collada.by_hand()))
    frame = scene.render("cam", planes=PLANES, time=0.7)
    check(frame, collada.banner.shape(ROOT, 0.0, 0.25))


@pytest.mark.parametrize("time", [0.0, 0.4, 1.0])
def test_what_blender_writes_moves(scene, collada, tmp_path, time):
    asset = build(scene, File(tmp_path / "a.dae", collada.as_blender()), animation="bow")
    assert asset.animations == ["bow"]
    assert asset.warnings == []
    assert {"Armature", "lower", "upper", "Banner.skin"} <= {
        entity.name.rpartition("/")[2] for entity in asset.entities
    }
    frame = scene.render("cam", planes=PLANES, time=time)
    check(frame, collada.banner.shape(ROOT, TURN * time, 0.0))


def test_a_joint_is_turned_by_hand(scene, tmp_path):
    collada = Collada()
    asset = build(scene, File(tmp_path / "a.dae", collada.as_blender()))
    with scene.edit() as edit:
        edit.entity(f"{asset.root.name}/upper", transform=collada.joint(0.5))
    check(scene.render("cam", planes=PLANES), collada.banner.shape(ROOT, 0.5, 0.0))


def test_a_skin_at_rest_is_what_shows_without_its_weights(client, collada, tmp_path):
    """Both ways to read a file have the same axes, unit and material."""
    moving = collada.as_blender()
    still = re.sub(r"<vertex_weights.*?</vertex_weights>", "", moving, flags=re.DOTALL)
    still = re.sub(r"<library_animations>.*?</library_animation_clips>", "", still, flags=re.DOTALL)
    planes = ["depth", "base_color", "normal", "beauty"]
    frames, materials = [], []
    for name, text in (("moving", moving), ("still", still)):
        with client.create_scene() as scene:
            asset = build(scene, File(tmp_path / f"{name}.dae", text))
            with scene.edit() as edit:
                edit.dome(np.ones((2, 4, 3), "f4"))
            frames.append(scene.render("cam", planes=planes, spp=4))
            (paint,) = asset.materials.values()
            materials.append(scene.read([paint], ["material"])[0][0].material)
            assert ("do not move" in "".join(asset.warnings)) == (name == "still")
    for plane in planes:
        inside = np.isfinite(frames[0]["depth"]) & np.isfinite(frames[1]["depth"])
        np.testing.assert_allclose(
            np.asarray(frames[0][plane], float)[inside],
            np.asarray(frames[1][plane], float)[inside],
            atol=2e-3,
        )
    assert materials[0] == materials[1]
