"""Requests of render_worlds, and its refusals before them."""

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import render_pb2, types_pb2


def poses(worlds, entities):
    out = np.tile(np.eye(4), (worlds, entities, 1, 1))
    out[..., 0, 3] = np.arange(worlds * entities).reshape(worlds, entities)
    return out


def test_poses_travel_as_one_array_with_an_overlay_for_some(daemon, scene):
    with scene.overlay() as overlay:
        overlay.material("paint", roughness=0.5)
    worlds = hg.Worlds(3, [None, overlay]).set_transforms(["a", "b"], poses(3, 2))
    assert worlds[1] is overlay and len(worlds) == 3
    scene.render_worlds("cam", worlds, mask=[True, False, True], spp=1)
    sent = [r for r in daemon.requests if isinstance(r, render_pb2.RenderRequest)][-1].worlds
    assert sent.count == 3
    assert [ref.name for ref in sent.poses.entities] == ["a", "b"]
    assert sent.poses.matrices.dtype == types_pb2.D_TYPE_F32
    assert list(sent.poses.matrices.shape) == [3, 2, 4, 4]
    assert sent.poses.matrices.inline == poses(3, 2).astype("<f4").tobytes()
    assert [len(overlay.edits) for overlay in sent.overlays] == [0, 1]
    assert sent.mask.inline == b"\1\0\1"


def test_set_transforms_replaces_what_was_set(daemon, scene):
    worlds = hg.Worlds(2).set_transforms(["a", "b"], poses(2, 2))
    worlds.set_transforms("c", poses(2, 1), teleport=True)
    scene.render_worlds("cam", worlds, spp=1)
    sent = [r for r in daemon.requests if isinstance(r, render_pb2.RenderRequest)][-1].worlds
    assert [ref.name for ref in sent.poses.entities] == ["c"] and sent.poses.teleport
    assert not sent.overlays and not sent.HasField("mask")


def test_large_arrays_are_handed_over_for_each_call(daemon, scene):
    worlds = hg.Worlds(2000).set_transforms(
        ["a", "b", "c", "d", "e", "f", "g", "h", "i"], poses(2000, 9)
    )
    before = len(daemon.uploaded)
    for _ in range(2):
        scene.render_worlds("cam", worlds, spp=1)
    assert daemon.uploaded[before:] == [2000 * 9 * 64] * 2


def test_numbers_that_are_no_world_are_refused(scene):
    worlds = hg.Worlds(2)
    for world in (-1, 2):
        with pytest.raises(hg.InvalidArgument, match="not one of 2"):
            worlds[world] = scene.overlay()
    for count in (0, -3, 1.5):
        with pytest.raises(hg.InvalidArgument):
            hg.Worlds(count)
    with pytest.raises(hg.InvalidArgument) as raised:
        worlds.set_transforms("a", poses(3, 1))
    assert raised.value.field == "transforms"
    with pytest.raises(hg.InvalidArgument) as raised:
        scene.render_worlds("cam", worlds, mask=[1, 0, 1])
    assert raised.value.field == "mask"
