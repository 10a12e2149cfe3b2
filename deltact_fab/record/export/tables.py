"""A run as a folder of tables, CSV or Parquet, and what every export takes of a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...aliases import Progress
from ..files import json_bytes
from ..run import Run
from ..streams import FORCE_COLUMNS, POSE_COLUMNS
from ..timeline import TimeLine

if TYPE_CHECKING:
    import pandas as pd


def described(run: Run) -> dict[str, Any]:
    """What every export says of the run it is of."""
    keys = ("name", "rig_name", "simulated", "air", "seed", "format", "versions")
    return {key: run.meta.get(key) for key in keys} | {
        "protocol": (run.meta.get("protocol") or {}).get("name"),
        "finished": run.finished,
    }


LINE = "time_ns"  # the column of every table that puts it on the time line


def _floats(*names: str) -> dict[str, str]:
    return dict.fromkeys(names, "float64")


_PRESS = {"press": "string", "step_id": "string"}
_STEP = {"indenter": "string", "kind": "string"}
_SAMPLE = {LINE: "int64", **_PRESS, **_floats("t_s", "t_press_s")}
_POSE, _FORCE = _floats(*POSE_COLUMNS), _floats(*FORCE_COLUMNS)
TABLES: dict[str, dict[str, str]] = {
    "frames": {
        LINE: "int64", "frame_id": "string", "seq": "int64", **_PRESS, **_STEP, "k": "int64",
        "settled": "bool", "file": "string", "sha256": "string",
        **_floats("t_s", "t_step_s", "t_press_s"), **_POSE, **_FORCE,
        **_floats("pose_skew_s", "force_skew_s", "late_s"), "late": "bool", "dropped": "int64",
        "repeated": "int64", "wall_s": "float64",
    },
    "force": {**_SAMPLE, **_FORCE, "saturated": "bool"},
    "pose": {**_SAMPLE, **_POSE},
    "steps": {
        LINE: "int64", "seq": "int64", **_PRESS, **_STEP, **_POSE,
        **_floats("feed_mm_min", "planned_s"), "missed": "int64",
        **_floats("t_start_s", "t_end_s", "wall_s"),
    },
    "events": {
        LINE: "int64", "seq": "int64", "kind": "string", **_PRESS, "text": "string",
        **_floats("t_s", "wall_s"),
    },
}  # fmt: skip
"""The type of each column, by its table and name; what they mean stands in `Run`'s docstrings.

time_ns of a step is of its start, x_mm to z_mm there its target; seq of an operator's note is 0."""
# Of pandas, with a place for what is not known; a float has its nan.
_KINDS = {"int64": "Int64", "bool": "boolean"}


def of_press(run: Run, line: TimeLine, name: str, press: str) -> pd.DataFrame:
    """The rows of one press of frames, force, pose or steps, with the columns of `TABLES`."""
    read = {"frames": run.frames, "force": run.force, "pose": run.pose, "steps": run.steps}[name]
    table = read(press)
    at = "t_start_s" if name == "steps" else "t_s"
    return shaped(
        TABLES[name], table.assign(**{LINE: line.of_press_ns(press, table[at].to_numpy(float))})
    )


def events(run: Run, line: TimeLine) -> pd.DataFrame:
    """All events and notes, in order of the time line."""
    import pandas as pd

    table = run.events()
    notes = run.notes().assign(kind="note", seq=0, press=None, step_id=None, t_s=np.nan)
    parts = [part for part in (table, notes[list(table.columns)]) if len(part)]
    table = pd.concat(parts, ignore_index=True) if parts else table
    clocks = zip(table["seq"], table["t_s"].astype(float), table["wall_s"], strict=True)
    times = [line.of_event_ns(int(seq), t_s, wall_s) for seq, t_s, wall_s in clocks]
    table = table.assign(**{LINE: np.array(times, np.int64)})
    return shaped(TABLES["events"], table.sort_values(LINE, kind="stable"))


def shaped(columns: dict[str, str], table: pd.DataFrame) -> pd.DataFrame:
    """Exactly these columns; what older formats did not know is empty."""
    kinds: dict[str, Any] = {name: _KINDS.get(kind, kind) for name, kind in columns.items()}
    return table.reindex(columns=list(kinds)).astype(kinds)


@contextmanager
def _csv(path: Path) -> Iterator[Callable[[pd.DataFrame], None]]:
    """What adds rows to a CSV file: what is not known is empty; numbers have all their digits."""
    with path.open("w", encoding="utf-8", newline="") as out:
        yield lambda table: table.to_csv(out, index=False, header=out.tell() == 0)


@contextmanager
def _parquet(
    path: Path, columns: dict[str, str], about: dict[str, Any]
) -> Iterator[Callable[[pd.DataFrame], None]]:
    """What adds rows to a Parquet file, a row group a press."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = {key: json.dumps(value) for key, value in about.items()}
    kinds = {**columns, LINE: pa.timestamp("ns", tz="UTC")}
    schema = pa.schema(list(kinds.items()), {"deltact-fab": json.dumps(about), **text})

    with pq.ParquetWriter(path, schema, compression="zstd") as writer:

        def add(table: pd.DataFrame) -> None:
            made = pa.Table.from_pandas(table, schema, preserve_index=False)
            writer.write_table(made.replace_schema_metadata(schema.metadata))

        yield add


def write(run: Run, folder: Path, form: str, progress: Progress) -> dict[str, int]:
    """Write all tables into a new folder; return how many rows each has. Raises RunFailed."""
    folder.mkdir()
    about, line = described(run), TimeLine.of(run)
    rows = dict.fromkeys(TABLES, 0)
    with ExitStack() as opened:
        writers = {}
        for name, columns in TABLES.items():
            path = folder / f"{name}.{form}"
            writer = _csv(path) if form == "csv" else _parquet(path, columns, about)
            writers[name] = opened.enter_context(writer)

        def add(name: str, table: pd.DataFrame) -> None:
            writers[name](table)
            rows[name] += len(table)

        for number, press in enumerate(line.presses, start=1):
            for name in ("frames", "force", "pose", "steps"):
                add(name, of_press(run, line, name, press))
            progress(number, len(line.presses), press)
        add("events", events(run, line))
    (folder / "run.json").write_bytes(json_bytes({**run.meta, "summary": run.summary()}))
    return rows
