"""Figures of every main result, to hold one commit against another: nothing else changed.

    python -m benchmarks.unchanged FIGURES.json [--against EARLIER.json] [--only NAME ...]

Runs the command line of the package that Python finds first, from an empty cache and in an empty
folder: volumes and faces of every part, bytes of the stickers and sheets, ten presses at each level
of the gel, a run with its images and rows, its flow over ten frames, a study at small scale. Only
commands and the names of `deltact_fab` are used, so that the same script reads any version:

    PYTHONPATH=/path/to/an/earlier/clone python benchmarks/unchanged.py earlier.json

With --against the differences are printed, one line each, and the exit code is 1 when there is one.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PROGRAM = (sys.executable, "-m", "deltact_fab")
SEED = 3
PRESSES = (
    "sphere:10 --depth 0.5", "sphere:15 --depth 3", "sphere:15 --depth 2 --shear-x 1",
    "4dots --depth 1", "edges --depth 0.8", "ellipsoid --depth 1 --shear-y 0.5",
    "hexprism --depth 0.6", "star --depth 0.5", "cylinder --depth 1",
    "sphere:22 --depth 2 --at 6,4",
)  # fmt: skip
"""Each as an indenter and options of `gel press`: every kind of tip, with and without shear."""
LEVELS = ("linear", "hyperelastic")
RECIPES = ("dense", "binary", "octave", "iid-grey", "dense-with-dots", "dots")
WALL_COLUMNS = ("wall", "host", "cpu")
"""Columns whose names hold one of these are times of this machine."""
FLOWS = """
import hashlib, sys
from pathlib import Path
import numpy as np
rows = {}
for folder in sorted(Path("measured").rglob("*.np[yz]"))[:10]:
    data = np.load(folder)
    arrays = {"": data} if isinstance(data, np.ndarray) else dict(data)
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            rows[f"{folder.stem}.{name}"] = [float(np.nanmean(array)), float(np.nanstd(array))]
        else:
            rows[f"{folder.stem}.{name}"] = int(array.sum()) if array.dtype.kind in "biu" else 0
import json
print(json.dumps(rows))
"""


def called(*words: str, refusals: bool = False) -> str:
    """The standard output of a command of the package. Raises CalledProcessError when it fails,
    but with refusals where it ends with exit code 1: a refused press is a figure too."""
    done = subprocess.run((*PROGRAM, *words), stdout=subprocess.PIPE, text=True)
    if done.returncode != (1 if refusals and done.returncode == 1 else 0):
        raise subprocess.CalledProcessError(done.returncode, done.args)
    return done.stdout


def digest(file: Path) -> str:
    """The SHA-256 of a file, its first 16 digits."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def parts() -> dict[str, Any]:
    """Volume, box and the hashes of all files of each part."""
    called("cad", "export", "--format", "step,stl,dxf", "--out", "parts")
    manifest = json.loads(Path("parts/manifest.json").read_text())
    rows = {}
    for row in manifest["files"]:
        text = Path("parts", row["file"]).read_text("latin-1")
        faces = text.count("ADVANCED_FACE") if row["file"].endswith("step") else None
        rows[row["file"]] = [
            row.get("volume_mm3"),
            row.get("bounding_box_mm"),
            faces,
            row["sha256"],
        ]
    return rows


def sheets() -> dict[str, Any]:
    """Bytes of stickers and sheets."""
    rows: dict[str, Any] = {}
    for recipe in RECIPES:
        called("pattern", "make", recipe, "-o", f"{recipe}.png")
        called("pattern", "sheet", recipe, "-o", f"{recipe}.pdf")
        rows |= {f: digest(Path(f)) for f in (f"{recipe}.png", f"{recipe}.pdf")}
    return rows


def presses() -> dict[str, Any]:
    """Every figure of ten presses at each level of the gel, but for the time they took."""
    rows = {}
    for press in PRESSES:
        for level in LEVELS:
            words = ["gel", "press", "--indenter", *press.split(), "--model", level, "--json"]
            answer = called(*words, "--spacing", "1.5", refusals=True)
            rows[f"{press}, {level}"] = timeless(json.loads(answer or "null"))
    return rows


