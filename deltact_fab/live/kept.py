"""A folder that keeps what is measured: a table, and a file of arrays for each image."""

from __future__ import annotations

import csv
import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np

from .. import __version__
from ..aliases import Array
from ..errors import InputError
from ..files import disk_errors, making, whole, write_whole
from ..record import encode_png
from . import picture
from .begin import told_once
from .outputs import Output
from .rows import MeasuredRow
from .session import MeasuredImage, Session

_PLAIN = {int: "int64", float: "double", bool: "bool", str: "string"}


def require_new(folder: Path) -> None:
    """Raise InputError where something is there already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: already there; name a new or empty --out folder")


class KeptFolder(Output):
    """Rows go to measured.csv as they come; `close` makes measured.parquet of it with pyarrow.

    All else is written whole, so that what is there can be read whenever the process ends.
    """

    def __init__(self, folder: Path, session: Session, pictures: bool) -> None:
        """pictures: keep each image too, as it is tracked. Raises InputError, RunFailed."""
        require_new(folder)
        self._folder, self._session, self._pictures = folder, session, pictures
        with making(folder):
            for part in ("fields", "pictures")[: 1 + pictures]:
                (folder / part).mkdir(parents=True, exist_ok=True)
        write_whole(folder / "measured.json", json.dumps(_about(session), indent=1).encode())
        self._table = (folder / "measured.csv").open("w", encoding="utf-8", newline="")
        self._rows = csv.writer(self._table, lineterminator="\n")
        self._add(list(MeasuredRow.model_fields))

    def show(self, measured: MeasuredImage) -> None:
        """As Output. Raises RunFailed when the disk refuses."""
        name = f"{measured.given.frame:06d}"
        fields, shown = f"fields/{name}.npz", f"pictures/{name}.png" if self._pictures else ""
        with disk_errors(self._folder):
            with whole(self._folder / fields, sync=False) as part, part.open("wb") as out:
                np.savez(out, allow_pickle=False, **dict(_arrays(measured)))
            if shown:
                tracked = self._session.rectified(measured.given.image)
                with whole(self._folder / shown, sync=False) as part:
                    part.write_bytes(encode_png(picture.image(measured, tracked)))
            row = MeasuredRow.of(measured, fields, shown).model_dump()
            self._add(["" if value is None else value for value in row.values()])

    def _add(self, cells: list[Any]) -> None:
        self._rows.writerow(cells)
        self._table.flush()

    def close(self) -> None:
        """There will be no more rows."""
        self._table.close()
        if importlib.util.find_spec("pyarrow") is None:
            return
        import pyarrow as pa
        import pyarrow.parquet as pq
        from pyarrow import csv as reader

        rows = self._folder / "measured.csv"
        fields = [
            pa.field(name, _PLAIN[(*get_args(about.annotation), about.annotation)[0]],
                     metadata={"description": about.description or ""})
            for name, about in MeasuredRow.model_fields.items()
        ]  # fmt: skip
        schema = pa.schema(fields)
        types = reader.ConvertOptions(column_types=schema)
        with disk_errors(self._folder), whole(rows.with_suffix(".parquet")) as part:
            pq.write_table(reader.read_csv(rows, convert_options=types).cast(schema), part)
        rows.unlink()


def _about(session: Session) -> dict[str, Any]:
    known, pattern = session.source.known, session.pattern
    return {
        "source": session.source.name,
        "simulated": known.simulated,
        "deltact-fab": __version__,
        "columns": "deltact-fab schema measured",
        "arrays": "deltact-fab schema fields",
        "mm_per_px": None if known.in_px else session.view.mm_per_px,
        "pattern": "dense" if pattern is None else pattern.kind,
        "told": told_once(session),
    }


def _arrays(m: MeasuredImage) -> Iterator[tuple[str, Array]]:
    """By the names of FieldArrays."""
    r = m.result
    if r.markers is not None:
        yield "position_px", r.markers.position_px
        yield "displacement_px", r.markers.displacement_px
    elif r.flow is not None:
        yield from (("shift_mm", r.flow.shift_mm), ("known", r.flow.known),
                    ("x_mm", r.flow.x_mm), ("y_mm", r.flow.y_mm))  # fmt: skip
    elif r.observation is not None:
        yield from (("flow_px", r.observation.flow_px), ("state", r.observation.state))
    depth = r.shape.depth if r.shape is not None else None
    for name, part in (("depth", depth), ("traction", r.traction)):
        if part is not None:
            unit = "mm" if name == "depth" else "mpa"
            yield f"{name}_{unit}", getattr(part, f"{name}_{unit}")
            yield f"{name}_x_mm", part.x_mm
            yield f"{name}_y_mm", part.y_mm
