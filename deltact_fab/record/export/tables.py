"""A run as a folder of tables, CSV or Parquet, and what every export takes of a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...aliases import Progress
from ..files import json_bytes
from ..run import Run
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


@dataclass(frozen=True)
class TableColumn:
    """One column. kind: string, int64, float64 or bool."""

    name: str
    kind: str
    unit: str
    text: str


def _numbers(names: str, unit: str, text: str) -> list[TableColumn]:
    return [TableColumn(name, "float64", unit, text) for name in names.split()]


_TIME = TableColumn(
    LINE, "int64", "ns", "since 1970-01-01 UTC, one line over all sessions of the run"
)
_PRESS = [
    TableColumn("press", "string", "", "indenter/position"),
    TableColumn("step_id", "string", "", "indenter/position/depth/leg"),
]
_CLOCKS = [
    *_numbers("t_s", "s", "on the rig's clock, which starts anew with each session"),
    *_numbers("t_press_s", "s", "since the press was tared"),
]
_WALL = _numbers("wall_s", "s", "since 1970-01-01 UTC, when the row was made")
_POSE = _numbers(
    "x_mm y_mm z_mm", "mm", "of the tip in the sensor frame; z = 0 is the resting face"
)
_FORCE = [
    *_numbers("fx_n fy_n fz_n", "N", "on the sensor; a press has fz_n < 0"),
    *_numbers("tx_nmm ty_nmm tz_nmm", "N mm", "about the centre of the resting face"),
]
_STEP = [
    TableColumn("indenter", "string", "", "which was mounted"),
    TableColumn("kind", "string", "", "change, travel, approach, press, shear or retract"),
]

TABLES: dict[str, list[TableColumn]] = {
    "frames": [
        _TIME,
        TableColumn("frame_id", "string", "", "step_id#k"),
        TableColumn("seq", "int64", "", "place in the plan"),
        *_PRESS,
        *_STEP,
        TableColumn("k", "int64", "", "number in its step, from 1"),
        TableColumn("settled", "bool", "", "taken at rest, as the protocol settles"),
        TableColumn("file", "string", "", "image, from the run's folder"),
        TableColumn("sha256", "string", "", "of that file"),
        *_numbers("t_s", "s", "on the rig's clock, which starts anew with each session"),
        *_numbers("t_step_s", "s", "since the step began"),
        *_numbers("t_press_s", "s", "since the press was tared"),
        *_POSE,
        *_FORCE,
        *_numbers("pose_skew_s force_skew_s", "s", "from the nearest sample"),
        *_numbers("late_s", "s", "exposed after it was wanted"),
        TableColumn("late", "bool", "", "by more than half of what lies between two frames"),
        TableColumn("dropped", "int64", "", "frames that the camera lost since the one before"),
        TableColumn("repeated", "int64", "", "frames that it gave again since the one before"),
        *_WALL,
    ],
    "force": [
        _TIME,
        *_PRESS,
        *_CLOCKS,
        *_FORCE,
        TableColumn("saturated", "bool", "", "a gauge was out of range"),
    ],
    "pose": [_TIME, *_PRESS, *_CLOCKS, *_POSE],
    "steps": [
        TableColumn("time_ns", "int64", "ns", f"of its start; {_TIME.text}"),
        TableColumn("seq", "int64", "", "place in the plan"),
        *_PRESS,
        *_STEP,
        *_numbers("x_mm y_mm z_mm", "mm", "target of the tip in the sensor frame"),
        *_numbers("feed_mm_min", "mm/min", "as it was asked for"),
        *_numbers("planned_s", "s", "of motion"),
        TableColumn("missed", "int64", "", "frames that did not come"),
        *_numbers("t_start_s t_end_s", "s", "on the rig's clock"),
        *_WALL,
    ],
    "events": [
        _TIME,
        TableColumn("seq", "int64", "", "order of writing; 0: an operator's note"),
        TableColumn("kind", "string", "", "session, homed, begun, complete, fault, stop, note ..."),
        *_PRESS,
        TableColumn("text", "string", "", "what happened"),
        *_numbers("t_s", "s", "on the rig's clock"),
        *_WALL,
    ],
}


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


def shaped(columns: list[TableColumn], table: pd.DataFrame) -> pd.DataFrame:
    """Exactly these columns; what older formats did not know is empty."""
    kinds: dict[str, Any] = {
        column.name: _KINDS.get(column.kind, column.kind) for column in columns
    }
    return table.reindex(columns=list(kinds)).astype(kinds)


@contextmanager
def _csv(path: Path) -> Iterator[Callable[[pd.DataFrame], None]]:
    """What adds rows to a CSV file: what is not known is empty; numbers have all their digits."""
    with path.open("w", encoding="utf-8", newline="") as out:
        yield lambda table: table.to_csv(out, index=False, header=out.tell() == 0)


@contextmanager
def parquet(
    path: Path, columns: list[TableColumn], about: dict[str, Any]
) -> Iterator[Callable[[pd.DataFrame], None]]:
    """What adds rows to a Parquet file, a row group a press; units stand with the columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = []
    for column in columns:
        notes = {"unit": column.unit, "description": column.text}
        kind = pa.timestamp("ns", tz="UTC") if column.name == LINE else column.kind
        kind = pa.bool_() if kind == "bool" else kind
        fields.append(pa.field(column.name, kind, metadata=notes))
    text = {key: json.dumps(value) for key, value in about.items()}
    schema = pa.schema(fields, metadata={"deltact-fab": json.dumps(about), **text})

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
            writer = _csv(path) if form == "csv" else parquet(path, columns, about)
            writers[name] = opened.enter_context(writer)

        def add(name: str, table: pd.DataFrame) -> None:
            writers[name](table)
            rows[name] += len(table)

        for number, press in enumerate(line.presses, start=1):
            for name in ("frames", "force", "pose", "steps"):
                add(name, of_press(run, line, name, press))
            progress(number, len(line.presses), press)
        add("events", events(run, line))
    (folder / "README.md").write_text(_readme(about, rows, form), encoding="utf-8")
    (folder / "run.json").write_bytes(json_bytes({**run.meta, "summary": run.summary()}))
    return rows


def _readme(about: dict[str, Any], rows: dict[str, int], form: str) -> str:
    lines = [f"# {about['name']}: a run exported as {form}", ""]
    lines += [f"- {key}: {json.dumps(value)}" for key, value in about.items()]
    lines += ["", "run.json has all that is known of protocol, rig, sensor and camera. Images stay"]
    lines += ["in the run's folder, under the paths of `file`. What is not known is empty.", ""]
    for name, columns in TABLES.items():
        lines += [f"## {name}.{form}: {rows[name]} rows", "", "| column | unit | meaning |"]
        lines += ["|---|---|---|"]
        lines += [f"| {c.name} | {c.unit} | {c.text} |" for c in columns] + [""]
    return "\n".join(lines)
