"""A training loop whose frames never leave the GPU: a network learns depth from colour.

usage: train_on_gpu.py [STEPS]   (needs PyTorch with CUDA, and a daemon with the backend cuda)
Each step renders an overlay of one scene and learns from its planes where the renderer wrote them.
Without PyTorch or a GPU it prints that and ends with 77.
"""

import sys
import time

import heliograph as hg
import numpy as np

COUNT, SIZE = 24, (256, 192)


def build(scene: hg.Scene) -> hg.Group:
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("ball/mesh", **hg.shapes.sphere(0.15))
        edit.material("ball/material", base_color=0.5)
        places = np.tile(np.eye(4), (COUNT, 1, 1))
        balls = edit.instances("ball", mesh=mesh, material="ball/material", transforms=places)
        edit.entity("cam", camera=hg.Camera.from_fov(45, *SIZE, degrees=True))
    return balls


def randomise(edit: hg.Edits, rng: np.random.Generator, balls: hg.Group) -> None:
    places = np.tile(np.eye(4), (COUNT, 1, 1))
    places[:, :2, 3] = rng.uniform(-0.9, 0.9, (COUNT, 2))
    places[:, 2, 3] = rng.uniform(0.15, 0.8, COUNT)
    edit.set_transforms(balls, places)
    edit.material("ball/material", base_color=rng.uniform(0.1, 0.9, 3))
    angle, height = rng.uniform(0, 6.3), rng.uniform(0.6, 1.6)
    eye = (2.2 * np.cos(angle), 2.2 * np.sin(angle), height)
    edit.update("cam", transform=hg.look_at(eye, (0, 0, 0.2)))


def network(torch):
    nn = torch.nn
    layers = []
    for inputs, outputs, step in ((3, 32, 1), (32, 32, 2), (32, 32, 4), (32, 32, 8)):
        layers += [nn.Conv2d(inputs, outputs, 3, padding=step, dilation=step), nn.ReLU()]
    return nn.Sequential(*layers, nn.Conv2d(32, 1, 1)).cuda()


def loss_of(torch, model, frame):
    """The mean error of 1 / depth, where there is a surface."""
    color = frame.torch("beauty")[..., :3].permute(2, 0, 1)[None]  # no copy yet
    depth = frame.torch("depth")
    seen = torch.isfinite(depth)
    guess = model(torch.log1p(color))[0, 0]
    return (guess - 1 / depth)[seen].abs().mean()


def train(torch, scene: hg.Scene, balls: hg.Group, steps: int) -> None:
    model = network(torch)
    optimizer = torch.optim.Adam(model.parameters(), 2e-3)
    start = time.perf_counter()
    for step in range(steps):
        with scene.overlay() as overlay:
            randomise(overlay, np.random.default_rng(step), balls)
        frame = scene.render(
            "cam", overlay=overlay, planes=["beauty", "depth"], spp=16, seed=step, device="cuda"
        )
        loss = loss_of(torch, model, frame)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 20 == 0 or step + 1 == steps:
            rate = (step + 1) / (time.perf_counter() - start)
            print(f"step {step}: error of 1 / depth {loss.item():.4f}, {rate:.1f} frames/s")


def main(steps: int) -> int:
    try:
        import torch
    except ImportError:
        print("SKIPPED: this needs PyTorch, which is not installed", file=sys.stderr)
        return 77
    if not torch.cuda.is_available():
        print("SKIPPED: this needs a GPU that PyTorch can use", file=sys.stderr)
        return 77
    with hg.connect(arguments=["--backend", "cuda"]) as client, client.create_scene() as scene:
        train(torch, scene, build(scene), steps)
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 200))
