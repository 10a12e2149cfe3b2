"""Random wishes, solved and checked as by `cad new`: `python -m benchmarks.cad_random`.

Each is drawn from its own seed: a face from a fingertip's to the palm's, a share, a gel, a camera,
a mount and a side for the cable. What is written must pass every row of `cad check`. A refused wish
is given to a grid over all choices of the solver (`find_by_grid`), which knows no remedies: at
least WRITTEN_SHARE of the wishes that can be met must be written. An exception of any other kind is
a fault. Lines of cad-random.jsonl whose code is unchanged are kept, so that an interrupted run goes
on where it stopped; the table is docs/evidence/cad-random.md.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, fields, replace
from itertools import product
from pathlib import Path
from typing import Any

from deltact_fab.common import digest
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.design import load_cameras, load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.intent import Choices, Wish, build_design, failed_checks
from deltact_fab.fabricate.cad.solution import solve_wish
from deltact_fab.sensor import ShapeError

HERE = Path(__file__).resolve().parent
LINES = HERE / "cad-random.jsonl"
TABLE = HERE.parent / "docs" / "evidence" / "cad-random.md"
SEED = 230_000
WISHES = 300
WRITTEN_SHARE = 0.8
SHOWN = 8  # rows of the table
FACE_MM, GEL_MM, SHARE = (14.0, 80.0), (2.0, 16.0), (0.3, 0.7)
HOLES = ("30x30 M3", "circle 50 6xM4", "ISO 9409-1-50-4-M6")
# The grid: every way to meet a wish that differs by more than a repair would.
GAPS_MM, SHEETS_MM, AXIAL_MM = (3, 4.5, 7, 11, 17, 26, 38), (2.0, 4.0, 8.0), (1.0, 4.0)
HOUSINGS_MM, LED_SHARES = (0.0, 6.0, 14.0, 26.0), (1.0, 0.75)


def numbers() -> list[tuple[str, float, float, float, bool]]:
    """(key, default, low, high, whole) of every number of a design."""
    rows = []
    for section in fields(Design()):
        record = getattr(Design(), section.name)
        for f in fields(record):
            if "ge" in f.metadata:
                default, ends = getattr(record, f.name), (f.metadata["ge"], f.metadata["le"])
                key = f"{section.name}.{f.name}"
                rows.append((key, float(default), *ends, isinstance(default, int)))
    return rows


def drawn(index: int) -> Wish:
    """The wish of an index."""
    rng = random.Random(SEED + index)
    low, high = (math.log(side) for side in FACE_MM)
    width, length = (round(math.exp(rng.uniform(low, high))) for _ in "xy")
    # Long strips are seldom wished for.
    length = min(max(length, round(width / 2)), 2 * width)
    gel_mm = round(rng.uniform(*GEL_MM), 1) if rng.random() < 0.5 else None
    camera = rng.choice([None, *load_cameras()])
    holes = rng.choice(HOLES) if rng.random() < 0.3 else None
    side = rng.choice(["+x", "-x"]) if rng.random() < 0.15 else None
    share = round(rng.uniform(*SHARE), 2)
    return Wish.parse(f"{width}x{length}", share, camera, gel_mm, holes, side)


def altered(design: Design, index: int) -> Design:
    """The design with up to four further numbers between 0.7 and 1.4 of theirs.

    Raises InputError for a number out of its bounds.
    """
    rng = random.Random(SEED + index)
    for key, default, low, high, whole in rng.sample(numbers(), rng.randint(0, 4)):
        section, _, name = key.partition(".")
        value = min(max(default * rng.uniform(0.7, 1.4), low), high)
        changed = {name: round(value) if whole else round(value, 3)}
        try:
            section_changed = replace(getattr(design, section), **changed)
        except ShapeError as error:
            raise InputError(str(error)) from error
        design = replace(design, **{section: section_changed})
    return design


def find_by_grid(wish: Wish, base: Design) -> Choices | None:
    """The first choices of the grid that meet a wish by arithmetic, without any remedy."""
    gels = (0.0,) if wish.gel_mm else (0.0, 16.0)
    least = build_design(wish, Choices(), base)
    sides = least.frame_outer_mm
    deepest = build_design(wish, Choices(max(gels), SHEETS_MM[-1], GAPS_MM[-1]), base)
    if deepest.camera.nearest_mm > deepest.eye_distance_mm + deepest.camera.lens_height_mm:
        return None  # no choice focuses
    housings = [(sides[0] + a, sides[1] + b) for b in (0.0, 20.0) for a in HOUSINGS_MM]
    board = (least.camera.board_width_mm, 2 * least.camera.board_top_mm)
    housings += [(max(*sides, *board) + a,) * 2 for a in HOUSINGS_MM]
    grid = product(
        gels, GAPS_MM, SHEETS_MM, AXIAL_MM, (1.0, 0.85), (8.0, 5.0), housings, (0.0, 1.5)
    )
    for gel, gap, sheet, axial, share, strip, housing, ledge in grid:
        choices = Choices(gel, sheet, gap, axial, 2, strip, 1, 1, share, housing, ledge)
        try:
            design = build_design(wish, choices, base)
        except ShapeError:
            continue
        most = int(2 * math.pi * max(design.strip_radius_mm, 0) / design.light.cut_mm)
        for cuts in {max(int(most * part), 1) for part in LED_SHARES}:
            choices = replace(choices, cuts=cuts)
            led_count = cuts * design.light.leds_per_cut
            design = replace(design, light=replace(design.light, led_count=led_count))
            if next(failed_checks(design, wish), None) is None:
                return choices
    return None


def outcome(index: int) -> dict[str, Any]:
    """What became of a wish: written, failing, refused, infeasible or fault."""
    wish, began, base = drawn(index), time.process_time(), load_design()
    result: dict[str, Any] = {"index": index, "wish": asdict(wish), "outcome": "written"}
    try:
        solution = solve_wish(wish, base, "wish", advise=False)
        if rows := solution.verdict.failed:
            result |= {"outcome": "failing", "rows": [[r.id, r.value, r.limit] for r in rows]}
    except InputError as error:
        choices = find_by_grid(wish, base)
        kind = "infeasible" if choices is None else "refused"
        result |= {"outcome": kind, "line": str(error), "grid": choices and asdict(choices)}
    except Exception:
        result |= {"outcome": "fault", "line": traceback.format_exc()}
    return {**result, "cpu_s": round(time.process_time() - began, 2)}


def source() -> str:
    """The digest of the code behind the outcomes."""
    return digest.code_digest("fabricate.cad.solution") + digest.code_digest(
        "cad_random", package=HERE
    )


def kept() -> dict[int, dict[str, Any]]:
    """Outcomes of the present code by index."""
    if not LINES.exists():
        return {}
    lines = [json.loads(line) for line in LINES.read_text().splitlines()]
    return {line["index"]: line for line in lines if line["source"] == source()}


def written_share(outcomes: list[dict[str, Any]]) -> float:
    """Share of the wishes that can be met that were written and pass."""
    kinds = Counter(o["outcome"] for o in outcomes)
    return kinds["written"] / max(len(outcomes) - kinds["infeasible"], 1)


def table(outcomes: list[dict[str, Any]]) -> str:
    """The outcomes in words and a table."""
    kinds = Counter(o["outcome"] for o in outcomes)
    rows = Counter(row[0] for o in outcomes for row in o.get("rows", ()))
    reasons = Counter(
        o["line"].partition(" mm: ")[2].partition(":")[0]
        for o in outcomes
        if o["outcome"] in ("refused", "infeasible")
    )
    seconds = sorted(o["cpu_s"] for o in outcomes)
    counts = Counter({f"{name} (fails on solids)": n for name, n in rows.items()})
    counts += Counter({f"{name} (refused)": n for name, n in reasons.items()})
    return "\n".join(
        [
            "# Random wishes",
            "",
            "Written by `python -m benchmarks.cad_random` (`make evidence`); do not edit.",
            "",
            f"{len(outcomes)} wishes from seed {SEED} on: {kinds['written']} are written and pass "
            f"every row of `cad check`, {kinds['failing']} are written with failed rows at their "
            f"head, {kinds['refused']} are refused though a grid of choices meets them by "
            f"arithmetic, {kinds['infeasible']} are refused and no choice of the grid meets them, "
            f"{kinds['fault']} end otherwise. Of those that can be met "
            f"{100 * written_share(outcomes):.0f} % are written (at least "
            f"{100 * WRITTEN_SHARE:.0f} % required).",
            "",
            f"CPU time of a wish, with its check: median {seconds[len(seconds) // 2]:.1f} s, at "
            f"most {seconds[-1]:.1f} s.",
            "",
            "| reason | wishes |",
            "|---|---|",
            *(f"| {name} | {count} |" for name, count in counts.most_common(SHOWN)),
            "",
            f"All outcomes: `benchmarks/{LINES.name}`.",
            "",
        ]
    )


def run(wishes: int, seconds: float) -> Iterator[dict[str, Any]]:
    """Outcomes, those of an earlier run first; stops when the time is over."""
    done, began = kept(), time.monotonic()
    for index in range(wishes):
        if index not in done and time.monotonic() - began < seconds:
            done[index] = {**outcome(index), "source": source()}
            LINES.write_text("".join(json.dumps(done[i]) + "\n" for i in sorted(done)))
        if index in done:
            yield done[index]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wishes", type=int, default=WISHES)
    parser.add_argument("--limit-s", type=float, default=float("inf"))
    options = parser.parse_args()
    done = []
    for result in run(options.wishes, options.limit_s):
        done.append(result)
        print(result["index"], result["outcome"], result["cpu_s"], flush=True)
    TABLE.write_text(table(done))


if __name__ == "__main__":
    main()
