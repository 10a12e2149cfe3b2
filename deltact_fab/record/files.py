"""Files of a run folder: their places, and writing them whole or not at all."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import InputError, RunFailed

FORMAT = 5


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all: temporary, fsync, rename, fsync.

    Raises RunFailed naming the file when the disk refuses.
    """
    write_file(path, data)
    with disk_errors(path):
        sync_folder(path.parent)


def write_file(path: Path, data: bytes) -> None:
    """As `write_whole`, but for the last: the folder is synced by whoever writes many into it."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        with disk_errors(path), temporary.open("wb") as out:
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        with disk_errors(path):
            temporary.replace(path)
    except BaseException:
        # Where nothing may be written, nothing can be removed either, and nothing is there.
        with suppress(OSError):
            temporary.unlink()
        raise


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """An OSError becomes a RunFailed that names the file."""
    try:
        yield
    except OSError as why:
        raise RunFailed(f"{path}: cannot be written: {why.strerror}") from why


def sync_folder(folder: Path) -> None:
    """Make a rename survive a power cut; file systems that cannot say so are let pass."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as why:
        if why.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


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


@contextmanager
def refusing(folder: Path) -> Iterator[None]:
    """An OSError while the folder is made: a full or broken disk failed, all else is bad input."""
    try:
        yield
    except OSError as why:
        kind = RunFailed if why.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO) else InputError
        raise kind(f"{folder}: cannot be made: {why.strerror}") from why


def json_bytes(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True) + "\n").encode()