def run() -> dict[str, Any]:
    """Hashes of the images of one run, the rows of its journal, and its flow over ten frames."""
    called("run", "smoke", "--rig", "virtual", "--seed", str(SEED), "--out", "run")
    rows: dict[str, Any] = {
        file.relative_to("run").as_posix(): digest(file)
        for file in sorted(Path("run").rglob("*"))
        if file.suffix in (".png", ".toml", ".npz", ".npy")
    }
    with sqlite3.connect("run/journal.sqlite") as journal:
        for (table,) in journal.execute("SELECT name FROM sqlite_master WHERE type='table'"):
            if table != "files":  # hashes of files that hold times and versions
                rows[f"journal.{table}"] = rows_of(journal, table)
    called("measure", "run", "--out", "measured", "--show", "flow")
    script = subprocess.run((sys.executable, "-c", FLOWS), check=True, stdout=subprocess.PIPE)
    return rows | json.loads(script.stdout)


def rows_of(journal: sqlite3.Connection, table: str) -> str:
    """The hash of a table's rows, without times of this machine."""
    columns = [row[1] for row in journal.execute(f"PRAGMA table_info({table})")]
    steady = [c for c in columns if not any(word in c for word in WALL_COLUMNS)]
    text = hashlib.sha256(repr(steady).encode())
    for row in journal.execute(f"SELECT {', '.join(steady)} FROM {table}"):
        text.update(repr(row).encode())
    return text.hexdigest()[:16]


def study() -> dict[str, Any]:
    """Every figure of a study at small scale."""
    words = ("--scale", "0.02", "--seed", str(SEED), "--out", "study", "--json")
    result: dict[str, Any] = timeless(json.loads(called("study", "run", "shapes", *words)))
    return result


def timeless(data: Any) -> Any:
    """Plain data without times, dates, versions and digests of code."""
    if isinstance(data, dict):
        return {key: timeless(value) for key, value in data.items() if not is_of_the_run(key)}
    return [timeless(value) for value in data] if isinstance(data, list) else data


def is_of_the_run(key: str) -> bool:
    """True for a key whose value tells when, how long or by what code, and no result."""
    words = ("seconds", "time", "date", "version", "digest", "cpu", "code", "folder", "page")
    return key.endswith("_s") or any(word in key for word in words)


SECTIONS = {"parts": parts, "sheets": sheets, "presses": presses, "run": run, "study": study}


SAME_REL = 1e-6
"""Numbers that differ by less are the same: a process that compiles the fast loops, in place of
loading them, rounds their sums in another order."""


def differences(now: Any, before: Any, path: str = "") -> Iterator[str]:
    """A line for each value that is not the same."""
    if isinstance(now, dict) and isinstance(before, dict):
        for key in sorted({*now, *before}):
            yield from differences(now.get(key), before.get(key), f"{path}/{key}")
    elif isinstance(now, list) and isinstance(before, list) and len(now) == len(before):
        for index, pair in enumerate(zip(now, before, strict=True)):
            yield from differences(*pair, f"{path}/{index}")
    elif isinstance(now, float) and isinstance(before, float):
        if not math.isclose(now, before, rel_tol=SAME_REL, abs_tol=1e-9):
            yield f"{path}: {before!r} before, {now!r} now"
    elif now != before:
        yield f"{path}: {before!r} before, {now!r} now"


def main() -> int:
    """Write the figures, print what differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figures", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    figures, before = options.figures.resolve(), None
    if options.against:  # read first: a wrong name would be told after minutes
        try:
            before = json.loads(options.against.read_text())
            before = {name: before[name] for name in options.only}
        except (OSError, ValueError, KeyError) as why:
            parser.error(f"--against {options.against}: no figures of {options.only}: {why}")
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    with tempfile.TemporaryDirectory() as folder:
        os.environ["DELTACT_FAB_CACHE"] = str(Path(folder, "cache"))
        os.chdir(folder)
        now = {}
        for name in options.only:
            begun_s = time.monotonic()
            now[name] = SECTIONS[name]()
            figures.write_text(json.dumps(now, indent=1))
            print(f"{name}: {time.monotonic() - begun_s:.0f} s", file=sys.stderr)
        os.chdir(figures.parent)
    if before is None:
        return 0
    lines = list(differences(now, before))
    print(*lines, f"{len(lines)} differences in {', '.join(now)}", sep="\n")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
