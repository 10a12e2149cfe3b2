"""Ledger of a lab's sensors: one TOML file per serial number, `sensors/A1.toml`.

The folder is in the current one, like those of the catalogue; without it nothing is written. A lab
fills in the keys, and `rig accept` keeps its result in the same file. The last table, `[events]`,
belongs to the program: one line per kind and run, so that a command that is resumed or repeated
replaces its own line.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field

from deltact_fab.common import (
    DeltactFabError,
    InputError,
    Table,
    disk_errors,
    read_text,
    read_toml,
    toml_literal,
    validate,
    write_new_file,
    write_whole,
)  # fmt: skip

from .journal import lock_file
from .run import Run

LOCK_WAIT_S, _LOCK_POLL_S = 10.0, 0.02  # by hand: a writer takes milliseconds
_SERIAL_FORM = re.compile(r"\w[\w.+-]*")  # serial numbers that make a file name
_ACCEPTANCE_KEYS = frozenset({"schema", "kind", "sensor", "made", "rest", "accepted"})
_EVENTS_HEAD = re.compile(r"^[ \t]*\[events\]", re.MULTILINE)
_EventKey = Annotated[str, Field(pattern=r"^(run|accepted|lens|depth|force|health) .")]


class SensorEvent(Table):
    """One event; its key is the kind and the id of the run, or of the data."""

    date: str
    """Beginning of the last run that it comes from, else the time of the event; UTC."""
    simulated: bool = False
    """True if no hardware was involved; then not counted for a sensor with real events."""
    presses: Annotated[int, Field(ge=0, le=10_000_000)] | None = None
    """Complete presses of a run; its own record, if it is there, counts instead."""
    file: str | None = None
    """Folder of the run, or calibration file."""
    text: str | None = None
    """Finding of an acceptance or of a check of health."""


class SensorLedger(Table):
    """Record of one sensor: gel, print, design and events."""

    FOLDER: ClassVar = Path("sensors")
    COLUMNS: ClassVar = ("serial", "design", "gel_batch", "presses", "calibrated", "accepted",
                         "health", "last_run", "simulated", "fault")  # fmt: skip

    gel_batch: str = ""
    """Batch of the gel."""
    mixing_ratio: str = ""
    """Mixing ratio of the gel's components by mass, such as 1:1."""
    cure_h: Annotated[float, Field(ge=0, le=1000)] | None = None
    """Time of the cure in hours."""
    cure_deg_c: Annotated[float, Field(ge=0, le=300)] | None = None
    """Temperature of the cure in degrees Celsius."""
    printer: str = ""
    """Printer of the pattern."""
    paper: str = ""
    """Paper or film of the pattern."""
    printed: str = ""
    """Day of the print."""
    note: str = ""
    """Any remark."""
    design: str | None = None
    """Name or path of the design; written by the program at the first run, with its digest."""
    design_digest: str | None = None
    """Digest of the design's dimensions; a run with another one is reported."""
    events: dict[_EventKey, SensorEvent] = Field(default={})
    """Events by kind and run, written by the program; the last table of the file."""

    @classmethod
    def file(cls, serial: str, key: str = "--serial") -> Path:
        """Return the file of a sensor. key: that gives the serial number.

        Raises InputError for one that is not a file name.
        """
        if not _SERIAL_FORM.fullmatch(serial):
            text = "use letters, digits, '.', '+', '-' and '_' only"
            raise InputError(f"{key} {serial!r}: {text}")
        return cls.FOLDER / f"{serial}.toml"

    @classmethod
    def load(cls, serial: str) -> SensorLedger:
        """Read the ledger of a sensor, empty if there is none. Raises InputError."""
        return _read_ledger(cls.file(serial))[1] if _SERIAL_FORM.fullmatch(serial) else cls()

    @classmethod
    def create(cls, serial: str) -> Path:
        """Write the file of a new sensor, to be filled in. Raises InputError, RunFailed."""
        with disk_errors(path := cls.file(serial, "--new")):
            cls.FOLDER.mkdir(exist_ok=True)
        write_new_file(path, _new_text())
        return path

    @classmethod
    def add_event(
        cls, kind: str, sources: Iterable[str | Path] = (), *, serial: str | None = None,
        id: str = "", file: Path | None = None, text: str | None = None, simulated: bool = False,
    ) -> list[str]:  # fmt: skip
        """Add an event to a sensor's file, or replace the one of the same kind and run.

        sources: of the event; runs among them give serial, id, date and simulated. A run in air is
        no event. Returns lines to report, and never raises for them: another design than the
        ledger's, a file that is damaged or cannot be written.
        """
        if not cls.FOLDER.is_dir():
            return []
        try:
            runs = [Run(Path(p)) for p in sources if Path(p, "run.json").is_file()]
            specimen = runs[0].meta["protocol"].get("specimen", {}) if runs else {}
            serial = serial or specimen.get("serial")
            if serial is None or (kind == "run" and runs[0].meta.get("air")):
                return []
            values: dict[str, Any] = {"file": file, "text": text, "simulated": simulated}
            date = datetime.now(UTC)
            if runs:
                id, date = " ".join(sorted(run.id for run in runs)), max(run.begun for run in runs)
                values["simulated"] = any(run.simulated for run in runs)
            if kind == "run":
                values |= {"file": runs[0].folder, "presses": runs[0].count_presses()[0]}
            origin: dict[str, str] = {}
            if runs and not runs[0].imported:
                dimensions = json.dumps(runs[0].meta["sensor"], sort_keys=True).encode()
                digest = hashlib.sha256(dimensions).hexdigest()[:12]
                origin = {"design": specimen.get("design", ""), "design_digest": digest}
            with cls.locked():
                return _add(cls.file(serial, "serial"), f"{kind} {id}", date, values, origin)
        except (DeltactFabError, OSError) as error:
            return [f"ledger: {error}; nothing was added ({kind})"]

    @classmethod
    def require_not_accepted(cls, path: Path) -> None:
        """Raise InputError for a file, unless it is a ledger without an acceptance."""
        if path.parent != cls.FOLDER and path.exists():
            raise InputError(f"{path}: already exists; name another file with -o, or remove it")
        if path.exists() and (keys := _ACCEPTANCE_KEYS & {*read_toml(path)}):
            text = f"name another file with -o, or remove {', '.join(sorted(keys))} from it"
            raise InputError(f"{path}: has an acceptance; {text}")

    @classmethod
    def add_acceptance(cls, path: Path, text: str) -> None:
        """Write the text of an acceptance file, with the ledger that is in the file."""
        with cls.locked():
            head, ledger = _read_ledger(path)
            top, _, tables = text.partition("\n[")
            _write_ledger(path, f"{top}\n{head}\n[{tables}".rstrip(), ledger.events)

    @classmethod
    @contextmanager
    def locked(cls) -> Iterator[None]:
        """Lock the folder. Raises RunFailed if it cannot be written or stays locked."""
        with disk_errors(cls.FOLDER), (cls.FOLDER / ".lock").open("ab") as file:
            end_s = time.monotonic() + LOCK_WAIT_S
            while not lock_file(file, shared=False):
                if time.monotonic() > end_s:
                    raise TimeoutError(f"locked by another process for {LOCK_WAIT_S:g} s")
                time.sleep(_LOCK_POLL_S)
            yield

    @classmethod
    def list_sensors(cls) -> list[tuple[Any, ...]]:
        """Return the COLUMNS of each sensor; of a damaged file the serial and the fault."""
        rows = []
        for path in sorted(cls.FOLDER.glob("*.toml")):
            try:
                row = _row(_read_ledger(path)[1], "accepted" in read_toml(path))
            except InputError as error:
                row = {"fault": str(error)}
            rows.append(tuple(({"serial": path.stem} | row).get(name) for name in cls.COLUMNS))
        return rows


