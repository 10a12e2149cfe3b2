"""Damage of JPEG data is found before a decoder makes wrong pixels of it."""

from __future__ import annotations

import random

import cv2
import numpy as np
import pytest
from jpegs import CODINGS, coded, kept_buffers, lost_buffers, scan_start, scene

from deltact_fab.bench.record.images import decode
from deltact_fab.bench.record.jpeg import find_damage


@pytest.mark.parametrize("size", [(640, 480), (333, 77)])
@pytest.mark.parametrize("coding", CODINGS)
def test_whole_buffers_keep_their_pixels(coding: str, size: tuple[int, int]) -> None:
    data = coded(scene(1, *size), coding)
    right = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    for name, buffer in kept_buffers(data).items():
        assert np.array_equal(decode(buffer, "a.jpg"), right), name


@pytest.mark.parametrize("coding", CODINGS)
def test_damaged_buffers_are_refused(coding: str) -> None:
    data, other = coded(scene(1), coding), coded(scene(2), coding)
    for name, buffer in lost_buffers(data, other).items():
        with pytest.raises(ValueError, match=r"damaged JPEG: .|not a readable image"):
            pytest.fail(f"{name}: {decode(buffer, 'a.jpg').shape}")


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_flat_images_without_end_mark(grey: int) -> None:
    """Their last codes are zeros, as padding is, and their levels the extremes."""
    data = coded(np.full((48, 64, 3), grey, np.uint8))
    assert [name for name, b in kept_buffers(data).items() if find_damage(b)] == []


def test_files_of_several_images_are_read() -> None:
    """A file of a camera may say that more follow, as previews."""
    data = coded(scene(1))
    note = b"\xff\xe2\x00\x06MPF\0"
    assert find_damage(data[:2] + note + data[2:] + data) is None
    assert find_damage(data + data) == "a second image begins in its data"


def test_lost_restart_interval_is_found() -> None:
    data = coded(scene(1), "restarts")
    first, second = data.index(b"\xff\xd2"), data.index(b"\xff\xd3")
    assert find_damage(data[:first] + data[second:]) == "restart markers missing or out of order"


def test_progressive_data_need_their_end() -> None:
    data = bytes(cv2.imencode(".jpg", scene(1), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1])
    assert decode(data, "a.jpg").shape == (480, 640, 3)
    assert find_damage(data[: len(data) // 2]) == "no end mark"


@pytest.mark.parametrize("coding", CODINGS)
def test_random_losses_are_found(coding: str) -> None:
    """As docs and messages say: gaps of 3 kB always, one changed byte in a third of the cases."""
    data, draw = coded(scene(1), coding), random.Random(1)
    start, found = scan_start(data), 0
    for _ in range(60):
        k = draw.randrange(start, len(data) - 3002)
        assert find_damage(data[:k] + data[k + 3000 :]) is not None
        assert find_damage(data[:k] + bytes(3000) + data[k + 3000 :]) is not None
        changed = bytes([data[k] ^ draw.randrange(1, 256)])
        found += find_damage(data[:k] + changed + data[k + 1 :]) is not None
    assert found >= 12


def test_garbled_headers_are_one_reason() -> None:
    data, draw = coded(scene(1, 64, 48), "restarts"), random.Random(2)
    start = scan_start(data)
    for _ in range(3000):
        garbled = bytearray(data)
        for _ in range(draw.choice([1, 2, 8])):
            garbled[draw.randrange(2, start)] = draw.choice([0, 1, 255, draw.randrange(256)])
        damage = find_damage(bytes(garbled[: draw.choice([len(data), draw.randrange(start)])]))
        assert damage is None or "\n" not in damage
