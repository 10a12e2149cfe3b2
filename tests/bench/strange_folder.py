"""A run folder as a stranger may send it, and the commands that meet it; `python FILE HOME...`."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import signal
import sqlite3
import stat
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from contextlib import closing
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.bench.record.images import encode_png

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a program too
from called import called

Attack = Callable[[Path, Path], object]
"""Spoils a run, or makes a file at a path; the second folder is a victim's."""


def replaced(name: str, make: Attack) -> Attack:
    """One file or folder, the first of its pattern, taken for another."""

    def attack(run: Path, victim: Path) -> None:
        path = min(run.glob(name)) if "*" in name else run / name
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.parent.mkdir(exist_ok=True)
        make(path, victim)

    return attack


def link_to_victim(path: Path, victim: Path) -> None:
    path.symlink_to(victim / ("" if path.suffix == "" else "a.png"))


def run_file(data: Callable[[], bytes]) -> Attack:
    return lambda run, victim: (run / "run.json").write_bytes(data())


def edited(*keys: str, to: Any) -> Attack:
    """One value of run.json."""

    def attack(run: Path, victim: Path) -> None:
        data = json.loads((run / "run.json").read_text())
        reduce(dict.__getitem__, keys[:-1], data)[keys[-1]] = to
        (run / "run.json").write_text(json.dumps(data).replace('"1e999"', "1e999"))

    return attack


def sql(*lines: str, args: tuple[object, ...] = ()) -> Attack:
    def attack(run: Path, victim: Path) -> None:
        with closing(sqlite3.connect(run / "journal.sqlite")) as db, db:
            for line in lines:
                db.execute(line, args)

    return attack


def png_of(w: int, h: int) -> bytes:
    """A small image whose header tells another size."""
    data = bytearray(encode_png(np.zeros((8, 8, 3), np.uint8)))
    data[16:24] = struct.pack(">II", w, h)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return bytes(data)


def large_image(run: Path, victim: Path) -> None:
    """In place of the first image, with its hash."""
    path, data = min(run.glob("images/*.png")), png_of(60_000, 60_000)
    path.write_bytes(data)
    args = hashlib.sha256(data).hexdigest(), f"%{path.name}"
    sql("UPDATE frames SET sha256 = ? WHERE file LIKE ?", args=args)(run, victim)


def false_truth(name: str, n: int, n_bytes: int) -> Attack:
    """An array of n numbers and so many bytes in the first truth, deflated."""

    def attack(run: Path, victim: Path) -> None:
        path, array = min(run.glob("truth/*.npz")), io.BytesIO()
        head = {"descr": "<f4", "fortran_order": False, "shape": (n,)}
        np.lib.format.write_array_header_1_0(array, head)
        with zipfile.ZipFile(path) as packed:
            members = {name: packed.read(name) for name in packed.namelist()}
        members[name] = array.getvalue() + bytes(n_bytes)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
            for member, data in members.items():
                packed.writestr(member, data)

    return attack


def large_chunk(run: Path, victim: Path) -> None:
    heads = json.dumps([["t_ns", "<i8", 1.0], ["fx_n", "<f8", 1.0]])
    deflate, zeros = zlib.compressobj(9), bytes(16 << 20)
    data = b"".join(deflate.compress(zeros) for _ in range(60)) + deflate.flush()
    sql(
        "UPDATE samples SET n = 60000000, columns = ?, data = ? WHERE rowid IN "
        "(SELECT rowid FROM samples WHERE stream = 'force' ORDER BY seq LIMIT 1)",
        args=(heads, data),
    )(run, victim)