def _row(ledger: SensorLedger, accepted: bool) -> dict[str, Any]:
    """Return a row; simulated events count only if there are no real ones."""
    parts = [(*key.partition(" ")[::2], event) for key, event in ledger.events.items()]
    real = [part for part in parts if not part[2].simulated]
    latest = {kind: (id, e) for kind, id, e in sorted(real or parts, key=lambda part: part[2].date)}
    dates = {kind: event.date[:10] for kind, (_, event) in latest.items()}
    calibrated = [f"{kind} {dates[kind]}" for kind in ("lens", "depth", "force") if kind in dates]
    return {
        "design": ledger.design,
        "gel_batch": ledger.gel_batch or None,
        "presses": sum(_presses(id, e) for kind, id, e in real or parts if kind == "run"),
        "calibrated": ", ".join(calibrated) or None,
        "accepted": dates.get("accepted", "yes" if accepted else None),
        "health": latest["health"][1].text if "health" in latest else None,
        "last_run": latest["run"][0] if "run" in latest else None,
        "simulated": bool(parts) and not real,
    }


def _presses(id: str, event: SensorEvent) -> int:
    """Return the complete presses of a run, from its record if that is still in its place."""
    try:
        run = Run(Path(event.file or ""))
        return run.count_presses()[0] if run.id == id else event.presses or 0
    except DeltactFabError:
        return event.presses or 0


