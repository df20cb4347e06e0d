"""hg.moving and a camera's shutter, without a daemon."""

import heliograph as hg
import numpy as np
import pytest


def test_moving_translates_and_turns_about_the_pose():
    start = hg.Pose((1, 2, 3), scale=2.0)
    keys = hg.moving(start, (0, 2), velocity=(1, 0, -1), angular_velocity=(0, 0, 1.2), time=1)
    assert min(keys) == 0 and max(keys) == 2
    for t, pose in keys.items():
        c, s = np.cos(1.2 * (t - 1)), np.sin(1.2 * (t - 1))
        np.testing.assert_allclose(pose[:3, 3], (t, 2, 4 - t), atol=1e-12)
        np.testing.assert_allclose(
            pose[:3, :3], 2 * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), atol=1e-12
        )


@pytest.mark.parametrize("turns", [0.1, 1, 350 / 360, 7.3])
def test_keys_of_a_rotation_are_at_most_60_degrees_apart(turns):
    keys = hg.moving(hg.Pose(), (0, 0.5, 1), angular_velocity=(0, 2 * np.pi * turns, 0))
    times = sorted(keys)
    assert {0, 0.5, 1} <= set(times)
    for a, b in zip(times[:-1], times[1:], strict=True):
        cosine = (np.trace(keys[a][:3, :3].T @ keys[b][:3, :3]) - 1) / 2
        assert cosine >= 0.5 - 1e-9


def test_moving_needs_two_times_in_order():
    for times in [(0,), (1, 1), (1, 0)]:
        with pytest.raises(hg.InvalidArgument, match="times"):
            hg.moving(hg.Pose(), times)


def test_a_camera_message_has_its_shutter():
    lens = hg.Camera(8, 8, 9, 9, 4, 4, shutter=(-0.25, 0.5), rolling=0.125)
    assert hg.Camera.from_message(lens.to_message()) == lens
    assert not hg.Camera(8, 8, 9, 9, 4, 4).to_message().HasField("shutter")
