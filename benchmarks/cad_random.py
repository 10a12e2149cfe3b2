"""Random designs of the whole hardware, checked like any other: `python -m benchmarks.cad_random`.

Each is drawn from its own seed, far around the shipped designs: skins from half the paper's face to
two and a half times as much, every screw and mount, and what follows from them as a designer would
choose it (`sized`); on top of that a few numbers of any section are changed blindly, which many a
design does not bear. It must pass every row of `cad check`, or fail with rows or with one line that
name a key of the design; an exception of any other kind is a fault. Lines of
cad-random.jsonl whose code is unchanged are kept, so that an interrupted run goes on where it
stopped; the table is docs/evidence/cad-random.md.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import re
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from deltact_fab.common import digest
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad import check
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.standards import CAP_SCREWS, CapThread

HERE = Path(__file__).resolve().parent
LINES = HERE / "cad-random.jsonl"
TABLE = HERE.parent / "docs" / "evidence" / "cad-random.md"
SEED = 230_000
DESIGNS = 60
SHOWN = 8  # rows of the table
# What a design is drawn from, besides any number of it: (key, low, high).
WIDE = (
    ("skin.width_mm", 26.0, 60.0),
    ("skin.length_mm", 24.0, 56.0),
    ("skin.thickness_mm", 8.0, 20.0),
)
SHEETS_MM = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0)  # cast PMMA as it is sold
ENVELOPE = ("envelope.width_mm", "envelope.length_mm", "envelope.height_mm")


def numbers() -> list[tuple[str, float, float, float, bool]]:
    """(key, default, low, high, whole) of every number of a design."""
    design, found = Design(), []
    for section in fields(design):
        record = getattr(design, section.name)
        for f in fields(record):
            if "ge" in f.metadata:
                default = getattr(record, f.name)
                ends = f.metadata["ge"], f.metadata["le"]
                key = f"{section.name}.{f.name}"
                found.append((key, float(default), *ends, isinstance(default, int)))
    return found


def drawn(index: int) -> list[str]:
    """The changes of design `index`, as `load_design` takes them.

    A skin, a thread and a mount, then what follows from them; up to four further numbers lie
    between 0.7 and 1.4 of their default, whatever becomes of the design.
    """
    rng = random.Random(SEED + index)
    values = sized(rng, *(round(rng.uniform(low, high), 1) for _, low, high in WIDE))
    for key, default, low, high, whole in rng.sample(numbers(), rng.randint(0, 4)):
        value = min(max(default * rng.uniform(0.7, 1.4), low), high)
        values.setdefault(key, round(value) if whole else round(value, 3))
    changes = [f"{key}={value}" for key, value in values.items()]
    try:
        size = load_design("deltact", changes).outer_mm
    except InputError:
        return changes
    return changes + [f"{k}={v + 0.5:.1f}" for k, v in zip(ENVELOPE, size, strict=True)]


def sized(
    rng: random.Random, width_mm: float, length_mm: float, thickness_mm: float
) -> dict[str, Any]:
    """A design about a skin, as the shipped variants were found.

    A larger plate is cut from a thicker sheet (its bending goes with side^2 / thickness^3), often
    from one thicker still; ledges, ring and air gap leave room for what a thicker sheet may be off.
    Screws as large as the frame takes them, of lengths that are sold. Camera and light need the
    paper's housing at least, and as much more as the posts of larger screws take of it; where the
    light's ring would leave a thread of floor beside the camera's screws, wider ledges make it
    smaller.
    """
    default = Design()
    least = default.optics.acrylic_mm * (max(width_mm, length_mm) / 36.0) ** (2 / 3)
    sheet = [v for v in SHEETS_MM if v >= least - 1e-9][rng.randint(0, 1)]
    protrusion = round(thickness_mm * rng.uniform(0.4, 0.6), 1)
    room = thickness_mm - protrusion + sheet
    room -= default.screw.tip_clearance_mm + default.shell.wall_mm
    grips: list[CapThread] = [name for name, row in CAP_SCREWS.items() if 2 * row.thread_mm <= room]
    thread: CapThread = rng.choice(grips or ["M1.6"])
    row = CAP_SCREWS[thread]
    most = max(2.0, min(2.6, room / row.thread_mm))
    engagement = math.floor(10 * rng.uniform(2.0, most) * row.thread_mm) / 10
    engagement = max(engagement, 2 * row.thread_mm)
    thicker = 0.1 * (sheet - default.optics.acrylic_mm)
    depth = default.z_joint_mm - default.z_back_mm + thicker
    heads = [v for v in row.stock_mm if 12 <= v <= depth + engagement - row.head_height_mm]
    length = rng.choice(heads)
    # A tab over the cover's bosses keeps a wall of its own above them.
    boss = depth + engagement - length + default.shell.wall_mm
    table = default.table.height_mm
    table = boss + default.shell.wall_mm if 0 < table - boss < default.shell.wall_mm else table
    larger = row.bore_mm - default.screw.row.bore_mm
    wall_x = max(default.frame.wall_x_mm, (39.0 - width_mm) / 2 + larger)
    wall_y = max(default.frame.wall_y_mm, (40.0 - length_mm) / 2 + larger)
    ledge_x = default.shell.ledge_x_mm + (row.clearance_mm - row.thread_mm - 0.4) / 2
    half_x = width_mm / 2 + wall_x - default.shell.wall_mm - ledge_x
    half_y = length_mm / 2 + wall_y - default.shell.wall_mm - default.shell.ledge_mm
    ring, away = min(half_x, half_y), math.hypot(*default.camera_screw_centres_mm[0])
    narrow = default.light.wall_mm + default.head_relief_mm + default.light.fit_mm
    within = away - narrow + default.light_radius_mm - default.light_bore_mm
    ledge = default.shell.ledge_mm
    if within < ring < away + narrow and half_x < half_y:
        ledge_x += half_x - within
    elif within < ring < away + narrow:
        ledge += half_y - within
    kind = rng.choice(["block", "franka", "plate"])
    drop = 0.4 + 0.1 * sheet
    view = default.optics
    return {
        "skin.width_mm": width_mm,
        "skin.length_mm": length_mm,
        "skin.thickness_mm": thickness_mm,
        "skin.protrusion_mm": protrusion,
        "frame.wall_x_mm": round(wall_x, 2),
        "frame.seat_x_mm": round(wall_x - default.shell.wall_mm, 2),
        "frame.wall_y_mm": round(wall_y, 2),
        "frame.seat_y_mm": round(wall_y - default.shell.wall_mm, 2),
        "optics.acrylic_mm": sheet,
        "optics.air_gap_mm": round(default.optics.air_gap_mm + thicker, 2),
        # 1.4 mm of the skin's edge stay out of view on each side.
        "optics.image_width_px": min(view.image_width_px, int((width_mm - 2.8) / view.mm_per_px)),
        "optics.image_height_px": min(
            view.image_height_px, int((length_mm - 2.8) / view.mm_per_px)
        ),
        "shell.ledge_drop_mm": round(drop, 2),
        "shell.ledge_height_mm": round(drop + 1.5, 2),
        "shell.ledge_x_mm": round(ledge_x, 2),
        "shell.ledge_mm": round(ledge, 2),
        "light.axial_fit_mm": round(default.light.axial_fit_mm + thicker, 2),
        "screw.thread": thread,
        "screw.length_mm": length,
        "screw.engagement_mm": round(engagement, 1),
        "table.height_mm": round(table, 2),
        "mount.kind": kind,
        "mount.width_mm": 30.0 if kind == "franka" else default.mount.width_mm,
        "mold.columns": 2 if 2 * (width_mm + 2 * wall_x) + 24 <= 145 else 1,
        "mold.rows": 2 if 2 * (length_mm + 2 * wall_y) + 24 <= 145 else 1,
    }


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
        rows = check.check_design(load_design("deltact", changes), cached=True)
        failed = [row for row in rows if row.failed]
        if failed:
            found["outcome"] = "rows"
            found["rows"] = [[r.name, r.subject, r.value, r.limit] for r in failed]
            found["named"] = all(names_a_key(f"{r.value} {r.limit} {r.remedy}") for r in failed)
    except InputError as why:
        found |= {"outcome": "refused", "line": str(why), "named": names_a_key(str(why))}
    except Exception:
        found |= {"outcome": "fault", "line": traceback.format_exc()}
    return {**found, "cpu_s": round(time.process_time() - began, 2)}


def source() -> str:
    """The digest of the code behind the outcomes."""
    return digest.code_digest("fabricate.cad.check") + digest.code_digest(
        "cad_random", package=HERE
    )


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
            )
            + " Camera and light stay the paper's: most other skins are neither seen nor lit"
            " whole. `cad new --face` places them.",
            "",
            f"CPU time of a design: median {seconds[len(seconds) // 2]:.1f} s, at most "
            f"{seconds[-1]:.1f} s; of one that passes {sum(passed) / len(passed):.1f} s.",
            "",
            "| row | part | designs that fail it |",
            "|---|---|---|",
            *(f"| {name} | {part} | {count} |" for (name, part), count in rows.most_common(SHOWN)),
            "",
            f"{max(len(rows) - SHOWN, 0)} more rows fail at most as many each; all outcomes: "
            f"`benchmarks/{LINES.name}`.",
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
