"""Path-traced against flat-shaded training pictures of metal: a detector and a pose network learn
to find a metallic can from either kind of the same draws, and are tested on path-traced pictures
under lights and with materials that neither has seen.

usage: train_metal.py [IMAGES] [TESTS]     (needs PyTorch; default 6000 and 500)
"""

from __future__ import annotations

import sys
import time

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import torch
from heliograph.torch import Frames, loader
from torch import nn
from torch.nn import functional as F

SIZE, CELLS, CROP = 64, 8, 32
BATCH, LAMPS, OTHERS = 16, 24, 5
TEST_DOMES = [path for path in hd.bundled_domes() if path.stem in ("forest", "interior")]
KINDS = "path-traced", "flat-shaded"


# ------------------------------------------------------------ the scene


def build(scene: hg.Scene) -> None:
    """A can, things beside it, and domes: "lamps/i" to learn under, "test/i" for the tests."""
    rng = np.random.default_rng(0)
    with scene.edit() as edit:
        edit.material("tin", base_color=edit.texture("label", label()), metallic=1)
        mesh = edit.mesh("can/mesh", **hg.shapes.cylinder(0.25, 0.7))
        edit.entity("can", mesh=mesh, material="tin", label=1, category="can")
        shapes = hg.shapes.sphere(0.25), hg.shapes.cube(0.4), hg.shapes.torus(0.25, 0.09)
        for i in range(OTHERS):
            mesh = edit.mesh(f"other/{i}/mesh", **shapes[i % len(shapes)])
            edit.material(f"other/{i}", metallic=1)
            edit.entity(f"other/{i}/it", mesh=mesh, material=f"other/{i}", label=0)
        for i in range(LAMPS):
            edit.texture(f"lamps/{i}", lamps(rng))
        for i, path in enumerate(TEST_DOMES):
            edit.texture(f"test/{i}", path)
        lens = hg.Camera.from_fov(40, SIZE, SIZE, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))


def label() -> np.ndarray:
    """Print of the can, (64, 64, 3) uint8; its top is not its bottom."""
    picture = np.full((64, 64, 3), (200, 200, 205), np.uint8)
    picture[:20] = (190, 60, 50)
    picture[44:, ::16] = picture[44:, 1::16] = (40, 60, 120)
    return picture


