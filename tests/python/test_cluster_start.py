"""A Ray that does not start at once, without one."""

import pytest
from heliograph import cluster


class Ray:
    """Starts at the `at`-th attempt."""

    def __init__(self, at):
        self.at, self.starts, self.ends = at, 0, 0

    def init(self, num_cpus, include_dashboard, **_):
        assert (num_cpus, include_dashboard) == (3, False)
        self.starts += 1
        if self.starts < self.at:
            raise RuntimeError("Timed out waiting for file")

    def shutdown(self):
        self.ends += 1


@pytest.mark.parametrize("at", [1, 2, 3])
def test_a_start_that_fails_is_tried_again(at, caplog):
    ray = Ray(at)
    cluster._start(ray, 3)
    assert (ray.starts, ray.ends) == (at, at - 1)
    assert caplog.text.count("Timed out") == at - 1


def test_one_that_never_starts_says_why():
    ray = Ray(9)
    with pytest.raises(RuntimeError, match="Timed out"):
        cluster._start(ray, 3)
    assert ray.starts == ray.ends == 3