def endless_table(run: Path, victim: Path) -> None:
    """Pages of the events' tree that refer to one another: some 100^9 rows."""
    path = run / "journal.sqlite"
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA journal_mode=DELETE")
        root = db.execute("SELECT rootpage FROM sqlite_master WHERE name = 'events'").fetchone()[0]
        size = db.execute("PRAGMA page_size").fetchone()[0]
    data = path.read_bytes()
    pages = [data[k : k + size] for k in range(0, len(data), size)]
    levels = [root, *range(len(pages) + 1, len(pages) + 10)]
    # The old root becomes the lowest of the new pages; each above has 100 times the one below.
    pages += [pages[root - 1]] * 9
    for page, below in pairwise(levels):
        head = struct.pack(">BHHHBI", 5, 0, 100, size - 500, 0, below)
        head += struct.pack(">100H", *range(size - 5, size - 501, -5))
        cells = (struct.pack(">I", below) + b"\x01") * 100
        pages[page - 1] = head.ljust(size - 500, b"\0") + cells
    pages[0] = pages[0][:28] + struct.pack(">I", len(pages)) + pages[0][32:]
    path.write_bytes(b"".join(pages))


def named_by_rollback(run: Path, victim: Path) -> None:
    """A journal of a rollback that ends with the path of the victim's file."""
    name = os.fsencode(victim / "a.png")
    magic, size = bytes.fromhex("d9d505f920a163d7"), 4096
    tail = struct.pack(">I", 0) + name + struct.pack(">II", len(name), sum(name)) + magic
    path = run / "journal.sqlite"
    head = magic + struct.pack(">IIIII", 0, 1, path.stat().st_size // size, 512, size)
    (run / "journal.sqlite-journal").write_bytes(head.ljust(512, b"\0") + tail)


FILES = (
    "run.json", "protocol.toml", "pattern.json", "summary.json", "notes.jsonl", "journal.sqlite",
    "journal.sqlite-wal", "camera.flat.png", "images", "truth", "analysis", "images/*.png",
    "truth/*.npz", "truth/lattice.json", "analysis/tracking.json", "analysis/depth.toml",
)  # fmt: skip
SOME = ("run.json", "journal.sqlite", "images/*.png", "notes.jsonl")
KINDS: dict[str, tuple[tuple[str, ...], Attack]] = {
    "/dev/zero": (FILES, lambda path, victim: path.symlink_to("/dev/zero")),
    "victim": (FILES, link_to_victim),
    "FIFO": (FILES, lambda path, victim: os.mkfifo(path)),
    "socket": (SOME, lambda path, victim: os.mknod(path, stat.S_IFSOCK | 0o600)),
    "folder": (SOME, lambda path, victim: path.mkdir()),
}
CASES: dict[str, Attack] = {
    f"{file} {kind}": replaced(file, make)
    for kind, (files, make) in KINDS.items()
    for file in files
} | {
    "run.json large": run_file(lambda: b'{"a": "' + bytes(60 << 20) + b'"}'),
    "run.json many": run_file(lambda: b'{"a":[' + b"{}," * 2**21 + b"{}]}"),
    "run.json flat": run_file(lambda: b'{"format":6,"a":[' + b"1," * (7 << 19) + b"1]}"),
    "run.json faults": edited("versions", to={f"k{n}": n for n in range(300_000)}),
    "run.json nested": run_file(lambda: b'{"a":' * 10_000 + b"1" + b"}" * 10_000),
    "notes large": lambda run, victim: (run / "notes.jsonl").write_bytes(b"{}\n" * (1 << 20)),
    "camera wide": edited("camera", "width_px", to=200_000),
    "camera 10^8 px": edited("camera", to={
        "model": "pinhole", "mm_per_px": 0.1, "width_px": 10_000, "height_px": 10_000,
        "eye_distance_mm": 12.0}),
    "camera other size": edited("camera", "width_px", to=4_000),
    **{f"mm_per_px {value}": edited("camera", "mm_per_px", to=value)
       for value in (float("nan"), float("inf"), "1e999", 0, -0.1)},
    "optics nan": edited("sensor", "optics", "mm_per_px", to=float("nan")),
    "png 60000": large_image,
    "image outside": sql("UPDATE frames SET file = '../victim/a.png'"),
    "image absolute": sql("UPDATE frames SET file = '/dev/zero'"),
    "truth unpacks": false_truth("zone_map.npy", 700 << 18, 700 << 20),
    "truth shape": false_truth("displacement_mm.npy", 1 << 33, 0),
    "chunk unpacks": large_chunk,
    "trigger": sql(
        "CREATE TRIGGER endless BEFORE INSERT ON events BEGIN SELECT count(*) FROM "
        "(WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT n FROM c); END"
    ),
    "view": sql(
        "ALTER TABLE frames RENAME TO f",
        "CREATE VIEW frames AS WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) "
        "SELECT f.* FROM f, c",
    ),
    "virtual table": sql("CREATE VIRTUAL TABLE v USING fts5(x)"),
    "generated column": sql("ALTER TABLE frames ADD COLUMN g AS (hex(zeroblob(1000000000)))"),
    "expression index": sql("CREATE INDEX i ON events (length(text || hex(wall_s)))"),
    "endless table": endless_table,
    "rollback": named_by_rollback,
}  # fmt: skip
COMMANDS = (
    ("record", "check", "RUN"),
    ("measure", "RUN"),
    ("report", "RUN"),
    ("record", "export", "RUN", "--format", "csv", "--out", "OUT"),
    ("record", "export", "RUN", "--format", "mcap", "-o", "OUT.mcap"),
    ("analyze", "tracking", "RUN", "--method", "dis-fast/static"),
    ("record", "show", "RUN"),
    ("record", "note", "RUN", "a note"),
)
LATE = ("images_", "notes", "truth unpacks")  # met late by an analysis; two others show that
LIMIT_S = 20  # generous: a refusal takes 0.1 s, an analysis that meets the file late 5 s


class Hung(BaseException):
    """Not an Exception, so that no command takes it for its own."""


def ring(*_: object) -> None:
    raise Hung


def outcome(words: tuple[str, ...], run: Path, out: Path) -> tuple[int, str]:
    """Code and words of a command on a run; Hung when it takes more than LIMIT_S."""
    signal.signal(signal.SIGALRM, ring)
    signal.alarm(LIMIT_S)
    try:
        done = called(*(w.replace("RUN", str(run)).replace("OUT", str(out)) for w in words))
    finally:
        signal.alarm(0)
    return done.returncode, done.stderr or done.stdout


def spoiled(run: Path, home: Path, case: str) -> tuple[Path, Path]:
    """A spoiled copy of a run, and the victim's folder."""
    victim = home / "victim"
    victim.mkdir(parents=True)
    for name in ("a.png", "b.jxl", "c.npz", ".d.part", "e.json"):
        (victim / name).write_bytes(b"precious")
    shutil.copytree(run, home / "run")
    CASES[case](home / "run", victim)
    return home / "run", victim


def whole(victim: Path) -> bool:
    """True if the victim has what it had."""
    found = {path.name: path.read_bytes() for path in victim.iterdir()}
    return len(found) == 5 and set(found.values()) == {b"precious"}


def memory_mb(name: str) -> int:
    """A figure of this process, from Linux."""
    status = Path("/proc/self/status").read_text()
    return int(re.findall(rf"{name}:\s+(\d+)", status)[0]) // 1024


if __name__ == "__main__":  # all commands on spoiled runs: case, command, code, words, MB it took
    for home in map(Path, sys.argv[1:]):
        for k, words in enumerate(COMMANDS):
            if words[0] in ("report", "analyze") and home.name.startswith(LATE):
                continue
            Path("/proc/self/clear_refs").write_text("5")  # the peak begins again
            before_mb = memory_mb("VmRSS")
            code, text = outcome(words, home / "run", home / f"out{k}")
            swell_mb = memory_mb("VmHWM") - before_mb
            row = [home.name, " ".join(words[:2]), code, text, swell_mb]
            print(json.dumps(row), flush=True)
