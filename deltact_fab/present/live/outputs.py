"""Outputs of a live measurement: status and JSON lines, the page, a folder."""

from __future__ import annotations

import csv
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np

from deltact_fab.bench import SensorLedger, encode_png
from deltact_fab.common import Array, disk_errors, make_folder, whole_file, write_whole
from deltact_fab.version import PACKAGE_VERSION

from . import picture
from .formatting import RESULT_COLUMNS, as_dict, status_text, table_row
from .page import LivePage
from .session import MeasuredImage, MeasurementSession, session_notes
from .source import Source

# By hand: as often, and as long, as one can read.
TERMINAL_PERIOD_S = 0.1
PIPED_PERIOD_S = 2.0
TRACE_WINDOW_S = 30.0  # time span of a live source's traces on the page; other sources: all


class MeasurementOutput:
    """Output of results, one after another."""

    def show(self, measured: MeasuredImage) -> None:
        """Output one result. Raises BrokenPipeError when the reader is gone."""

    def end(self, reason: str, last: MeasuredImage | None) -> None:
        """Finish; last: the last result."""


@dataclass
class StatusLine(MeasurementOutput):
    """Status line, updated in place on a terminal; elsewhere a line every few seconds."""

    to: IO[str]
    simulated: str | None
    next_s: float = 0.0
    last_written: MeasuredImage | None = None

    def show(self, measured: MeasuredImage) -> None:
        if (now_s := time.monotonic()) >= self.next_s:
            self.next_s = now_s + (TERMINAL_PERIOD_S if self.to.isatty() else PIPED_PERIOD_S)
            self._write(measured)

    def end(self, reason: str, last: MeasuredImage | None) -> None:
        if last is not None:
            if last is not self.last_written:
                self._write(last)
            prefix = "\n" if self.to.isatty() else ""
            origin = f" ({self.simulated})" if self.simulated else ""
            self.to.write(f"{prefix}{reason} after {last.source.frame + 1} images{origin}\n")
            self.to.flush()

    def _write(self, measured: MeasuredImage) -> None:
        # Return to the line's start, and erase the rest of a longer one.
        text = status_text(measured)
        self.to.write(f"\r{text}\x1b[K" if self.to.isatty() else f"{text}\n")
        self.to.flush()
        self.last_written = measured


@dataclass
class JsonLines(MeasurementOutput):
    """One JSON object per result, flushed at once."""

    to: IO[str]
    simulated: str | None

    def show(self, measured: MeasuredImage) -> None:
        entry = as_dict(measured)
        if self.simulated is not None:
            entry["simulated"] = self.simulated
        self.to.write(json.dumps(entry, allow_nan=False) + "\n")
        self.to.flush()


@dataclass
class MeasurementSummary(MeasurementOutput):
    """One JSON document at the end: number of images, and the last result."""

    to: Callable[[object], None]
    simulated: str | None

    def end(self, reason: str, last: MeasuredImage | None) -> None:
        images = 0 if last is None else last.source.frame + 1
        entry = None if last is None else as_dict(last)
        self.to({"ended": reason, "images": images, "simulated": self.simulated, "last": entry})


@dataclass
class PageOutput(MeasurementOutput):
    """Live page, which stays open after the last result."""

    session: MeasurementSession
    page: LivePage

    def show(self, measured: MeasuredImage) -> None:
        session = self.session
        self.page.show(
            lambda: picture.page_data(measured, session.view),
            lambda: picture.draw_markers(measured, session.rectified(measured.source.image)),
            picture.trace_point(measured),
        )

    def end(self, reason: str, last: MeasuredImage | None) -> None:
        self.page.ended = reason


@dataclass
class HealthOutput(MeasurementOutput):
    """Report the state of health at each new reference, if a calibration provides it.

    It is added to the ledger of the sensor, once per run, or per source and day.
    """

    source: Source
    tell: Callable[[str, str], None]

    def show(self, measured: MeasuredImage) -> None:
        health, source = measured.result.health, self.source
        if measured.result.frame == 0 and health is not None:
            lines = SensorLedger.add_event(
                "health", [source.name], serial=source.model.serial,
                id=f"{source.name} {datetime.now(UTC):%Y-%m-%d}", text=health.line,
                simulated=source.model.simulated is not None,
            )  # fmt: skip
            text = "\n".join([f"state of health: {health.line}", *lines])
            self.tell(text, "; ".join(health.reasons))


