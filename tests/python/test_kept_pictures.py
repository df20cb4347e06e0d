"""Decoded pictures of randomizers: the last ones stay, so many bytes of them."""

import functools

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from heliograph.datasets.randomizers import pictures

ENDINGS = (".png",)
ONE = 16 * 16 * 3  # bytes


class Made:
    """Pictures that are computed, or decoded, and how often each was."""

    def __init__(self, cache_bytes, count=4):
        self.made = [0] * count
        listed = [functools.partial(self.make, i) for i in range(count)]
        self.pictures = pictures.Pictures(listed, ENDINGS, cache_bytes)

    def make(self, index):
        self.made[index] += 1
        return np.full((16, 16, 3), index, "u1")

    def show(self, *indices):
        for index in indices:
            texels, encoded = self.pictures.texels(None, index)
            assert encoded and np.all(texels == index)


def test_those_shown_last_stay():
    made = Made(2 * ONE)
    made.show(0, 1, 0, 1)
    assert made.made == [1, 1, 0, 0]
    made.show(0, 2, 0)  # 1 is the one that was shown least lately
    assert made.made == [1, 1, 1, 0]
    made.show(1, 2)
    assert made.made == [1, 2, 2, 0]


@pytest.mark.parametrize("room", [0, 1, ONE, 2 * ONE - 1])
def test_the_last_one_stays_whatever_it_has(room):
    made = Made(room)
    made.show(3, 3, 3, 2, 2)
    assert made.made == [0, 0, 1, 1]
    assert len(made.pictures._texels) == 1


def test_files_are_decoded_again(tmp_path, monkeypatch):
    decoded = []

    def decode(_, path):
        decoded.append(path.name)
        return np.zeros((16, 16, 3), "u1"), True

    monkeypatch.setattr(pictures, "decoded", decode)
    for name in "ab":
        (tmp_path / f"{name}.png").write_bytes(b"")
    listed = pictures.Pictures(tmp_path, ENDINGS, ONE)
    for index in (0, 0, 1, 0):
        listed.texels(None, index)
    assert decoded == ["a.png", "b.png", "a.png"]


def test_arrays_are_nobodys_copies():
    array = np.zeros((1024, 1024), "f4")
    listed = pictures.Pictures([array, array], ENDINGS, 0)
    assert listed.texels(None, 1)[0] is array and not listed._texels


def test_randomizers_say_how_much():
    assert hd.random_dome().images.cache_bytes == 1 << 30
    assert hd.random_dome(cache_bytes=5).images.cache_bytes == 5
    assert hd.random_textures("ball", cache_bytes=5)._images.cache_bytes == 5
    for make in (hd.random_dome, functools.partial(hd.random_textures, "ball")):
        with pytest.raises(hg.InvalidArgument, match="cache_bytes"):
            make(cache_bytes=-1)
