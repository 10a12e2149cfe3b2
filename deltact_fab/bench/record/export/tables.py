"""Export of a run as tables, CSV or Parquet; time line and metadata for every export."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from deltact_fab.common import Progress, to_ns

from ..files import json_bytes
from ..run import Run
from ..streams import FORCE_COLUMNS, POSE_COLUMNS


@dataclass(frozen=True)
class TimeLine:
    """One time line for all sessions of a run: nanoseconds since 1970, UTC.

    Recorded times are on the rig's clock, which restarts with each session. Within a session they
    are shifted by one offset: wall time minus rig time at the session's first event. A session that
    would begin before the previous one ended (simulated time runs faster than wall time, and the
    wall clock may be set back) is shifted to that end. So times never decrease, and on a real rig
    they are wall times, as exact as the wall clock at the start of the session.

    offsets_ns: per session; press_session, event_session: session index of a press, of an event's
    seq. presses: all with rows, indenter changes included, in the order they began.
    """

    presses: tuple[str, ...]
    offsets_ns: tuple[int, ...]
    press_session: dict[str, int]
    event_session: dict[int, int]
    imported_ns: int | None = None
    """Time of the first image of an imported run, which keeps the recording's own times."""

    @classmethod
    def from_run(cls, run: Run) -> TimeLine:
        """Build the time line of a run. Raises RunFailed for an unreadable journal."""
        with run.reader() as db:
            rows = db.execute(
                "SELECT press, min(a), max(b), max(wall_s), min(wall_s - b), min(wall_s) FROM ("
                "SELECT press, t_start_s a, t_end_s b, wall_s FROM steps UNION ALL "
                "SELECT press, t_s, t_s, wall_s FROM frames) GROUP BY press ORDER BY max(wall_s)"
            ).fetchall()
            query = "SELECT seq, kind, press, t_s, wall_s FROM events ORDER BY seq"
            events = db.execute(query).fetchall()
        begun: list[float] = []  # wall time of each session's first event
        # Per session: start and end on its clock, wall time minus that.
        spans: dict[int, list[tuple[float, float, float]]] = defaultdict(list)
        press_session: dict[str, int] = {}
        event_session: dict[int, int] = {}
        for seq, kind, press, t_s, wall_s in events:
            if kind == "session" or not begun:
                begun.append(wall_s)
            session = event_session[seq] = len(begun) - 1
            if press is not None:
                press_session[press] = session  # the last one: a press may be repeated
            if t_s is not None:
                spans[session].append((t_s, t_s, wall_s - t_s))
        for press, first_s, last_s, wall_s, over_s, _ in rows:
            if press not in press_session:  # an indenter change has no event
                earlier = [n for n, begun_s in enumerate(begun) if begun_s <= wall_s]
                press_session[press] = max(earlier, default=0)
            spans[press_session[press]].append((first_s, last_s, over_s))
        offsets = [0] * len(begun)  # 0: session ended before its clock ran
        end_ns = 0
        for session, span in sorted(spans.items()):
            first_s, last_s = min(first for first, _, _ in span), max(last for _, last, _ in span)
            offsets[session] = max(to_ns(span[0][2]), end_ns - to_ns(first_s))
            end_ns = offsets[session] + to_ns(last_s)
        imported_ns = None
        if run.imported and rows:
            first_s = min(row[1] for row in rows)
            # The recording's own times, moved where they would begin before 1970.
            early_s = np.nanmin([first_s, run.force()["t_s"].min(), run.pose()["t_s"].min()])
            moved_ns = to_ns(max(-float(early_s), 0.0))
            offsets, imported_ns = [moved_ns] * len(offsets), to_ns(first_s) + moved_ns
        presses = tuple(row[0] for row in sorted(rows, key=itemgetter(5)))
        return cls(presses, tuple(offsets), press_session, event_session, imported_ns)

    def press_time_ns(self, press: str, t_s: NDArray[np.float64] | float) -> NDArray[np.int64]:
        """Convert rig times (s) within a press to the time line."""
        t_ns = np.rint(np.asarray(t_s, float) * 1e9).astype(np.int64)
        return np.asarray(t_ns + self.offsets_ns[self.press_session[press]], np.int64)

    def event_time_ns(self, seq: int, t_s: float | None, wall_s: float) -> int:
        """Time of an event on the time line; wall time before the rig's clock ran."""
        if t_s is None or math.isnan(t_s):
            return to_ns(wall_s) if self.imported_ns is None else self.imported_ns
        return to_ns(t_s) + self.offsets_ns[self.event_session[seq]]


def describe_run(run: Run) -> dict[str, Any]:
    """Metadata of a run for every export."""
    keys = ("name", "rig_name", "simulated", "air", "seed", "format", "versions")
    return {key: run.meta.get(key) for key in keys} | {
        "protocol": (run.meta.get("protocol") or {}).get("name"),
        "finished": run.finished,
    }


TIME_COLUMN = "time_ns"  # the column of every table that puts it on the time line


def _floats(*names: str) -> dict[str, str]:
    return dict.fromkeys(names, "float64")


