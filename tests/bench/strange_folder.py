"""A run folder as a stranger may send it, and the commands that meet it; `python FILE HOME...`."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import socket
import sqlite3
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # as a program too
from called import called

Attack = Callable[[Path, Path], object]
"""Spoils a run; the second folder is a victim's."""


def first(run: Path, pattern: str) -> Path:
    return sorted(run.glob(pattern))[0]


def replaced(name: str, make: Callable[[Path, Path], object]) -> Attack:
    """One file or folder, by its pattern, taken for another."""

    def attack(run: Path, victim: Path) -> None:
        path = first(run, name) if "*" in name else run / name
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        path.parent.mkdir(exist_ok=True)
        make(path, victim)

    return attack


def link_to_zero(path: Path, victim: Path) -> None:
    path.symlink_to("/dev/zero")


def link_to_victim(path: Path, victim: Path) -> None:
    path.symlink_to(victim / ("" if path.suffix == "" else "a.png"))


def pipe(path: Path, victim: Path) -> None:
    os.mkfifo(path)


def bound(path: Path, victim: Path) -> None:
    with socket.socket(socket.AF_UNIX) as sock:
        at = os.open(path.parent, os.O_RDONLY)
        sock.bind(f"/proc/self/fd/{at}/{path.name}")
        os.close(at)


def folder(path: Path, victim: Path) -> None:
    path.mkdir()


def content(data: Callable[[], bytes]) -> Callable[[Path, Path], object]:
    return lambda path, victim: path.write_bytes(data())


def edited(*keys: str, to: Any) -> Attack:
    """One value of run.json."""

    def attack(run: Path, victim: Path) -> None:
        data = json.loads((run / "run.json").read_text())
        table = data
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = to
        text = json.dumps(data).replace('"1e999"', "1e999")
        (run / "run.json").write_text(text)

    return attack


def sql(*lines: str, args: tuple[object, ...] = ()) -> Attack:
    def attack(run: Path, victim: Path) -> None:
        with closing(sqlite3.connect(run / "journal.sqlite")) as db, db:
            for line in lines:
                db.execute(line, args)

    return attack


def png_of(w: int, h: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 2, 0, 0, 0))
    return (
        b"\x89PNG\r\n\x1a\n"
        + head
        + chunk(b"IDAT", zlib.compress(bytes(1000)))
        + chunk(b"IEND", b"")
    )


def false_image(data: Callable[[], bytes]) -> Attack:
    """Bytes in place of the first image, and their hash."""

    def attack(run: Path, victim: Path) -> None:
        import hashlib

        path = first(run, "images/*.png")
        path.write_bytes(data())
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        sql("UPDATE frames SET sha256 = ? WHERE file LIKE ?", args=(digest, f"%{path.name}"))(
            run, victim
        )

    return attack


def false_truth(arrays: Callable[[dict[str, Any]], dict[str, bytes]]) -> Attack:
    """Members in place of those of the first truth, deflated."""

    def attack(run: Path, victim: Path) -> None:
        path = first(run, "truth/*.npz")
        with zipfile.ZipFile(path) as packed:
            members = {name: packed.read(name) for name in packed.namelist()}
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
            for name, data in arrays(members).items():
                packed.writestr(name, data)

    return attack


