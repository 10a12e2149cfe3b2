"""Do a room's tests notice a fault? `python -m benchmarks.mutants --seed 0 --count 40 [--slow]`.

Faults come from two places: benchmarks/mutants.toml (what a person would get wrong, by hand) and a
draw over all rooms with a seed (a comparison turned, a sign or a factor changed, a constant moved,
a condition negated, a refusal left out). Each is put into a copy of the tree, and the tests of its
room run until one fails. Printed: a row a fault, and how many were noticed. A fault that no test
notices is a gap, or is equivalent to what stood there: a person reads which.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "deltact_fab"
# Rooms whose tests are not the folder of their name.
TESTS = {
    "record": "tests/test_rec*.py tests/bench/test_resume.py tests/bench/test_faults.py",
    "jobs": "tests/test_jobs*.py",
    "preflight": "tests/test_preflight*.py tests/simulate/test_estimate.py",
    "experiment": "tests/simulate/test_experiment.py tests/protocols",
    "pdf": "tests/patterns",
    "": "tests/test_*.py tests/lab tests/schema",
}
TURNED: dict[type, type] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Lt, ast.Gt: ast.LtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or,
    ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """A piece of a file and what takes its place."""

    path: Path
    start: int
    end: int
    new: str

    @property
    def room(self) -> str:
        inner = self.path.relative_to(PACKAGE).parts
        return inner[0] if len(inner) > 1 else ""

    def text(self) -> str:
        old = self.path.read_text()
        return old[: self.start] + self.new + old[self.end :]

    def row(self) -> str:
        old = self.path.read_text()
        line = old.count("\n", 0, self.start) + 1
        was = " ".join(old[self.start : self.end].split())
        return (
            f"{self.path.relative_to(ROOT)}:{line}: {was[:60]} -> {' '.join(self.new.split())[:60]}"
        )


def changed(node: ast.AST) -> ast.AST | None:
    """The node with one fault, or None where none of the kinds fits."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        return ast.Compare(node.left, [TURNED[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.BinOp) and type(node.op) in TURNED:
        if isinstance(node.left, ast.JoinedStr) or isinstance(node.right, ast.JoinedStr):
            return None
        return ast.BinOp(node.left, TURNED[type(node.op)](), node.right)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(TURNED[type(node.op)](), node.values)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        return node.operand
    value = getattr(node, "value", None)
    if isinstance(node, ast.Constant) and isinstance(value, int | float) and value not in (0, 1):
        return ast.Constant(value + 1 if value == int(value) else value * 1.2)
    if isinstance(node, ast.Raise) and node.exc is not None:
        return ast.Pass()
    return None


def drawable(path: Path) -> list[Fault]:
    """Every fault that a file could be given."""
    text = path.read_text()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    raw = text.encode()

    def at(line: int, column: int) -> int:
        return len(raw[: starts[line - 1] + column].decode())

    found = []
    for node in ast.walk(ast.parse(text)):
        new = changed(node)
        if new is None or not isinstance(node, ast.expr | ast.stmt):
            continue
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        written = ast.unparse(ast.fix_missing_locations(new))
        fault = Fault(
            path,
            at(node.lineno, node.col_offset),
            at(node.end_lineno, node.end_col_offset),
            written if isinstance(node, ast.stmt) else f"({written})",
        )
        try:
            compile(fault.text(), str(path), "exec")
        except SyntaxError:  # inside an f-string
            continue
        found.append(fault)
    return found


def drawn(count: int, seed: int) -> list[Fault]:
    """Faults over all rooms: a file by its room in turn, then one of what it could be given."""
    rng = random.Random(seed)
    rooms: dict[str, list[Path]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        inner = path.relative_to(PACKAGE).parts
        rooms.setdefault(inner[0] if len(inner) > 1 else "", []).append(path)
    order = sorted(rooms)
    rng.shuffle(order)
    faults: list[Fault] = []
    while len(faults) < count:
        files = rooms[order[len(faults) % len(order)]]
        weights = [len(path.read_bytes()) for path in files]
        possible = drawable(rng.choices(files, weights)[0])
        if possible:
            faults.append(rng.choice(possible))
    return faults


def by_hand() -> list[Fault]:
    """The faults of mutants.toml; one whose text is gone or stands twice is named."""
    faults = []
    for fault in tomllib.loads((ROOT / "benchmarks" / "mutants.toml").read_text())["fault"]:
        path = ROOT / fault["file"]
        text = path.read_text()
        if text.count(fault["old"]) != 1:
            sys.exit(f"{fault['file']}: {fault['old']!r} is there {text.count(fault['old'])} times")
        start = text.index(fault["old"])
        faults.append(Fault(path, start, start + len(fault["old"]), fault["new"]))
    return faults


def tests_of(room: str, tree: Path) -> list[str]:
    """Paths of the tests of a room, in a tree."""
    names = TESTS.get(room, f"tests/{room}").split()
    return [str(path) for name in names for path in sorted(tree.glob(name))]


def noticed(fault: Fault, tree: Path, marks: str, limit_s: float) -> str:
    """`noticed`, `timeout` (noticed, too) or `missed`, by a room's tests in a copy of the tree."""
    target = tree / fault.path.relative_to(ROOT)
    good = target.read_text()
    target.write_text(fault.text())
    try:
        done = subprocess.run(
            [sys.executable, "-B", "-m", "pytest", "-x", "-m", marks, *tests_of(fault.room, tree)],
            cwd=tree,
            env=os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
            capture_output=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "timeout"
    finally:
        target.write_text(good)
    if done.returncode not in (0, 1, 2, 3, 4):
        sys.exit(f"pytest could not run: {done.stdout.decode()[-2000:]}")
    return "missed" if done.returncode == 0 else "noticed"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--slow", action="store_true", help="the slow tests, too")
    parser.add_argument("--limit-s", type=float, default=900, help="a fault's tests may take")
    arguments = parser.parse_args()
    marks = "not evidence" if arguments.slow else "not slow and not evidence"
    faults = by_hand() + drawn(arguments.count, arguments.seed)
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(tree)], check=True)
        for fault in faults:
            begun = time.monotonic()
            found = noticed(fault, tree, marks, arguments.limit_s)
            missed += found == "missed"
            print(f"{found:8} {time.monotonic() - begun:5.0f} s  {fault.row()}", flush=True)
    print(f"{len(faults) - missed} of {len(faults)} noticed")


if __name__ == "__main__":
    main()