_PRESS_TYPES = {"press": "string", "step_id": "string"}
_STEP_TYPES = {"indenter": "string", "kind": "string"}
_SAMPLE_TYPES = {TIME_COLUMN: "int64", **_PRESS_TYPES, **_floats("t_s", "t_press_s")}
_POSE_TYPES, _FORCE_TYPES = _floats(*POSE_COLUMNS), _floats(*FORCE_COLUMNS)
TABLE_COLUMNS: dict[str, dict[str, str]] = {
    "frames": {
        TIME_COLUMN: "int64", "frame_id": "string", "seq": "int64", **_PRESS_TYPES, **_STEP_TYPES,
        "k": "int64", "settled": "bool", "file": "string", "sha256": "string",
        **_floats("t_s", "t_step_s", "t_press_s"), **_POSE_TYPES, **_FORCE_TYPES,
        **_floats("pose_skew_s", "force_skew_s", "late_s"), "late": "bool", "dropped": "int64",
        "repeated": "int64", "wall_s": "float64",
    },
    "force": {**_SAMPLE_TYPES, **_FORCE_TYPES, "saturated": "bool"},
    "pose": {**_SAMPLE_TYPES, **_POSE_TYPES},
    "monitors": {**_SAMPLE_TYPES, "monitor": "string", "unit": "string", "value": "float64"},
    "steps": {
        TIME_COLUMN: "int64", "seq": "int64", **_PRESS_TYPES, **_STEP_TYPES, **_POSE_TYPES,
        **_floats("feed_mm_min", "planned_s"), "missed": "int64",
        **_floats("t_start_s", "t_end_s", "wall_s"),
    },
    "events": {
        TIME_COLUMN: "int64", "seq": "int64", "kind": "string", **_PRESS_TYPES, "text": "string",
        **_floats("t_s", "wall_s"),
    },
}  # fmt: skip
"""Type of each column, by table and name; `Run`'s docstrings give the meanings.

Only a run with monitors has their table. In steps: time_ns is the
start, x_mm to z_mm the target. seq of an operator's note is 0."""
# Nullable pandas types; a float has nan.
_PANDAS_TYPES = {"int64": "Int64", "bool": "boolean"}


def press_rows(run: Run, line: TimeLine, name: str, press: str) -> pd.DataFrame:
    """Rows of one press of a table but events, with `TABLE_COLUMNS`."""
    table = getattr(run, name)(press)
    time_column = "t_start_s" if name == "steps" else "t_s"
    t_ns = line.press_time_ns(press, table[time_column].to_numpy(float))
    return select_columns(TABLE_COLUMNS[name], table.assign(**{TIME_COLUMN: t_ns}))


def events(run: Run, line: TimeLine) -> pd.DataFrame:
    """Events and notes in order of time."""
    table = run.events()
    notes = run.notes().assign(kind="note", seq=0, press=None, step_id=None, t_s=np.nan)
    parts = [part for part in (table, notes[list(table.columns)]) if len(part)]
    table = pd.concat(parts, ignore_index=True) if parts else table
    clocks = zip(table["seq"], table["t_s"].astype(float), table["wall_s"], strict=True)
    times = [line.event_time_ns(int(seq), t_s, wall_s) for seq, t_s, wall_s in clocks]
    table = table.assign(**{TIME_COLUMN: np.array(times, np.int64)})
    return select_columns(TABLE_COLUMNS["events"], table.sort_values(TIME_COLUMN, kind="stable"))


def select_columns(columns: dict[str, str], table: pd.DataFrame) -> pd.DataFrame:
    """Select exactly these columns; those missing in older formats are empty."""
    kinds: dict[str, Any] = {name: _PANDAS_TYPES.get(kind, kind) for name, kind in columns.items()}
    return table.reindex(columns=list(kinds)).astype(kinds)


@contextmanager
def _csv_writer(path: Path) -> Iterator[Callable[[pd.DataFrame], None]]:
    """Yield a function that appends rows to a CSV file: full precision, empty if missing."""
    with path.open("w", encoding="utf-8", newline="") as out:
        yield lambda table: table.to_csv(out, index=False, header=out.tell() == 0)


@contextmanager
def _parquet_writer(
    path: Path, columns: dict[str, str], about: dict[str, Any]
) -> Iterator[Callable[[pd.DataFrame], None]]:
    """Yield a function that appends rows to a Parquet file, one row group per press."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = {key: json.dumps(value) for key, value in about.items()}
    kinds = {**columns, TIME_COLUMN: pa.timestamp("ns", tz="UTC")}
    schema = pa.schema(list(kinds.items()), {"deltact-fab": json.dumps(about), **text})

    with pq.ParquetWriter(path, schema, compression="zstd") as writer:

        def add(table: pd.DataFrame) -> None:
            arrow = pa.Table.from_pandas(table, schema, preserve_index=False)
            writer.write_table(arrow.replace_schema_metadata(schema.metadata))

        yield add


def write(run: Run, folder: Path, form: str, progress: Progress) -> dict[str, int]:
    """Write all tables into a new folder; return the rows per table. Raises RunFailed."""
    folder.mkdir()
    about, line = describe_run(run), TimeLine.from_run(run)
    names = [n for n in TABLE_COLUMNS if n != "monitors" or run.monitor_streams()]
    rows = dict.fromkeys(names, 0)
    with ExitStack() as stack:
        writers = {}
        for name in names:
            columns = TABLE_COLUMNS[name]
            path = folder / f"{name}.{form}"
            writer = _csv_writer(path) if form == "csv" else _parquet_writer(path, columns, about)
            writers[name] = stack.enter_context(writer)

        def add(name: str, table: pd.DataFrame) -> None:
            writers[name](table)
            rows[name] += len(table)

        for number, press in enumerate(line.presses, start=1):
            for name in [n for n in names if n != "events"]:
                add(name, press_rows(run, line, name, press))
            progress(number, len(line.presses), press)
        add("events", events(run, line))
    (folder / "run.json").write_bytes(json_bytes({**run.meta, "summary": run.summary()}))
    return rows
