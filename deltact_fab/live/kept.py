"""A folder that keeps what is measured: a table, and a file of arrays for each image."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..aliases import Array
from ..errors import InputError
from ..files import disk_errors, making, whole, write_whole
from ..record import encode_png
from ..version import VERSION
from . import picture
from .formatting import COLUMNS, row_of
from .outputs import Output
from .session import MeasuredImage, Session, told_once


def require_new(folder: Path) -> None:
    """Raise InputError where something is there already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: already there; name a new or empty --out folder")


class KeptFolder(Output):
    """Rows go to measured.csv as they come; all else is written whole.

    So what is there can be read whenever the process ends.
    """

    def __init__(self, folder: Path, session: Session, pictures: bool) -> None:
        """pictures: keep each image too, as it is tracked. Raises InputError, RunFailed."""
        self._folder, self._session, self._pictures = folder, session, pictures
        with making(folder):
            for part in ("fields", "pictures")[: 1 + pictures]:
                (folder / part).mkdir(parents=True, exist_ok=True)
        known, pattern = session.source.known, session.pattern
        about = {
            "source": session.source.name, "simulated": known.simulated, "version": VERSION,
            "mm_per_px": None if known.in_px else session.view.mm_per_px,
            "pattern": "dense" if pattern is None else pattern.kind, "told": told_once(session),
        }  # fmt: skip
        write_whole(folder / "measured.json", json.dumps(about, indent=1).encode())
        self._table = (folder / "measured.csv").open("w", encoding="utf-8", newline="")
        self._add([column.name for column in COLUMNS])

    def show(self, measured: MeasuredImage) -> None:
        """Raises RunFailed when the disk refuses."""
        name = f"{measured.given.frame:06d}"
        fields, shown = f"fields/{name}.npz", f"pictures/{name}.png" if self._pictures else ""
        with disk_errors(self._folder):
            with whole(self._folder / fields, sync=False) as part, part.open("wb") as out:
                np.savez(out, allow_pickle=False, **dict(_arrays(measured)))
            if shown:
                tracked = self._session.rectified(measured.given.image)
                with whole(self._folder / shown, sync=False) as part:
                    part.write_bytes(encode_png(picture.image(measured, tracked)))
            self._add(row_of(measured, fields, shown))

    def _add(self, cells: list[Any]) -> None:
        csv.writer(self._table, lineterminator="\n").writerow(cells)
        self._table.flush()

    def close(self) -> None:
        """There will be no more rows."""
        self._table.close()


def _arrays(m: MeasuredImage) -> Iterator[tuple[str, Array]]:
    """By the names of `formatting.ARRAYS`."""
    r = m.result
    parts: list[tuple[Any, str, str]] = [(r.markers, "", "position_px displacement_px")]
    if r.flow is None:
        parts.append((r.observation, "", "flow_px state"))
    parts.append((r.flow, "", "shift_mm known x_mm y_mm"))
    parts.append((r.shape and r.shape.depth, "depth_", "depth_mm x_mm y_mm"))
    parts.append((r.traction, "traction_", "traction_mpa x_mm y_mm"))
    for part, before, names in parts:
        for name in names.split() if part is not None else ():
            yield name if name.startswith(before) else before + name, getattr(part, name)
