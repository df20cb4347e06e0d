"""What the clean data sets of the validator's tests show: pictures and masks by arithmetic."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT = 48, 32


def disc(x: float, y: float, radius: float) -> np.ndarray:
    """(H, W) bool."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return (columns - x) ** 2 + (rows - y) ** 2 <= radius**2


def masks(image: int) -> list[np.ndarray]:
    """Two discs, the second one behind the first, as far as they are seen."""
    first, second = disc(12.3 + image, 10.2, 6.1), disc(18.4 + image, 14.6, 7.7)
    return [first, second & ~first]


def picture(path: Path, image: int, size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.full((size[1], size[0], 3), 40 + 20 * image, np.uint8)
    Image.fromarray(pixels).save(path)


def edit_json(path: Path, change) -> None:
    """Reads a JSON file, lets `change` have its content, writes what it returns or that."""
    content = json.loads(path.read_text())
    changed = change(content)
    path.write_text(json.dumps(content if changed is None else changed))


def edit_text(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text, (old, text[:400])
    path.write_text(text.replace(old, new, 1))


def edit_picture(path: Path, change) -> None:
    """Reads a picture, lets `change` have the array, writes it."""
    pixels = np.array(Image.open(path))
    changed = change(pixels)
    Image.fromarray(pixels if changed is None else changed).save(path)


def write_json(path: Path, content) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
