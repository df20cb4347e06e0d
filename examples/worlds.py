"""A simulation moves the balls of many worlds, copies of one scene, and renders all in one call per
step.

usage: worlds.py [OUT_DIR] [WORLDS] [STEPS]
"""

import colorsys
import sys
from pathlib import Path

import heliograph as hg
import numpy as np

BALLS, RADIUS, SIZE = 8, 0.12, 64
STEP = 1 / 30  # seconds


def build(scene: hg.Scene) -> tuple[hg.Group, hg.Entity]:
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("ball/mesh", **hg.shapes.sphere(RADIUS))
        edit.material("ball/material", base_color=0.5, roughness=0.3)
        balls = edit.instances(
            "ball",
            mesh=mesh,
            material="ball/material",
            category="ball",
            transforms=np.tile(np.eye(4), (BALLS, 1, 1)),
        )
        lens = hg.Camera.from_fov(50, SIZE, SIZE, degrees=True)
        cam = edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1.5), (0, 0, 0.5)))
    return balls, cam


class Bouncing:
    """(N, M) balls that fall and bounce, each by itself."""

    def __init__(self, worlds: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.position = rng.uniform((-0.9, -0.5, 0.4), (0.9, 0.5, 1.4), (worlds, BALLS, 3))
        self.velocity = rng.normal(0, 0.4, (worlds, BALLS, 3))

    def step(self) -> np.ndarray:
        """The poses after a time step, (N, M, 4, 4) float32."""
        self.velocity[..., 2] -= 9.81 * STEP
        self.position += self.velocity * STEP
        below = self.position[..., 2] < RADIUS
        self.position[below, 2] = 2 * RADIUS - self.position[below, 2]
        self.velocity[below, 2] *= -0.8
        poses = np.tile(np.eye(4, dtype=np.float32), (*self.position.shape[:2], 1, 1))
        poses[..., :3, 3] = self.position
        return poses


def main(out: Path, count: int, steps: int) -> None:
    out.mkdir(parents=True, exist_ok=True)
    with hg.connect() as client, client.create_scene("worlds") as scene:
        balls, cam = build(scene)
        worlds = hg.Worlds(count)
        for i in range(count):  # a colour for each world
            with scene.overlay() as overlay:
                color = colorsys.hsv_to_rgb(i / count, 0.7, 0.8)
                overlay.material("ball/material", base_color=color)
            worlds[i] = overlay
        simulation = Bouncing(count, seed=0)
        for step in range(steps):
            worlds.set_transforms(balls, simulation.step())
            batch = scene.render_worlds(
                cam, worlds, planes=["beauty", "depth", "instance"], spp=4, seed=step
            )
            seen = [len(np.unique(picture)) - 1 for picture in batch["instance"]]
            print(f"step {step}: {batch['beauty'].shape}, {np.mean(seen):.1f} balls are seen")
        batch.frame(world=0).save(out / "world0.png", exposure="auto")
        np.savez(out / "worlds.npz", depth=batch["depth"], instance=batch["instance"])


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else "out"),
        int(sys.argv[2]) if len(sys.argv) > 2 else 16,
        int(sys.argv[3]) if len(sys.argv) > 3 else 5,
    )
