"""KITTI's flow and disparity maps. Used by kitti.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..._wire.arrays import NdArray
from .files import picture_size
from .png16 import read_png
from .report import Faults

FOLDERS = ("flow_occ", "flow_noc", "disp_occ_0", "disp_noc_0")
_TOP = 65535


def check_maps(base: Path, folder: str, stems: list[str], faults: Faults) -> None:
    """Some maps of a folder."""
    for stem in stems:
        path = base / folder / f"{stem}.png"
        pixels = read_png(path)
        if not _has_picture(base, folder, stem, pixels.shape[1::-1], faults):
            continue
        if folder.startswith("flow"):
            good = _check_flow(path, pixels, faults)
        else:
            good = _check_disparity(path, pixels, faults)
        if good and "noc" in folder:
            _check_noc(base / folder.replace("noc", "occ") / path.name, path, pixels, faults)


def _has_picture(base: Path, folder: str, stem: str, size: tuple[int, ...], faults: Faults) -> bool:
    """Are the pictures there, and of its size?"""
    second = stem.replace("_10", "_11")
    for name in (stem, second) if folder.startswith("flow") else (stem,):
        picture = base / f"image_2/{name}.png"
        if not picture.is_file():
            faults.add("map_files", picture, f"is not there, and {folder} has its map: write it")
            return False
        if picture_size(picture) != size:
            faults.add(
                "map_files",
                base / folder / f"{stem}.png",
                f"is {size[0]}x{size[1]}, its picture {picture_size(picture)}: of one size",
            )
            return False
    return True


def _check_flow(path: Path, pixels: NdArray, faults: Faults) -> bool:
    if pixels.dtype != np.uint16 or pixels.ndim != 3 or pixels.shape[2] != 3:
        faults.add("flow_valid", path, "is no PNG of 16 bits and three channels: u, v, valid")
        return False
    if pixels[..., 2].max() > 1:
        swapped = (
            " (the channels are reversed: OpenCV takes BGR)" if pixels[..., 0].max() <= 1 else ""
        )
        faults.add(
            "flow_valid",
            path,
            f"its third channel has {pixels[..., 2].max()}: needs 0 or 1{swapped}",
        )
        return False
    valid = pixels[pixels[..., 2] == 1][:, :2]
    if not len(valid):
        return True
    flow = (valid.astype(float) - 32768) / 64
    saturated = int(((valid == 0) | (valid == _TOP)).any(1).sum())
    typical = float(np.median(np.linalg.norm(flow, axis=1)))
    if saturated:
        faults.add(
            "flow_range",
            path,
            f"{saturated} valid pixels have 0 or 65535: values beyond 16 bits are invalid",
        )
    elif typical > max(pixels.shape[:2]):
        faults.add(
            "flow_range",
            path,
            f"the flow is {typical:.0f} px as a rule, more than the picture: encode 64 u + 32768",
        )
    return True


def _check_disparity(path: Path, pixels: NdArray, faults: Faults) -> bool:
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        faults.add("disparity", path, "is no PNG of 16 bits and one channel: 256 d, 0 invalid")
        return False
    valid = pixels[pixels > 0]
    saturated = int((valid == _TOP).sum())
    if saturated:
        faults.add(
            "disparity",
            path,
            f"{saturated} pixels have 65535: values beyond 255.99 px are invalid, 0",
        )
    elif len(valid) and np.median(valid) / 256 > pixels.shape[1]:
        faults.add(
            "disparity",
            path,
            f"disparity is {np.median(valid) / 256:.0f} px as a rule, more than the width: encode "
            "256 d",
        )
    return True


def _check_noc(path: Path, own: Path, noc: NdArray, faults: Faults) -> None:
    check = "flow_noc" if noc.ndim == 3 else "disparity_noc"
    if not path.is_file():
        faults.add("map_files", path, f"is not there, and {own.parent.name} has its map: write it")
        return
    occ = read_png(path)
    same = occ.shape == noc.shape and occ.dtype == noc.dtype
    if not same or (occ.ndim == 3 and occ[..., 2].max() > 1):
        return  # a fault of occ itself
    valid = noc[..., 2] == 1 if noc.ndim == 3 else noc > 0
    differs = int((occ[valid] != noc[valid]).reshape(int(valid.sum()), -1).any(1).sum())
    if differs:
        faults.add(
            check,
            own,
            f"{differs} valid pixels differ from {path.parent.name}: it is the same map "
            "without points that the second picture hides",
        )
