"""Pictures of every size, from one pixel on, are crops of a larger one: no size ends the daemon,
and a pixel does not depend on how many others there are.

Every size from 1x1 to 33x33, then 1xN and Nx1 up to 16,384, with every filter. HELIOGRAPHD may name
a daemon of a sanitizer's build; HELIOGRAPH_BACKEND=cuda tries a GPU.
"""

import os

import common
import heliograph as hg
import numpy as np

FILTERS = ("box", "tent", "gaussian", "blackman_harris")
PLANES = ["beauty", "depth", "normal", "instance"]
LARGEST = 33
EQUAL = {"beauty": np.array_equal, "instance": np.array_equal}


def close(a, b):
    """Rays through centres are traced in packets, and how they are packed depends on the size: the
    last digits of where they meet a surface do, too."""
    return np.allclose(a, b, rtol=1e-4, atol=1e-4, equal_nan=True)


def lens(width, height):
    """The same rays whatever the size: pixel (x, y) looks where that of any other size does."""
    k = np.array([[30.0, 0, 16.5], [0, 30.0, 16.5], [0, 0, 1]])
    return hg.Camera.from_intrinsics(k, width, height)


class Pictures:
    def __init__(self, scene):
        self.scene = scene

    def render(self, width, height, filter):
        with self.scene.edit() as edit:
            edit.entity("cam", camera=lens(width, height))
        return self.scene.render("cam", planes=PLANES, spp=2, filter=filter, labels=False)

    def differences(self, large, width, height, filter):
        """Planes of a picture that are no crop of the larger one."""
        small = self.render(width, height, filter)
        crop = {plane: large[plane][:height, :width] for plane in PLANES}
        return sum(not EQUAL.get(plane, close)(small[plane], crop[plane]) for plane in PLANES)


def main():
    flags = ("--backend", os.environ.get("HELIOGRAPH_BACKEND", "embree"))
    squares = range(1, LARGEST + 1) if not common.SHORT else (1, 2, 3, 5, 17, LARGEST)
    lengths = common.size([1, 2, 31, 64, 100, 255, 1000, 4097, 16384], [1, 100, 1031])
    with common.Report("pictures of every size") as report, common.daemon(*flags) as client:
        scene = common.stage(client)
        pictures = Pictures(scene)
        tried = different = 0
        for filter in FILTERS:
            large = pictures.render(LARGEST, LARGEST, filter)
            for height in squares:
                for width in squares:
                    tried += 1
                    different += pictures.differences(large, width, height, filter)
            row = pictures.render(max(lengths), 1, filter)
            column = pictures.render(1, max(lengths), filter)
            for length in lengths:
                tried += 2
                different += pictures.differences(row, length, 1, filter)
                different += pictures.differences(column, 1, length, filter)
        report.figure(f"planes that differ, of {tried} sizes", different, 0, slack=False)


if __name__ == "__main__":
    main()