def npy(shape: tuple[int, ...], data: bytes) -> bytes:
    out = io.BytesIO()
    head = {"descr": "<f4", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(out, head)
    return out.getvalue() + data


def large_chunk(run: Path, victim: Path) -> None:
    n = 60_000_000
    heads = json.dumps([["t_ns", "<i8", 1.0], ["fx_n", "<f8", 1.0]])
    deflate = zlib.compressobj(9)
    zeros = bytes(16 << 20)
    data = b"".join(deflate.compress(zeros) for _ in range(60)) + deflate.flush()
    sql(
        "UPDATE samples SET n = ?, columns = ?, data = ? WHERE rowid IN "
        "(SELECT rowid FROM samples WHERE stream = 'force' ORDER BY seq LIMIT 1)",
        args=(n, heads, data),
    )(run, victim)


def endless_table(run: Path, victim: Path) -> None:
    """Pages of the events' tree that refer to one another: some 100^9 rows."""
    path = run / "journal.sqlite"
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA journal_mode=DELETE")
        root = db.execute("SELECT rootpage FROM sqlite_master WHERE name = 'events'").fetchone()[0]
        size = db.execute("PRAGMA page_size").fetchone()[0]
    data = bytearray(path.read_bytes())
    leaf = data[(root - 1) * size : root * size]
    count = len(data) // size
    levels = [count + k + 1 for k in range(9)]
    data += bytes(size * 9)
    # The old root becomes the lowest of the new pages; each above has 100 times the one below.
    data[(levels[-1] - 1) * size : levels[-1] * size] = leaf
    for page, below in zip([root, *levels[:-1]], levels, strict=True):
        cells = [struct.pack(">I", below) + b"\x01"] * 100
        body = bytearray(size)
        body[:12] = struct.pack(">BHHHBI", 5, 0, len(cells), size - 5 * len(cells), 0, below)
        for k, cell in enumerate(cells):
            at = size - 5 * (k + 1)
            body[at : at + 5] = cell
            body[12 + 2 * k : 14 + 2 * k] = struct.pack(">H", at)
        data[(page - 1) * size : page * size] = body
    data[28:32] = struct.pack(">I", len(data) // size)
    path.write_bytes(data)


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
CASES: dict[str, Attack] = {
    f"{name} {kind}": replaced(name, make)
    for kind, make in {"/dev/zero": link_to_zero, "victim": link_to_victim, "FIFO": pipe}.items()
    for name in FILES
}
for _name in ("run.json", "journal.sqlite", "images/*.png", "notes.jsonl"):
    CASES |= {f"{_name} socket": replaced(_name, bound), f"{_name} folder": replaced(_name, folder)}
CASES |= {
    "run.json large": replaced("run.json", content(lambda: b'{"a": "' + bytes(60 << 20) + b'"}')),
    "run.json many": replaced("run.json", content(lambda: b'{"a":[' + b"{}," * 2**21 + b"{}]}")),
    "run.json flat": replaced(
        "run.json", content(lambda: b'{"format":6,"a":[' + b"1," * (7 << 19) + b"1]}")
    ),
    "run.json faults": edited("versions", to={f"k{n}": n for n in range(300_000)}),
    "run.json nested": replaced(
        "run.json", content(lambda: b'{"a":' * 10_000 + b"1" + b"}" * 10_000)
    ),
    "notes large": replaced("notes.jsonl", content(lambda: b"{}\n" * (1 << 20))),
    "camera wide": edited("camera", "width_px", to=200_000),
    "camera 10^8 px": edited("camera", to={
        "model": "pinhole", "mm_per_px": 0.1, "width_px": 10_000, "height_px": 10_000,
        "eye_distance_mm": 12.0}),
    "camera other size": edited("camera", "width_px", to=4_000),
    **{f"mm_per_px {value}": edited("camera", "mm_per_px", to=value)
       for value in (float("nan"), float("inf"), "1e999", 0, -0.1)},
    "optics nan": edited("sensor", "optics", "mm_per_px", to=float("nan")),
    "png 60000": false_image(lambda: png_of(60_000, 60_000)),
    "image outside": sql("UPDATE frames SET file = '../victim/a.png'"),
    "image absolute": sql("UPDATE frames SET file = '/dev/zero'"),
    "truth unpacks": false_truth(
        lambda m: {**m, "zone_map.npy": npy((700 << 18,), bytes(700 << 20))}
    ),
    "truth shape": false_truth(lambda m: {**m, "displacement_mm.npy": npy((1 << 33,), b"")}),
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


def outcome(words: tuple[str, ...], run: Path, out: Path) -> tuple[int, str]:
    """Code and words of a command on a run; -1 when it takes more than LIMIT_S."""

    def ring(*_: object) -> None:
        raise Hung

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(LIMIT_S)
    try:
        done = called(*(w.replace("RUN", str(run)).replace("OUT", str(out)) for w in words))
        return done.returncode, done.stderr or done.stdout
    except Hung:
        return -1, "hung"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


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


def main(*homes: str) -> None:
    """All commands on spoiled runs, a line each: case, command, code, words, MB."""
    for home in map(Path, homes):
        for k, words in enumerate(COMMANDS):
            if words[0] in ("report", "analyze") and home.name.startswith(LATE):
                continue
            code, text = outcome(words, home / "run", home / f"out{k}")
            status = Path("/proc/self/status").read_text()
            peak_mb = int(re.findall(r"VmHWM:\s+(\d+)", status)[0]) // 1024
            print(json.dumps([home.name, " ".join(words[:2]), code, text, peak_mb]), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
