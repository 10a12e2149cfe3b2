"""Both questions of the engines that were asked for, as one result with its files."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..aliases import Progress
from ..errors import InputError
from . import tables
from .engines import REGISTRY, check_names, load

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Numerics:
    """What `run` found, as plain rows.

    engines: name, title and about of each, in order. curves: as `tables` has them;
    stability: as `tables.judge`.
    """

    meta: dict[str, Any]
    engines: Rows
    curves: Rows
    stability: Rows

    @property
    def wrong(self) -> Rows:
        """The rows that fail the command."""
        return [row for row in self.stability if row["outcome"] == "wrong"]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `numerics --json` prints it."""
        return {**asdict(self), "wrong": len(self.wrong)}

    def save(self, out: Path) -> list[Path]:
        """Write numerics.json, the tables as CSV and numerics.html; returns the files.

        Raises InputError when the folder cannot be made, RunFailed when the disk refuses and
        MissingLibrary, after all but the page, without the extra `report`.
        """
        import pandas as pd

        from ..files import write_whole
        from ..report import numerics_page

        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as why:
            raise InputError(f"{out}: cannot be made: {why.strerror}") from why
        data = self.as_dict()
        tables = {name: pd.DataFrame(data[name], dtype=object)
                  for name in ("curves", "stability") if data[name]}  # fmt: skip
        files = {"numerics.json": json.dumps(data, indent=1, allow_nan=False) + "\n"}
        files |= {f"{name}.csv": table.to_csv(index=False) for name, table in tables.items()}
        for name, text in files.items():
            write_whole(out / name, text.encode())
        page = out / "numerics.html"
        numerics_page.write(data, page)
        return [*(out / name for name in files), page]


def run(
    names: Sequence[str] = (), quick: bool = False, progress: Progress | None = None
) -> Numerics:
    """Curves and stability of the named engines, all by default.

    quick: a few settings and cases an engine. Raises InputError for an unknown engine, RunFailed
    when a setting cannot be timed.
    """
    from ..experiment import versions

    started = time.monotonic()
    tell = progress or (lambda done, total, what: None)
    engines = {name: load(REGISTRY[name]) for name in check_names(tuple(names))}
    plans = {name: (e.curves(quick), e.cases(quick)) for name, e in engines.items()}
    total = sum(len(settings) + len(cases) for settings, cases in plans.values())
    curves: Rows = []
    judged: Rows = []
    with tempfile.TemporaryDirectory(prefix="deltact-fab-") as folder:
        scratch = Path(folder)
        for name in engines:
            settings, cases = plans[name]
            place = name, REGISTRY[name]
            for row in tables.curve_rows(*place, settings, scratch, quick):
                curves.append(row)
                tell(len(curves) + len(judged), total, f"{name}: {row['setting']}")
            for row in tables.case_rows(*place, cases, scratch, quick):
                judged.append(row)
                tell(len(curves) + len(judged), total, f"{name}: {row['case']}")
    return Numerics(
        meta={
            "quick": quick,
            "seconds": time.monotonic() - started,
            "machine": tables.machine(),
            "versions": versions(),
        },
        engines=[{"name": n, "title": e.title, "about": e.about} for n, e in engines.items()],
        curves=tables.compared(curves),
        stability=judged,
    )
