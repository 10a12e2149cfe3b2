"""The places of the files in a run folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FORMAT = 5


def image_file(frame_id: str, suffix: str = "png") -> str:
    """Path of a frame's image inside the run folder; suffix: one of `images.FORMATS`."""
    return f"images/{frame_id.replace('/', '_').replace('#', '_')}.{suffix}"


def truth_file(folder: Path, press: str) -> Path:
    """Where a virtual rig keeps the truth of one press of the run in `folder`.

    An npz of displacement_mm (n, ny, nx, 3), one a solved knot, and for each frame of the press,
    in order of capture: frame_id, knots (m, 2) it lies between, fraction (m,) of the way.
    """
    return folder / "truth" / f"{press.replace('/', '_')}.npz"


def lattice_file(folder: Path) -> Path:
    """Where a virtual rig keeps the lattice that its truth stands on."""
    return folder / "truth" / "lattice.json"


def flat_file(folder: Path) -> Path:
    """Where a run keeps the flat field of its calibrated camera, if that has one."""
    return folder / "camera.flat.png"


def notes_file(folder: Path) -> Path:
    """Where operators' notes on a run stand, a JSON object a line."""
    return folder / "notes.jsonl"


def written(folder: Path) -> Iterator[Path]:
    """Images, truths of presses and cut-off writes of a run: what a resume may remove."""
    inside = ("images/*.png", "images/*.jxl", "images/.*.part", "truth/*.npz", "truth/.*.part")
    for pattern in (".*.part", *inside):
        yield from folder.glob(pattern)


def lens_file(folder: Path) -> Path:
    """Where a virtual rig keeps the lens that it draws through, which is not the calibrated one."""
    return folder / "truth" / "lens.json"


def json_bytes(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True) + "\n").encode()
