"""A run as a folder of tables, CSV or Parquet, with what is needed to read them."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...aliases import Progress
from ..files import json_bytes
from ..run import Run
from ..timeline import TimeLine
from .source import described, presses
from .tables import LINE, TABLES, TableColumn, chunks

if TYPE_CHECKING:
    import pandas as pd


class _Csv:
    """One table as CSV: what is not known is empty; numbers have all their digits."""

    def __init__(self, path: Path) -> None:
        self._out = path.open("w", encoding="utf-8", newline="")
        self._headed = False

    def write(self, table: pd.DataFrame) -> None:
        table.to_csv(self._out, index=False, header=not self._headed)
        self._headed = True

    def close(self) -> None:
        self._out.close()


class _Parquet:
    """One table as Parquet, a row group a press; units stand with the columns."""

    def __init__(self, path: Path, columns: list[TableColumn], about: dict[str, Any]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        fields = []
        for column in columns:
            notes = {"unit": column.unit, "description": column.text}
            kind = pa.timestamp("ns", tz="UTC") if column.name == LINE else column.kind
            kind = pa.bool_() if kind == "bool" else kind
            fields.append(pa.field(column.name, kind, metadata=notes))
        text = {key: json.dumps(value) for key, value in about.items()}
        self._schema = pa.schema(fields, metadata={"deltact-fab": json.dumps(about), **text})
        self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")

    def write(self, table: pd.DataFrame) -> None:
        import pyarrow as pa

        made = pa.Table.from_pandas(table, self._schema, preserve_index=False)
        self._writer.write_table(made.replace_schema_metadata(self._schema.metadata))

    def close(self) -> None:
        self._writer.close()


def write(run: Run, folder: Path, form: str, progress: Progress) -> dict[str, int]:
    """Write all tables into a new folder; return how many rows each has. Raises RunFailed."""
    folder.mkdir()
    about, line, names = described(run), TimeLine.of(run), presses(run)
    rows = dict.fromkeys(TABLES, 0)
    with ExitStack() as opened:
        writers: dict[str, _Csv | _Parquet] = {}
        for name, columns in TABLES.items():
            path = folder / f"{name}.{form}"
            writers[name] = _Csv(path) if form == "csv" else _Parquet(path, columns, about)
            opened.callback(writers[name].close)
        for press, name, table in chunks(run, line, names):
            writers[name].write(table)
            rows[name] += len(table)
            if name == "steps":
                progress(names.index(press) + 1, len(names), press)
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