def _add(
    path: Path, key: str, when: datetime, values: dict[str, Any], origin: dict[str, str]
) -> list[str]:
    """Write an event, and the design of its run; return a line if the file has another.

    An event of the same key keeps its date.
    """
    head, ledger = _read_ledger(path)
    stored = {name: getattr(ledger, name) for name in origin}
    new = [f"{k} = {toml_literal(v)}\n" for k, v in origin.items() if stored[k] is None]
    date = ledger.events[key].date if key in ledger.events else f"{when:%Y-%m-%dT%H:%M:%SZ}"
    event = validate(SensorEvent, {"date": date, **values}, str(path))
    _write_ledger(path, "".join([*new, head]), {**ledger.events, key: event})
    if stored.get("design_digest") in (None, origin.get("design_digest")):
        return []
    was, current = (f"{d['design']!r} with digest {d['design_digest']}" for d in (stored, origin))
    return [f"{path}: design: {was}; this run has {current}: another sensor, or an edited design?"]


def _read_ledger(path: Path) -> tuple[str, SensorLedger]:
    """Return a file's text above the events, and its ledger. Raises InputError."""
    head = read_text(path) if path.exists() else _new_text()
    data = read_toml(path) if path.exists() else {}
    if "events" in data:
        head = _EVENTS_HEAD.split(head, maxsplit=1)[0]
        above = None
        with suppress(ValueError):
            above = {*tomllib.loads(head)}
        if above != {*data} - {"events"}:
            raise InputError(f"{path}: events: must be the last table, headed by [events]")
    data = {key: value for key, value in data.items() if key not in _ACCEPTANCE_KEYS}
    return head.rstrip() + "\n", validate(SensorLedger, data, str(path))


def _write_ledger(path: Path, head: str, events: dict[str, SensorEvent]) -> None:
    lines = [
        f"{toml_literal(key)} = {toml_literal(event.model_dump(exclude_defaults=True))}"
        for key, event in events.items()
    ]
    text = "\n".join([head, "[events]  # written by the program, a line each", *lines, ""])
    if not path.exists() or text != read_text(path):
        write_whole(path, text.encode())


def _new_text() -> str:
    """Return the text of a new file, with every key that a lab may fill in."""
    lines = ["# Fill in what applies; `deltact-fab rig sensors` lists all sensors."]
    for key, field in SensorLedger.model_fields.items():
        if field.default == "":
            lines.append(f'{key} = ""  # {field.description}')
        elif "cure" in key:
            lines.append(f"#{key} = 0.0  # {field.description}")
    return "\n".join([*lines, ""])
