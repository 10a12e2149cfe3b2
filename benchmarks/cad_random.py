"""Random designs of the whole hardware, checked like any other: `python -m benchmarks.cad_random`.

Each is drawn from its own seed, far around the shipped designs in every section: larger and smaller
skins, other screws, mounts and lenses. It must pass every row of `cad check`, or fail with rows or
with one line that name a key of the design; an exception of any other kind is a fault. Lines of
cad-random.jsonl whose code is unchanged are kept, so that an interrupted run goes on where it
stopped; the table is docs/evidence/cad-random.md.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from deltact_fab import digest
from deltact_fab.cad import check
from deltact_fab.cad.design import load_design
from deltact_fab.cad.dimensions import Design
from deltact_fab.cad.standards import CAP_SCREWS
from deltact_fab.errors import InputError

HERE = Path(__file__).resolve().parent
LINES = HERE / "cad-random.jsonl"
TABLE = HERE.parent / "docs" / "evidence" / "cad-random.md"
SEED = 230_000
DESIGNS = 200
# What a design is drawn from, besides any number of it: (key, low, high).
WIDE = (
    ("skin.width_mm", 20.0, 60.0),
    ("skin.length_mm", 18.0, 56.0),
    ("skin.thickness_mm", 8.0, 20.0),
)
ENVELOPE = ("envelope.width_mm", "envelope.length_mm", "envelope.height_mm")


def numbers() -> list[tuple[str, float, float, float, bool]]:
    """(key, default, low, high, whole) of every number of a design."""
    design, found = Design(), []
    for section in fields(design):
        record = getattr(design, section.name)
        for f in fields(record):
            if "low" in f.metadata:
                default = getattr(record, f.name)
                ends = f.metadata["low"], f.metadata["high"]
                key = f"{section.name}.{f.name}"
                found.append((key, float(default), *ends, isinstance(default, int)))
    return found


def drawn(index: int) -> list[str]:
    """The changes of design `index`, as `load_design` takes them.

    Three of four are larger than the paper's, with room around them; up to four further numbers lie
    between 0.7 and 1.4 of their default.
    """
    rng = random.Random(SEED + index)
    values: dict[str, Any] = {}
    large = rng.random() < 0.75
    for key, low, high in WIDE:
        low = (low + high) / 2 if large else low
        values[key] = round(rng.uniform(low, high), 1)
    thread = rng.choice(list(CAP_SCREWS))
    row = CAP_SCREWS[thread]
    values |= {
        "screw.thread": thread,
        "screw.length_mm": rng.choice([v for v in row.stock_mm if 12 <= v <= 20]),
        "screw.engagement_mm": round(rng.uniform(2.0, 2.6) * row.thread_mm, 1),
        "mount.kind": rng.choice(["block", "franka", "plate"]),
    }
    for key, default, low, high, whole in rng.sample(numbers(), rng.randint(0, 4)):
        value = min(max(default * rng.uniform(0.7, 1.4), low), high)
        values.setdefault(key, round(value) if whole else round(value, 3))
    changes = [f"{key}={value}" for key, value in values.items()]
    try:
        size = load_design("deltact", changes).outer_mm
    except InputError:
        return changes
    return changes + [f"{k}={v + 0.5:.1f}" for k, v in zip(ENVELOPE, size, strict=True)]


def names_a_key(text: str) -> bool:
    """Whether a message names a number of the design, with its section or without."""
    known = {name for key, *_ in numbers() for name in (key, key.partition(".")[2])}
    known |= {name.removesuffix("_mm") for name in known}
    known |= {"screw.thread", "thread", "mount.kind", "light.led_count"}
    return any(word in known for word in re.findall(r"[a-z_0-9.]*[a-z_0-9]", text))


def outcome(index: int) -> dict[str, Any]:
    """What became of one design: passed, rows, refused or fault."""
    changes, began = drawn(index), time.process_time()
    found: dict[str, Any] = {"index": index, "changes": changes, "outcome": "passed"}
    try:
        rows = check.run(load_design("deltact", changes), cached=True)
        failed = [row for row in rows if not row.passed and not row.found.startswith("not run: an")]
        if failed:
            found["outcome"] = "rows"
            found["rows"] = [[r.check, r.part, r.found, r.limit] for r in failed]
            found["named"] = all(names_a_key(f"{r.found} {r.limit}") for r in failed)
    except InputError as why:
        found |= {"outcome": "refused", "line": str(why), "named": names_a_key(str(why))}
    except Exception:
        found |= {"outcome": "fault", "line": traceback.format_exc()}
    return {**found, "cpu_s": round(time.process_time() - began, 2)}


def source() -> str:
    """The digest of the code behind the outcomes."""
    return digest.of("cad.check.run", "cad.check.memo") + digest.of("cad_random", package=HERE)


def kept() -> dict[int, dict[str, Any]]:
    """Outcomes of the present code by index."""
    if not LINES.exists():
        return {}
    lines = [json.loads(line) for line in LINES.read_text().splitlines()]
    return {line["index"]: line for line in lines if line["source"] == source()}


def table(outcomes: list[dict[str, Any]]) -> str:
    """The outcomes in words and tables."""
    kinds = Counter(o["outcome"] for o in outcomes)
    rows = Counter(
        (row[0], row[1]) for o in outcomes for row in {tuple(r[:2]): r for r in o.get("rows", ())}
    )
    unnamed = [o["index"] for o in outcomes if not o.get("named", True)]
    seconds = sorted(o["cpu_s"] for o in outcomes)
    passed = [o["cpu_s"] for o in outcomes if o["outcome"] == "passed"] or [0.0]
    return "\n".join(
        [
            "# Random designs",
            "",
            "Written by `python -m benchmarks.cad_random` (`make evidence`); do not edit.",
            "",
            f"{len(outcomes)} designs from seed {SEED} on: {kinds['passed']} pass every row, "
            f"{kinds['rows']} fail with rows, {kinds['refused']} are refused in one line, "
            f"{kinds['fault']} end otherwise. "
            + (
                f"Of those that fail, {len(unnamed)} name no key: {unnamed}."
                if unnamed
                else "All that fail name a key."
            ),
            "",
            f"CPU time of a design: median {seconds[len(seconds) // 2]:.1f} s, at most "
            f"{seconds[-1]:.1f} s; of one that passes {sum(passed) / len(passed):.1f} s.",
            "",
            "| row | part | designs that fail it |",
            "|---|---|---|",
            *(f"| {name} | {part} | {count} |" for (name, part), count in rows.most_common()),
            "",
        ]
    )


def run(designs: int, seconds: float) -> Iterator[dict[str, Any]]:
    """Outcomes, those of an earlier run first; stops when the time is over."""
    known, began = kept(), time.monotonic()
    for index in range(designs):
        if index not in known and time.monotonic() - began < seconds:
            known[index] = {**outcome(index), "source": source()}
            LINES.write_text("".join(json.dumps(known[i]) + "\n" for i in sorted(known)))
        if index in known:
            yield known[index]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--designs", type=int, default=DESIGNS)
    parser.add_argument("--limit-s", type=float, default=float("inf"))
    asked = parser.parse_args()
    done = []
    for found in run(asked.designs, asked.limit_s):
        done.append(found)
        print(found["index"], found["outcome"], found["cpu_s"], flush=True)
    TABLE.write_text(table(done))


if __name__ == "__main__":
    main()
