"""Wrong input of every kind, case by case from a number, and what may come of it at the edge.

A case is a folder with one file or record that is wrong somewhere, and a command that reads it. All
that is drawn follows from the case's number.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import reduce
from operator import getitem
from pathlib import Path
from random import Random
from typing import Any

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig.config import GrblConfig, VirtualConfig
from deltact_fab.bench.rig.run.runner import Runner
from deltact_fab.bench.rig.tables import RegistrationFile
from deltact_fab.common.configuration import json_schema_of, resolve_schema
from deltact_fab.common.errors import Stopped
from deltact_fab.fabricate.cad.design import IndenterList
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.patterns.recipe import PatternRecipe
from deltact_fab.sensor.optics.fisheye import Fisheye

LIMIT_S = 10
"""Of processor time, for any one command: a refusal takes some tenths."""


class Raw(str):
    """A value as TOML writes it."""


Path_ = tuple[str | int, ...]
FACE = {"origin_machine_mm": [-60.0, -60.0, -40.0], "angle_deg": 0.0, "tilt_deg": [0.0, 0.0]}
STAGE = {
    **FACE, "travel_mm": [120.0, 120.0, 60.0], "max_feed_mm_min": [1500.0, 1500.0, 1200.0],
    "acceleration_mm_s2": [50.0, 50.0, 50.0], "max_force_n": [60.0, 60.0, 60.0],
}  # fmt: skip
PROTOCOL = {
    "name": "fuzzed", "indenters": ["sphere:10"], "positions_mm": [[0.5, -0.5]],
    "depths_mm": [1.0], "channels": ["image", "dots", "force", "shear"],
    "shear": {"amplitude_mm": 0.5, "axes": ["x"]}, "capture": {"rate_hz": 0.5},
}  # fmt: skip
VIRTUAL = {
    "kind": "virtual", "stage": STAGE, "force": {"range_n": [25.0, 25.0, 35.0]},
    "virtual": {"gel": {"spacing_mm": 0.5}},
}  # fmt: skip
GRBL = {
    "kind": "grbl", "stage": {**STAGE, "port": "/dev/not-there"},
    "force": {"netft": {"host": "127.0.0.1"}}, "camera": {"source": "/dev/not-there"},
    "touch": {"spread_mm": 0.02},
    "tools": {"sphere:10": {"length_mm": 1.0}},
}  # fmt: skip
REGISTRATION = {
    **FACE, "date": "2026-01-01", "rig": "r", "indenter": "sphere:10", "by": "force",
    "residual_mm": 0.01,
    "touches": [{"at_mm": [float(i), 0.0], "machine_mm": [0.0, 0.0, 0.0], "spread_mm": 0.01}
                for i in range(3)],
}  # fmt: skip
PATTERN = {"law": "algorithm1", "seed": 7, "size_mm": 20.0, "patch_mm": 0.5, "r": 0.3, "dots": {
    "columns": 5, "rows": 5}}  # fmt: skip
TINY = {**PROTOCOL, "name": "tiny", "channels": ["image", "dots", "force", "traction"],
        "depths_mm": [0.5], "capture": {"settle_s": 0.1}}  # fmt: skip
del TINY["shear"]
CAMERA = {"camera": {"model": "fisheye"}}
INDENTERS = {"body": {"plate_mm": 4.0}, "indenter": [{"name": "sphere:10", "quantity": 1}]}

RECORD = ("record check run", "record show run", "record export run --format csv --out out/x",
          "report . -o out/index.html")  # fmt: skip
READERS = ("report run -o out/report.html", "analyze tracking run --out out/a",
           "calibrate force run --out out/f", "analyze shape run --out out/s",
           "calibrate depth run -o out/depth.toml",
           "study run settling --from run --out out/study")  # fmt: skip
KINDS: dict[str, tuple[Any, dict[str, Any], tuple[str, ...]]] = {
    "cad": (Design, {}, ("cad show frame --design f.toml", "cad bom --design f.toml",
                         "protocol check p.toml --rig r.toml")),
    "cad/indenters": (IndenterList, INDENTERS, ("cad bom",)),
    "pattern": (PatternRecipe, PATTERN, ("pattern make f.toml -o out/x.png --dpi 100",
                                         "run p.toml --rig r.toml --out out/x")),
    "protocol": (Protocol, PROTOCOL, ("protocol check f.toml --rig r.toml",
                                      "protocol show f.toml --rig r.toml",
                                      "run f.toml --rig r.toml --out out/x")),
    "virtual rig": (VirtualConfig, VIRTUAL, ("rig show f.toml", "rig check f.toml",
                                             "protocol check p.toml --rig f.toml",
                                             "run p.toml --rig f.toml --out out/x")),
    "real rig": (GrblConfig, GRBL, ("rig show f.toml", "rig status f.toml",
                                    "protocol check p.toml --rig f.toml --air",
                                    "run p.toml --rig f.toml --dry-run --air")),
    "registration": (RegistrationFile, REGISTRATION, ("rig show r.toml",)),
    "camera": (Fisheye, CAMERA, ("protocol check p.toml --rig r.toml",)),
}  # fmt: skip

VALUES: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, -1, -1.0, 0, 0.0, -0.0, 1e300, -1e300, 1e-300, 5e-324, 2**63,
    -(2**63), Raw("1" * 400), Raw("9" * 5000), True, False, "", "text", "x" * 100_000,
    "ünïcøde 🦾 \u202e\u0007", "\u0000", "../../../etc/passwd", "/", "nan", "1", "a" * 300, [], {},
    [[]], [math.nan] * 3, [1e300] * 3, [-1, 0], ["x"] * 2, [1.0] * 10_000, [[[[1]]]], {"x": 1},
    {"": {}}, Raw("1979-05-27"), Raw("07:32:00"), Raw("0x7fffffff"), Raw("["*200 + "]"*200), 3,
    0.001, 7.5, 1000, 1e6, 1e-6,
)  # fmt: skip


def keys(
    node: dict[str, Any], root: dict[str, Any], at: Path_ = ()
) -> Iterator[tuple[Path_, list[Any]]]:
    """Every key of a schema, and of the tables in it, with the limits of its value."""
    ends = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")
    for name, raw in node.get("properties", {}).items():
        key = resolve_schema(raw, root)
        yield (*at, name), [key[end] for end in ends if end in key] + key.get("enum", [])
        yield from keys(key, root, (*at, name))
        yield from keys(resolve_schema(key.get("items", {}), root), root, (*at, name, 0))


def with_value(node: Any, at: Path_, value: Any) -> Any:
    """The same data with a value at a place; tables and lists on the way are made."""
    key, rest = at[0], at[1:]
    if isinstance(key, int):
        held = node if isinstance(node, list) else []
        first = held[0] if held else None
        return [with_value(first, rest, value) if rest else value, *held[1:]]
    table = node if isinstance(node, dict) else {}
    return {**table, key: with_value(table.get(key), rest, value) if rest else value}


def places(node: Any, at: Path_ = ()) -> Iterator[Path_]:
    """Every place in data, tables and lists as well as what they hold."""
    if isinstance(node, dict | list):
        for key in node if isinstance(node, dict) else range(len(node)):
            yield (*at, key)
            yield from places(node[key], (*at, key))


def written(value: Any) -> str:
    """A value as TOML; `catalog.as_toml` writes none of the wrong ones."""
    if isinstance(value, Raw):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)  # nan, inf and 1e+300 read so
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{json.dumps(k)} = {written(v)}' for k, v in value.items())}}}"
    return str(value)


def toml(data: dict[str, Any]) -> bytes:
    """The bytes of a file of tables, a line a key."""
    return "\n".join(f"{json.dumps(k)} = {written(v)}" for k, v in data.items()).encode()


# Tables or lists in each other, far too deep.
BRACKETS = (b"a = " + b"[" * 5000 + b"]" * 5000, b"a = " + b"{a = " * 5000,
            b".".join([b"a"] * 20_000) + b" = 1", b"[" + b"a." * 5000 + b"a]")  # fmt: skip


def damaged(data: bytes, draw: Random) -> bytes:
    """Bytes with a piece cut, doubled, changed or put in."""
    spoilt = bytearray(data)
    for _ in range(draw.choice([1, 1, 2, 20])):
        at = draw.randrange(len(spoilt) + 1)
        what = draw.randrange(6)
        if what == 0:
            del spoilt[at:]
        elif what == 1:
            del spoilt[at : at + draw.randrange(1, 40)]
        elif what == 2:
            spoilt[at:at] = draw.randbytes(draw.randrange(1, 20))
        elif what == 3:
            spoilt[at:at] = draw.choice([b"\0", b"\xff", "é".encode(), b'"', b"[", b"=", b"\n"])
        elif what == 4 and at < len(spoilt):
            spoilt[at] ^= 1 << draw.randrange(8)
        else:
            spoilt[at:at] = spoilt[at : at + draw.randrange(1, 200)]
    return bytes(spoilt)


def whole(path: Path, good: bytes, draw: Random) -> str:
    """Put something in a file's place that is wrong as a whole; what, in a word."""
    ways = ("empty", "binary", "folder", "circle", "big", "brackets", "gone", "utf-16", "cut",
            "damaged", "damaged", "damaged", "long key", "twice", "null")  # fmt: skip
    what = draw.choice(ways)
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    if what == "folder":
        path.mkdir()
    elif what == "circle":
        path.symlink_to(path)
    elif what == "big":
        path.write_bytes(b"a = 1\n")
        os.truncate(path, 50 * 2**20)
    elif what != "gone":
        path.write_bytes({
            "empty": b"", "binary": draw.randbytes(5000), "brackets": draw.choice(BRACKETS),
            "utf-16": good.decode("latin-1").encode("utf-16"),
            "cut": good[: draw.randrange(len(good) + 1)], "damaged": damaged(good, draw),
            "long key": b"k" * 100_000 + b" = 1\n" + good, "twice": good + b"\n" + good,
            "null": b"null",
        }[what])  # fmt: skip
    return what


