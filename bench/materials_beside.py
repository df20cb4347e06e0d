"""A ball of many materials here, in Mitsuba 3 and in Cycles, at equal parameters and in one run.

usage: materials_beside.py MITSUBA_PYTHON BPY_PYTHON [options] [MATERIAL...]
Run with .venv/bin/python; the others have mitsuba, and bpy. Nine minutes of two idle cores for all.

A line per material and light: the mean luminance of the ball's disc in each renderer; then for each
peer by how much ours is more, the standard error of that, and the ring of the picture (0: middle,
5: rim) or zone about the highlight that differs most, as a part of the larger of the peer's figure
and its disc. Lights: a white dome; a lamp in front, or in the back; and single passages of the
surface, from outside and from inside, as shares of light. --store writes the peers' statistics
that tests/image/test_materials_beside_peers.py reads, --pictures a PNG per line; --keep keeps what
each renderer has measured, and measures only what is missing.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
from typing import Any

HERE = pathlib.Path(__file__).resolve().parent / "beside"
sys.path.insert(0, str(HERE))
import materials  # noqa: E402
import numpy as np  # noqa: E402
import setting  # noqa: E402
import side  # noqa: E402

Found = dict[str, Any]  # file of a renderer's script
RENDERERS = ("ours", "mitsuba", "cycles")


def render(python: str, renderer: str, options: argparse.Namespace, folder: pathlib.Path) -> None:
    """Adds what is missing, by a process of the renderer's own Python."""
    out, log = folder / f"{renderer}.npz", folder / f"{renderer}.log"
    counts = [str(options.spp), str(options.chunks)]
    command = [python, str(HERE / f"{renderer}_side.py"), *counts, str(out), *options.material]
    with open(log, "wb") as file:
        status = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT).returncode
    if status:
        sys.exit(f"{renderer}: exit status {status}\n{log.read_text(errors='replace')[-2000:]}")


def measured(options: argparse.Namespace, folder: pathlib.Path) -> dict[str, Found]:
    """Results by renderer."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {}
    pythons = (sys.executable, options.mitsuba_python, options.bpy_python)
    for renderer, python in zip(RENDERERS, pythons, strict=True):
        render(python, renderer, options, folder)
        found[renderer] = side.load(str(folder / f"{renderer}.npz"))
    return found


def figures(found: Found, name: str, light: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Mean and standard error of the statistics that are meaningful under this light."""
    chunks = found.get(f"{name}|{light}|statistics")
    if chunks is None:
        return None
    mean, error = setting.mean_and_error(chunks)
    kept = [setting.STATISTICS.index(s) for s in setting.wanted(light)]
    return mean[kept], error[kept]


def beside(ours: Any, theirs: Any, light: str) -> str:
    """The columns of a peer."""
    if theirs is None:
        return f"{'':8s} {'':17s} {'':16s}"
    names = setting.wanted(light)
    disc = names.index("disc")
    mean, error = theirs
    difference = ours[0][disc] / mean[disc] - 1
    spread = np.hypot(ours[1][disc], error[disc]) / mean[disc]
    parts = (ours[0] - mean) / np.maximum(mean, mean[disc])
    worst = disc + 1 + int(np.argmax(abs(parts[disc + 1 :])))
    return (
        f"{mean[disc]:8.4f} {difference:+8.2%} ±{spread:6.2%}"
        f" {names[worst].replace(' ', ' '):>10s} {parts[worst]:+6.1%}"
    )


def table(found: dict[str, Found], names: list[str]) -> None:
    peer = f"{'':8s} {'ours more by':>17s} {'worst zone':>16s}"
    print(f"{'material, light':46s} {'ours':>8s}  Mitsuba{peer[7:]}  Cycles{peer[6:]}  models")
    for row, light in materials.pictures(names):
        mine, *peers = (figures(found[r], row.name, light) for r in RENDERERS)
        assert mine is not None
        columns = "  ".join(beside(mine, theirs, light) for theirs in peers)
        disc = mine[0][setting.wanted(light).index("disc")]
        why = row.why if light == row.lights[0] else ""
        print(f"{row.name + ', ' + light:46s} {disc:8.4f}  {columns}  {why}", flush=True)


def rounded(values: np.ndarray) -> list[float]:
    return [float(f"{v:.4g}") for v in values]


def stored(found: dict[str, Found], options: argparse.Namespace) -> Found:
    """The peers' statistics, and the conditions under which they hold."""
    values: Found = {}
    for row, light in materials.pictures(options.material):
        for peer in RENDERERS[1:]:
            got = figures(found[peer], row.name, light)
            if got is not None:
                values.setdefault(f"{row.name}, {light}", {})[peer] = {
                    "mean": rounded(got[0]),
                    "error": rounded(got[1]),
                }
    return {
        "made by": "bench/materials_beside.py",
        "versions": {peer: str(found[peer]["version"]) for peer in RENDERERS[1:]},
        "samples per pixel": options.spp * options.chunks,
        "pictures": options.chunks,
        "size": setting.SIZE,
        "max depth": setting.MAX_DEPTH,
        "statistics": list(setting.STATISTICS),
        "values": values,
    }


def store(path: pathlib.Path, content: Found) -> None:
    """Writes one line per material, light and peer."""
    text = json.dumps(content, indent=1, ensure_ascii=False)
    values = [
        f'  "{key}": {{\n'
        + ",\n".join(f'   "{peer}": {json.dumps(got)}' for peer, got in peers.items())
        + "\n  }"
        for key, peers in content["values"].items()
    ]
    head = text[: text.index('"values"')]
    path.write_text(head + '"values": {\n' + ",\n".join(values) + "\n }\n}\n")


def draw(found: dict[str, Found], names: list[str], folder: pathlib.Path) -> None:
    """Ours, Mitsuba's and Cycles', side by side, four times as large."""
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    for row, light in materials.pictures(names):
        black = np.zeros((setting.SIZE, setting.SIZE, 3), "f4")
        strip = [found[r].get(f"{row.name}|{light}|picture", black) for r in RENDERERS]
        pixels = np.clip(np.concatenate(strip, axis=1), 0, 1) ** (1 / 2.2) * 255
        large = pixels.astype("u1").repeat(4, axis=0).repeat(4, axis=1)
        cv2.imwrite(str(folder / f"{row.name}, {light}.png"), large[..., ::-1])


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("mitsuba_python")
    parser.add_argument("bpy_python")
    parser.add_argument("material", nargs="*", help="names; all where none is given")
    parser.add_argument("--spp", type=int, default=16, help="samples per pixel of a picture")
    parser.add_argument("--chunks", type=int, default=16, help="independent pictures")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for what each has rendered")
    parser.add_argument("--store", type=pathlib.Path)
    parser.add_argument("--pictures", type=pathlib.Path)
    return parser.parse_intermixed_args()


def main() -> None:
    options = parse()
    with tempfile.TemporaryDirectory() as folder:
        found = measured(options, options.keep or pathlib.Path(folder))
    print("; ".join(str(found[r]["version"]) for r in RENDERERS))
    table(found, options.material)
    if options.store:
        store(options.store, stored(found, options))
    if options.pictures:
        draw(found, options.material, options.pictures)


if __name__ == "__main__":
    main()