def lamps(rng: np.random.Generator) -> np.ndarray:
    """(64, 128, 3) float16: a dome of noise of all sizes, and a few soft boxes."""
    tint = rng.uniform(0.3, 1, 3)
    picture = np.zeros((64, 128, 3))
    for size in (2, 4, 8, 16, 32):
        noise = rng.normal(size=(size, 2 * size, 3)) * 0.5 + rng.normal(size=(size, 2 * size, 1))
        picture += 0.5 * np.repeat(np.repeat(noise, 64 // size, 0), 64 // size, 1)
    picture = 0.3 * tint * np.exp(picture)
    for _ in range(rng.integers(1, 6)):
        y, x = rng.integers(0, 48), rng.integers(0, 108)
        height, width = rng.integers(3, 14), rng.integers(3, 20)
        picture[y : y + height, x : x + width] = rng.uniform(1, 12) * rng.uniform(0.7, 1, 3)
    return picture.astype(np.float16)


class Shuffle:
    """Draws poses, materials and light of an image; test images use others than training."""

    def __init__(self, scene: hg.Scene, is_test: bool) -> None:
        self.is_test = is_test
        self.things = [scene["can"], *(scene[f"other/{i}/it"] for i in range(OTHERS))]
        names = [f"test/{i}" for i in range(2)] if is_test else [f"lamps/{i}" for i in range(LAMPS)]
        self.domes = [scene[name] for name in names]

    def __call__(self, draw: hd.Draw) -> None:
        poses = [self._pose(draw.rng, is_can=i == 0) for i in range(len(self.things))]
        draw.place(self.things, poses)
        draw.edit.material("tin", roughness=self._roughness(draw.rng))
        for i in range(OTHERS):
            color = draw.rng.uniform(0.2, 0.9, 3)
            draw.edit.material(f"other/{i}", base_color=color, roughness=self._roughness(draw.rng))
        dome = self.domes[draw.rng.integers(len(self.domes))]
        draw.edit.dome(dome, rotation=draw.rng.uniform(0, 2 * np.pi))

    def _pose(self, rng: np.random.Generator, is_can: bool) -> hg.Pose:
        reach = 0.6 if is_can else 0.9
        x, y, z = rng.uniform(-reach, reach, 3)
        wxyz = rng.normal(size=4)
        return hg.Pose((x, y / 2 if is_can else abs(y), z), wxyz=wxyz / np.linalg.norm(wxyz))

    def _roughness(self, rng: np.random.Generator) -> float:
        if self.is_test:
            return float(rng.choice([rng.uniform(0.02, 0.08), rng.uniform(0.35, 0.45)]))
        return float(rng.uniform(0.08, 0.35))


def item(image: hd.Image) -> dict[str, torch.Tensor]:
    """Sample of a draw: both pictures, "box" (x0, y0, x1, y1) in pixels, and "axis": the can's,
    from its bottom to its top, seen by a camera that looks at it."""
    frame = image.frame
    normal, beauty = frame["normal"], frame["beauty"][..., :3]
    to_light = np.array([-0.5, -0.6, 0.62])
    lambert = 0.3 + 0.7 * np.clip(normal @ to_light, 0, 1)[..., None]
    is_hit = np.abs(normal).sum(-1, keepdims=True) > 0
    flat = np.where(is_hit, frame["base_color"] * lambert * 2 * level(beauty), beauty)
    pose = frame.labels["camera_from_object_cv"][0]
    return {
        KINDS[0]: exposed(beauty),
        KINDS[1]: exposed(flat),
        "box": torch.from_numpy(frame.labels["bbox_amodal"][0].astype(np.float32)),
        "axis": torch.from_numpy((facing(pose[:3, 3]) @ pose[:3, 2]).astype(np.float32)),
    }


def level(picture: np.ndarray) -> float:
    """The geometric mean: neither a lamp in view nor a dark corner sets it."""
    return float(np.exp(np.log(picture + 1e-3).mean()))


def exposed(picture: np.ndarray) -> torch.Tensor:
    """(3, H, W) in [0, 1), of the same brightness whatever the light."""
    scaled = picture / (2 * level(picture))
    return torch.from_numpy((scaled / (1 + scaled)).astype(np.float32)).permute(2, 0, 1)


def facing(point: np.ndarray) -> np.ndarray:
    """(3, 3): from the camera to one at the same place that looks at the point."""
    forward = point / np.linalg.norm(point)
    right = np.cross([0, 1, 0], forward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


# ------------------------------------------------------------ the networks


def layers(channels: int, *outputs: int) -> nn.Sequential:
    """Convolutions, each of which halves the picture."""
    made: list[nn.Module] = []
    for count in outputs:
        made += [nn.Conv2d(channels, count, 3, 2, 1), nn.BatchNorm2d(count), nn.ReLU()]
        channels = count
    return nn.Sequential(*made)


class Detector(nn.Module):
    """Network that gives, for each of CELLS x CELLS cells, a score and a box's distances to the
    cell's centre."""

    def __init__(self) -> None:
        super().__init__()
        around = nn.Conv2d(64, 64, 3, 1, 2, dilation=2)
        self.body = nn.Sequential(layers(3, 24, 48, 64), around, nn.ReLU(), nn.Conv2d(64, 5, 1))
        middles = (torch.arange(CELLS) + 0.5) * SIZE / CELLS
        self.register_buffer("x", middles[None, :].expand(CELLS, CELLS))
        self.register_buffer("y", middles[:, None].expand(CELLS, CELLS))

    def forward(self, pictures: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Scores (B, cells) and boxes (B, cells, 4) of pictures (B, 3, SIZE, SIZE)."""
        out = self.body(pictures)
        far = F.softplus(out[:, 1:]) * 10
        edges = self.x - far[:, 0], self.y - far[:, 1], self.x + far[:, 2], self.y + far[:, 3]
        return out[:, 0].flatten(1), torch.stack(edges, -1).flatten(1, 2)

    def loss(self, batch: dict[str, torch.Tensor], kind: str) -> torch.Tensor:
        scores, boxes = self(batch[kind])
        box = batch["box"]
        middle = (box[:, :2] + box[:, 2:]) / 2 * CELLS / SIZE
        column, row = middle.long().clamp(0, CELLS - 1).T
        cell = row * CELLS + column
        return F.cross_entropy(scores, cell) + (1 - iou(boxes[range(len(box)), cell], box)).mean()

    def found(self, pictures: torch.Tensor) -> torch.Tensor:
        """(B, 4): the boxes of the best scores."""
        scores, boxes = self(pictures)
        return boxes[range(len(boxes)), scores.argmax(1)]


def iou(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """(B,) intersection over union of boxes."""
    low, high = torch.maximum(a[:, :2], b[:, :2]), torch.minimum(a[:, 2:], b[:, 2:])
    both = (high - low).clamp(min=0).prod(1)
    return both / ((a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - both)


class PoseNet(nn.Module):
    """The can's axis, from a crop around its box."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            layers(3, 32, 64, 64),
            nn.Flatten(),
            nn.Linear(64 * 16, 128),
            nn.ReLU(),
            nn.Linear(128, 3),
        )

    def forward(self, pictures: torch.Tensor, boxes: torch.Tensor) -> torch.Tensor:
        """Unit vectors (B, 3)."""
        middle = (boxes[:, :2] + boxes[:, 2:]) / SIZE - 1
        half = (boxes[:, 2:] - boxes[:, :2]).amax(1) * 0.65 * 2 / SIZE
        affine = torch.zeros(len(boxes), 2, 3)
        affine[:, 0, 0] = affine[:, 1, 1] = half
        affine[:, :, 2] = middle
        grid = F.affine_grid(affine, (len(boxes), 3, CROP, CROP), align_corners=False)
        return F.normalize(self.body(F.grid_sample(pictures, grid, align_corners=False)))

    def loss(self, batch: dict[str, torch.Tensor], kind: str) -> torch.Tensor:
        return (1 - (self(batch[kind], batch["box"]) * batch["axis"]).sum(1)).mean()


# ------------------------------------------------------------ the experiment


def stream(scene: hg.Scene, count: int, seed: int, is_test: bool):
    planes = ["beauty", "normal", "base_color"]
    frames = Frames(
        scene,
        "cam",
        Shuffle(scene, is_test),
        count=count,
        seed=seed,
        item=item,
        planes=planes,
        labels=["boxes", "amodal"],
        spp=16,
        max_depth=4,
    )
    return loader(frames, BATCH, collate_fn=torch.utils.data.default_collate)


def train(scene: hg.Scene, images: int) -> dict[str, list[nn.Module]]:
    """kind -> [detector, pose network]; all of them see each draw once."""
    networks = {}
    for kind in KINDS:
        torch.manual_seed(0)
        networks[kind] = [Detector(), PoseNet()]
    steps = -(-images // BATCH)
    teachers = []
    for kind, pair in networks.items():
        for network in pair:
            optimizer = torch.optim.Adam(network.parameters(), 3e-3)
            pace = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=steps)
            teachers.append((kind, network, optimizer, pace))
    start = time.perf_counter()
    for step, batch in enumerate(stream(scene, images, 1, is_test=False), 1):
        losses = []
        for kind, network, optimizer, pace in teachers:
            loss = network.loss(batch, kind)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            pace.step()
            losses.append(loss.item())
        if step % 50 == 0 or step == steps:
            rate = min(step * BATCH, images) / (time.perf_counter() - start)
            print(f"step {step}: losses {np.round(losses, 3)}, {rate:.0f} images/s", flush=True)
    return networks


@torch.no_grad()
def evaluate(scene: hg.Scene, networks: dict[str, list[nn.Module]], tests: int) -> dict:
    """kind -> (share of cans found with IoU >= 0.5, mean IoU, median error of the axis in degrees),
    all on path-traced pictures."""
    overlaps = {kind: [] for kind in KINDS}
    angles = {kind: [] for kind in KINDS}
    for batch in stream(scene, tests, 2, is_test=True):
        for kind, (detector, pose) in networks.items():
            pictures = batch[KINDS[0]]
            overlaps[kind].append(iou(detector.eval().found(pictures), batch["box"]))
            cosine = (pose.eval()(pictures, batch["box"]) * batch["axis"]).sum(1)
            angles[kind].append(torch.rad2deg(torch.acos(cosine.clamp(-1, 1))))
    out = {}
    for kind in KINDS:
        overlap = torch.cat(overlaps[kind])
        shares = (overlap >= 0.5).float().mean().item(), overlap.mean().item()
        out[kind] = (*shares, torch.cat(angles[kind]).median().item())
    return out


def main(images: int, tests: int) -> dict:
    start = time.perf_counter()
    with hg.connect() as client, client.create_scene() as scene:
        build(scene)
        results = evaluate(scene, train(scene, images), tests)
    print(f"\n{images} images to learn from, {tests} tests, {time.perf_counter() - start:.0f} s")
    print(f"{'learnt from':12} {'found':>8} {'mean IoU':>9} {'axis error':>11}")
    for kind, (found, overlap, angle) in results.items():
        print(f"{kind:12} {found:8.1%} {overlap:9.3f} {angle:9.1f} deg")
    return results


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3])) if len(sys.argv) > 2 else main(6000, 500)
