"""Renders the golden images anew and prints how they moved. usage: renew.py [NAME ...]

The table goes into the commit message, with why they changed."""

from __future__ import annotations

import sys

import golden
import heliograph as hg
import numpy as np
import scenes

SPP = 4096


def main() -> None:
    with hg.connect() as client:
        for name in sys.argv[1:] or scenes.SCENES:
            image, variance = scenes.render(client, name, SPP, seed=0)
            moved = "new"
            if golden.path(name).exists():
                verdict = golden.compare(image, variance, golden.load(name))
                moved = f"mean p {verdict.mean_p:.3g}, passing {verdict.passing:.4f}"
            print(f"{name:12s} mean {np.array2string(image.mean((0, 1)), precision=5)}  {moved}")
            golden.save(name, image, variance)


if __name__ == "__main__":
    main()