def deliver_results(
    session: MeasurementSession,
    tell: Callable[[str], None],
    *,
    jsonl: bool = False,
    summary: Callable[[object], None] | None = None,
    folder: Path | None = None,
    pictures: bool = False,
    page_port: int | None = None,
) -> bool:
    """Measure all images of a session, send every result to the outputs, and close the source.

    The status line goes to stdout, or to stderr where stdout is for a program. tell: prints a
    one-time message. jsonl: one object per result to stdout. summary: receives a document at the
    end. folder: new, for rows and arrays; pictures: also for the images. page_port: of the live
    page, 0 for a free one, None for no page; it stays open until Ctrl-C. Returns False after
    Ctrl-C, else True. Raises InputError for a port in use, RunFailed for the disk and as `results`.
    """
    simulated, page = session.source.model.simulated, None
    outputs: list[MeasurementOutput] = []
    with ExitStack() as stack:
        stack.callback(session.source.close)
        if page_port is not None:
            facts = _page_facts(session.source, "force" in session.measurement.include)
            page = LivePage(facts, session.measurement.reset, page_port)
            stack.callback(page.close)
        if jsonl:
            outputs.append(JsonLines(sys.stdout, simulated))
        if summary is not None:
            outputs.append(MeasurementSummary(summary, simulated))
        if not jsonl or sys.stderr.isatty():
            people = sys.stdout if summary is None and not jsonl else sys.stderr
            outputs.append(StatusLine(people, simulated))
        if page is not None:
            outputs.append(PageOutput(session, page))
            tell(f"view: {page.url}")

        def tell_health(health: str, unfit: str = "") -> None:
            tell(health)
            if page is not None:
                page.health, page.unfit = health, unfit

        if lines := session_notes(session):
            tell_health("\n".join(lines))
        outputs.append(HealthOutput(session.source, tell_health))
        if folder is not None:
            saved = OutputFolder(folder, session, pictures)
            stack.callback(saved.close)
            outputs.append(saved)
        return _deliver(session, outputs, stay=page is not None)


def _deliver(session: MeasurementSession, outputs: list[MeasurementOutput], stay: bool) -> bool:
    """Send every result to every output; stay: wait for Ctrl-C after the last one."""
    measured, ended = None, False
    try:
        for measured in session.results():
            for output in outputs:
                output.show(measured)
        ended = True
        for output in outputs:
            output.end("ended", measured)
        while stay:
            time.sleep(1)
    except KeyboardInterrupt:
        if not ended:
            for output in outputs:
                output.end("stopped", measured)
    return ended


def _page_facts(source: Source, with_force: bool) -> dict[str, object]:
    """Constant facts of the page: source and traces."""
    unit, min_range = ("px", 2.0) if source.model.in_px else ("mm", 0.1)
    names, title = ["max displacement"], f"Displacement of the pattern in {unit}"
    if with_force:
        names, min_range = ["z", "x", "y"], 0.2
        title = "Force on the sensor in N (z < 0: press)"
    return {
        "source": source.name, "simulated": source.model.simulated, "trace_names": names,
        "trace_title": title, "trace_least": min_range,
        "window_s": TRACE_WINDOW_S if source.live else None,
    }  # fmt: skip


class OutputFolder(MeasurementOutput):
    """Folder of rows and atomically written files, readable whenever the process ends."""

    def __init__(self, folder: Path, session: MeasurementSession, pictures: bool) -> None:
        """pictures: also save each tracked image. Raises InputError, RunFailed."""
        self._folder, self._session, self._pictures = folder, session, pictures
        make_folder(folder, *("fields", "pictures")[: 1 + pictures])
        model, pattern = session.source.model, session.pattern
        about = {
            "source": session.source.name, "simulated": model.simulated, "version": PACKAGE_VERSION,
            "mm_per_px": None if model.in_px else session.view.mm_per_px,
            "pattern": "dense" if pattern is None else pattern.kind, "told": session_notes(session),
        }  # fmt: skip
        write_whole(folder / "measured.json", json.dumps(about, indent=1).encode())
        self._table = (folder / "measured.csv").open("w", encoding="utf-8", newline="")
        self._add([column.name for column in RESULT_COLUMNS])

    def show(self, measured: MeasuredImage) -> None:
        """Write a result. Raises RunFailed on disk errors."""
        name = f"{measured.source.frame:06d}"
        fields = f"fields/{name}.npz"
        picture_name = f"pictures/{name}.png" if self._pictures else ""
        with disk_errors(self._folder):
            with whole_file(self._folder / fields, sync=False) as part, part.open("wb") as out:
                np.savez(out, allow_pickle=False, **dict(_arrays(measured)))
            if picture_name:
                tracked = self._session.rectified(measured.source.image)
                with whole_file(self._folder / picture_name, sync=False) as part:
                    part.write_bytes(encode_png(picture.draw_markers(measured, tracked)))
            self._add(table_row(measured, fields, picture_name))

    def _add(self, cells: list[Any]) -> None:
        csv.writer(self._table, lineterminator="\n").writerow(cells)
        self._table.flush()

    def close(self) -> None:
        self._table.close()


def _arrays(m: MeasuredImage) -> Iterator[tuple[str, Array]]:
    """Yield the arrays of a result, named as in `formatting.ARRAY_COLUMNS`."""
    r = m.result
    parts: list[tuple[Any, str, str]] = [(r.markers, "", "position_px displacement_px")]
    if r.flow is None:
        parts.append((r.observation, "", "flow_px state"))
    parts.append((r.flow, "", "shift_mm known x_mm y_mm"))
    parts.append((r.shape and r.shape.depth, "depth_", "depth_mm x_mm y_mm"))
    parts.append((r.traction, "traction_", "traction_mpa x_mm y_mm"))
    for part, prefix, names in parts:
        for name in names.split() if part is not None else ():
            yield name if name.startswith(prefix) else prefix + name, getattr(part, name)