class Fuzz:
    """Cases from numbers; run: the folder of a recorded run to spoil.

    light: no command that computes for long where the input serves.
    """

    def __init__(self, run: Path, light: bool = False) -> None:
        self._light = light
        self._run = run
        self._turn = [
            (kind, *found)
            for kind, (model, _, _) in KINDS.items()
            for found in keys(json_schema_of(model), json_schema_of(model))
        ]

    def prepare(self, number: int, folder: Path) -> tuple[str, list[str]]:
        """Fill a folder and return what is wrong, and the command."""
        draw = Random(number)
        (folder / "out").mkdir(parents=True)
        (folder / "p.toml").write_bytes(toml(PROTOCOL))
        (folder / "r.toml").write_bytes(toml(VIRTUAL))
        which = draw.choices([self._value, self._file, self._record], [62, 12, 26])[0]
        return which(draw, number, folder)

    def _value(self, draw: Random, number: int, folder: Path) -> tuple[str, list[str]]:
        # A prime: every key has its turn.
        kind, at, ends = self._turn[number * 7919 % len(self._turn)]
        _, base, commands = KINDS[kind]
        if draw.random() < 0.05:
            at = (*at[:-1], draw.choice(["unknown", "", "x" * 100_000, "ünï", "a.b", "0"]))
        value = draw.choice(ends if ends and draw.random() < 0.4 else VALUES)
        data = with_value(base, ("camera", *at) if kind == "camera" else at, value)
        what = f"{kind}: {'.'.join(map(str, at))[:80]} = {written(value)[:60]}"
        return what, self._command(kind, toml(data), folder, draw.choice(commands))

    def _file(self, draw: Random, number: int, folder: Path) -> tuple[str, list[str]]:
        kind = draw.choice(list(KINDS))
        _, base, commands = KINDS[kind]
        words = self._command(kind, toml(base), folder, draw.choice(commands))
        return f"{kind}: {whole(self._place(kind, folder), toml(base), draw)}", words

    def _place(self, kind: str, folder: Path) -> Path:
        return folder / {"cad/indenters": "cad/indenters.toml"}.get(kind, "f.toml")

    def _command(self, kind: str, file: bytes, folder: Path, command: str) -> list[str]:
        """Write the file and what names it."""
        place = self._place(kind, folder)
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(file)
        if kind in ("cad", "pattern"):
            name = "design" if kind == "cad" else "pattern"
            given = {**PROTOCOL, "specimen": {name: "./f.toml"}}
            (folder / "p.toml").write_bytes(toml(given))
        if kind == "registration":
            given = {**GRBL, "stage": {**GRBL["stage"], "registration": "f.toml"}}  # type: ignore[dict-item]
            (folder / "r.toml").write_bytes(toml(given))
        if kind == "camera":
            given = {**VIRTUAL, "camera": {"model": "f.toml"}, "virtual": {"lens": {}}}
            (folder / "r.toml").write_bytes(toml(given))
        return command.split()

    def _record(self, draw: Random, number: int, folder: Path) -> tuple[str, list[str]]:
        run = folder / "run"
        shutil.copytree(self._run, run)
        result = folder / "study" / "result.json"
        result.parent.mkdir()
        shutil.copy(self._run.with_name("result.json"), result)
        files = sorted(p for p in run.rglob("*") if p.is_file()) + [result]
        named = [p for p in files if p.suffix in (".json", ".toml", ".sqlite")]
        heavy = draw.random() < 0.15 and not self._light
        command = draw.choice(READERS if heavy else RECORD)
        way = draw.random()
        if way < 0.4:
            file = draw.choice([run / "run.json", run / "run.json", run / "pattern.json",
                                run / "summary.json", run / "truth" / "lattice.json",
                                run / "analysis" / "tracking.json", result])  # fmt: skip
            data = json.loads(file.read_text())
            at = draw.choice([*places(data)])
            inside, place = reduce(getitem, at[:-1], data), ".".join(map(str, at))
            value = draw.choice([v for v in VALUES if not isinstance(v, Raw)] + [None])
            if draw.random() < 0.3:
                del inside[at[-1]]
                what = f"{file.name}: {place} gone"
            else:
                inside[at[-1]] = value
                what = f"{file.name}: {place} = {str(value)[:60]}"
            file.write_text(json.dumps(data))
        elif way < 0.55:
            with closing(sqlite3.connect(run / "journal.sqlite")) as db, db:
                table = draw.choice(["frames", "steps", "samples", "events"])
                columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
                column = draw.choice(columns)
                value = draw.choice([None, -1, 1e300, "text", b"\0\xff", "x" * 10_000, 2**62])
                what = f"{table}.{column} = {str(value)[:20]}"
                ways = [f"DROP TABLE {table}", f"DELETE FROM {table}",
                        f"ALTER TABLE {table} RENAME COLUMN {column} TO other"]  # fmt: skip
                some = draw.choice(["", " WHERE seq % 3 = 1"])
                try:
                    if draw.random() < 0.3:
                        db.execute(what := draw.choice(ways))
                    else:
                        db.execute(f"UPDATE {table} SET {column} = ?{some}", (value,))
                except sqlite3.Error:
                    db.execute(what := ways[1])
        else:
            file = draw.choice(named if way < 0.85 else files)
            what = f"{file.relative_to(folder)}: {whole(file, file.read_bytes(), draw)}"
        return f"run: {what}", command.split()


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """TimeoutError in whatever takes more of the processor."""

    def over(*_: object) -> None:
        raise TimeoutError(f"over {seconds:g} s")

    before = signal.signal(signal.SIGPROF, over)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def stop_at_first_motion(patch: Callable[[object, str, object], None]) -> None:
    """Runs begin, with all that they build, and are ended by the operator then."""

    def stopped(self: Runner, steps: object) -> None:
        raise Stopped("stopped before the first motion")

    patch(Runner, "run", stopped)


def fault(code: int, err: str, folder: Path) -> str | None:
    """What is wrong with how a command ended; None: nothing."""
    if "Traceback" in err:  # too slow, or an error that nobody expected
        return err[-300:]
    if code not in (0, 1, 2, 130):
        return f"exit code {code}"
    left = sorted(str(p.relative_to(folder)) for p in (folder / "out").rglob("*"))
    hidden = [p for p in left if Path(p).name.startswith(".")]
    if hidden:
        return f"half written: {hidden[:3]}"
    if code != 2:
        return None
    if left:
        return f"refused, and left {left[:3]}"
    lines = [line for line in err.splitlines() if line.startswith("deltact-fab: ")]
    if len(lines) != 1:
        return f"{len(lines)} lines of errors: {err[:300]!r}"
    if len(lines[0]) > 300 or not lines[0].isprintable():
        return f"a line of {len(lines[0])} characters: {lines[0][:200]!r}"
    return None
