"""All three questions of the engines that were asked for, as one result with its files."""

from __future__ import annotations

import csv
import io
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..aliases import Progress
from ..errors import InputError, RunFailed
from . import scenes, stability, work_precision
from .engines import REGISTRY, check_names, load
from .process import WorkerDied, answers
from .scenes import LayerCost
from .stability import StabilityRow
from .work_precision import CurveRow


@dataclass(frozen=True)
class Numerics:
    """What `run` found. engines: name, title and about of each, in order; tables: plain rows."""

    engines: list[dict[str, str]]
    curves: list[CurveRow]
    stability: list[StabilityRow]
    tables: list[dict[str, Any]]
    scenes: list[LayerCost]
    meta: dict[str, Any] = field(default_factory=dict)

    @property
    def wrong(self) -> list[StabilityRow]:
        """The rows that fail the command."""
        return [row for row in self.stability if row.outcome == "wrong"]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `numerics --json` prints it."""
        return {
            "meta": self.meta,
            "engines": self.engines,
            "curves": [row.as_dict() for row in self.curves],
            "stability": [row.as_dict() for row in self.stability],
            "tables": self.tables,
            "scenes": [row.as_dict() for row in self.scenes],
            "wrong": len(self.wrong),
        }

    def save(self, out: Path) -> list[Path]:
        """Write numerics.json, the tables as CSV and numerics.html; returns the files.

        Raises InputError when the folder cannot be made, RunFailed when the disk refuses and
        MissingLibrary, after all but the page, without the extra `report`.
        """
        from ..files import write_whole
        from ..report import numerics_page

        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as why:
            raise InputError(f"{out}: cannot be made: {why.strerror}") from why
        data = self.as_dict()
        files = {"numerics.json": json.dumps(data, indent=1, allow_nan=False) + "\n"}
        for name in ("curves", "stability", "scenes"):
            if data[name]:
                files[f"{name}.csv"] = _csv(data[name])
        for table in self.tables:
            rows = [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]
            files[f"table-{_slug(table['title'])}.csv"] = _csv(rows)
        for name, text in files.items():
            write_whole(out / name, text.encode())
        written = [out / name for name in files]
        page = out / "numerics.html"
        numerics_page.write(data, page)
        return [*written, page]


def run(
    names: Sequence[str] = (), quick: bool = False, progress: Progress | None = None
) -> Numerics:
    """Curves, stability and tables of the named engines (all by default), and the scenes.

    quick: a few settings and cases a engine, and the scenes' cost only when it is known already.
    Raises InputError for an unknown engine, RunFailed when a setting cannot be timed.
    """
    started = time.monotonic()
    tell = progress or (lambda done, total, what: None)
    chosen = check_names(tuple(names))
    engines = {name: load(REGISTRY[name]) for name in chosen}
    settings = {name: list(e.curves(quick)) for name, e in engines.items()}
    cases = {name: list(e.cases(quick)) for name, e in engines.items()}
    total = sum(map(len, settings.values())) + sum(map(len, cases.values())) + len(engines)
    done = 0
    curves: list[CurveRow] = []
    judged: list[StabilityRow] = []
    tables: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="deltact-fab-") as folder:
        scratch = Path(folder)
        for name, engine in engines.items():
            module = REGISTRY[name]
            for row in work_precision.measure(engine, module, settings[name], scratch, quick):
                curves.append(row)
                done += 1
                tell(done, total, f"{name}: {row.setting}")
            for verdict in stability.run(engine, module, cases[name], scratch, quick):
                judged.append(verdict)
                done += 1
                tell(done, total, f"{name}: {verdict.case}")
            done += 1
            tell(done, total, name)
            if quick:
                continue
            job = {"kind": "tables", "module": module, "threads": 1, "quick": quick,
                   "scratch": folder}  # fmt: skip
            try:
                tables += [{"engine": name, **t} for t in answers(job)]
            except WorkerDied as why:
                raise RunFailed(f"numerics: {name}: tables: {why}") from why
        # The bench has no scene: its table is not to wait for what others leave out.
        costs = scenes.costs(measure=not quick and chosen != ("bench",), progress=tell)
    from ..experiment import versions

    return Numerics(
        engines=[{"name": e.name, "title": e.title, "about": e.about} for e in engines.values()],
        curves=work_precision.compared(curves),
        stability=judged,
        tables=tables,
        scenes=costs,
        meta={
            "quick": quick,
            "seconds": time.monotonic() - started,
            "machine": scenes.machine(),
            "versions": versions(),
        },
    )


def _csv(rows: list[dict[str, Any]]) -> str:
    out = io.StringIO()
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _slug(title: str) -> str:
    words = "".join(c if c.isalnum() else " " for c in title.lower()).split()
    return "-".join(words[:5])
