"""JPEG data as cameras write them, whole and damaged on their way."""

from __future__ import annotations

import cv2
import numpy as np

from deltact_fab.common.aliases import Image

START, END = b"\xff\xd8", b"\xff\xd9"
SAMPLING_422, SAMPLING_420 = 0x211111, 0x221111
CODINGS = {
    "4:2:2": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING_422],
    "4:2:0": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING_420],
    "4:4:4": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111],
    "restarts": [cv2.IMWRITE_JPEG_RST_INTERVAL, 10],
    "own tables": [cv2.IMWRITE_JPEG_OPTIMIZE, 1],
    "no tables": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING_422],
    "grey": [],
}


def scene(seed: int, w: int = 640, h: int = 480) -> Image:
    """Coloured patches with noise, as of a skin."""
    rng = np.random.default_rng(seed)
    patches = rng.integers(40, 216, (h // 8, w // 8, 3)).astype(np.uint8)
    noise = rng.normal(0, 3, (h, w, 3))
    return np.clip(cv2.resize(patches, (w, h)) + noise, 0, 255).astype(np.uint8)


def coded(image: Image, coding: str = "4:2:2") -> bytes:
    picture = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if coding == "grey" else image
    data = bytes(cv2.imencode(".jpg", picture, CODINGS[coding])[1])
    return _without_tables(data) if coding == "no tables" else data


def _without_tables(data: bytes) -> bytes:
    kept, at = data[:2], 2
    while data[at + 1] != 0xDA:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        kept += b"" if data[at + 1] == 0xC4 else data[at:end]
        at = end
    return kept + data[at:]


def scan_start(data: bytes) -> int:
    at = data.index(b"\xff\xda")
    return at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")


def kept_buffers(data: bytes) -> dict[str, bytes]:
    """Buffers of which no pixel is wrong."""
    return {
        "whole": data,
        "no end mark": data.removesuffix(END),
        "bytes after it": data + b"\x12\x34",
        "zeros after it": data + bytes(4096),
        "filler before it": data[:-2] + bytes(9) + END,
        "filler bytes 0xff": data[:-2] + b"\xff\xff" + END,
        "no end mark, zeros": data.removesuffix(END) + bytes(4096),
    }


def lost_buffers(data: bytes, other: bytes) -> dict[str, bytes]:
    """Damaged ones; other: of another image."""
    start = scan_start(data)
    k = (start + len(data)) // 2
    rubbish = np.random.default_rng(1).bytes(512)
    return {
        "hole": data[:k] + data[k + 3000 :],
        "zeros": data[:k] + bytes(3000) + data[k + 3000 :],
        "rubbish": data[:k] + rubbish + data[k + 512 :],
        "another begins in it": data[:k] + other,
        "another follows": data + other,
        "other's end": data[:k] + other[k:],
        "half": data[:k],
        "half, end mark": data[:k] + END,
        "99 %": data[: len(data) * 99 // 100],
        "99 %, end mark": data[: len(data) * 99 // 100] + END,
        "30 bytes more": data[:-2] + b"\x5a" * 30 + END,
        "header alone": data[:start],
        "head cut": data[: start - 40],
        "empty": b"",
        "start alone": START,
    }
