"""The figures of the docs that come from studies: taken from result.json, never typed.

    deltact-fab study run NAME --out NAME-study
    python -m benchmarks.studies take NAME-study…    # keeps what docs show of them
    python -m benchmarks.studies                     # writes what is kept into the docs

That is docs/evidence/studies.md and the table of docs/how-to/studies.md; a test holds both to it.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from deltact_fab.common.files import write_whole
from deltact_fab.present.report.study_page import read_result
from deltact_fab.studies.study.registry import STUDIES

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "docs" / "evidence" / "studies"
PAGE = ROOT / "docs" / "evidence" / "studies.md"
HOW_TO = ROOT / "docs" / "how-to" / "studies.md"
BEGIN, END = "<!-- studies: written by python -m benchmarks.studies -->", "<!-- end of studies -->"
ORDER = ("force-calibration", "pattern-selection", "pattern-search", "shapes", "settling")
SHOWN = ("study", "title", "verdict", "headlines", "settings", "seed", "scale", "simulated",
         "missing", "versions", "made", "code")  # fmt: skip
"""Of result.json; what else stands in it is for programs."""
SENTENCES = 2
"""Sentences of a study's verdict in the table."""


def take(folder: Path) -> Path:
    """Keep what docs show of a study's folder. Raises InputError as `read_result` does."""
    read_result(folder)  # refuses what is none
    found = json.loads((folder / "result.json").read_text())
    out = KEPT / f"{found['study']}.json"
    kept = {name: found[name] for name in SHOWN if name in found}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, (json.dumps(kept, indent=1, allow_nan=False) + "\n").encode())
    return out


def kept() -> list[dict[str, Any]]:
    """What is kept, in the order of the docs."""
    paths = [KEPT / f"{name}.json" for name in ORDER]
    return [json.loads(path.read_text()) for path in paths if path.is_file()]


def page(studies: list[dict[str, Any]]) -> str:
    """docs/evidence/studies.md."""
    lines = [
        "# What the studies found",
        "",
        "Written by `python -m benchmarks.studies` from the results of `deltact-fab study run`; do "
        "not edit. Intervals are of 95 %. What is simulated says so; nothing here was measured on "
        "a real sensor. Settings, versions and remarks of each figure: the JSON of its name in "
        f"`{KEPT.relative_to(ROOT)}`.",
        "",
    ]
    for study in studies:
        lines += _section(study)
    return "\n".join(lines).rstrip() + "\n"


def block(studies: list[dict[str, Any]]) -> str:
    """The table: a study, what it says, and its command."""
    lines = [BEGIN, "| study | result |", "|---|---|"]
    for study in studies:
        words = " ".join(study["verdict"][:SENTENCES])
        simulated = " (simulated)" if study["simulated"] else ""
        if study["missing"]:
            simulated += f" (incomplete: {len(study['missing'])} jobs missing)"
        lines.append(f"| `study run {study['study']}`{simulated} | {_cell(words)} |")
    return "\n".join([*lines, END])


def with_block(readme: str, studies: list[dict[str, Any]]) -> str:
    """The page's text with its table renewed. Raises ValueError where it has none."""
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{HOW_TO.name}: the lines {BEGIN!r} and {END!r} are needed")
    return before + block(studies) + after


def _section(study: dict[str, Any]) -> list[str]:
    takes = STUDIES[study["study"]].takes
    options = [f" --{name} {study[name]:g}" for name in ("scale", "seed")
               if name in takes and study[name] is not None]  # fmt: skip
    options += [" --from RUN"] * ("seed" not in takes)
    lines = [
        f"## {study['title']}",
        "",
        f"`deltact-fab study run {study['study']}{''.join(options)}`"
        + (" (simulated)" if study["simulated"] else "")
        + f", {study['made'].partition('T')[0]}, code {study.get('code') or 'of before 0.3'}",
        "",
        " ".join(study["verdict"]),
        "",
    ]
    if study["headlines"]:
        lines += [*_table(study["headlines"]), ""]
    if study["missing"]:
        lines += [f"Missing: {', '.join(study['missing'])}.", ""]
    return lines


def _table(headlines: list[dict[str, Any]]) -> list[str]:
    columns = ["figure", "value", "95 % interval", "over"]
    with_paper = any(h["paper"] is not None for h in headlines)
    with_goal = any(h["goal"] is not None for h in headlines)
    columns += ["paper"] * with_paper + ["goal"] * with_goal
    rows = []
    for h in headlines:
        row = [h["what"], _number(h["value"], h["unit"]), _interval(h), h["over"]]
        if with_paper:
            row.append(_number(h["paper"], h["unit"]))
        if with_goal:
            row.append(_goal(h))
        rows.append("| " + " | ".join(_cell(cell) for cell in row) + " |")
    return ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns), *rows]


def _goal(headline: dict[str, Any]) -> str:
    if headline["goal"] is None:
        return ""
    bound = "<=" if headline["better"] == "low" else ">="
    said = f"{bound} {_number(headline['goal'], headline['unit'])}"
    if headline["state"] == "met":
        return said
    price = headline.get("price")
    return f"{said}: **{headline['state']}**" + (f"; {price}" if price else "")


def _interval(headline: dict[str, Any]) -> str:
    if headline["low"] is None or headline["high"] is None:
        return ""
    return f"{headline['low']:.3g} to {headline['high']:.3g}"


def _number(value: float | None, unit: str) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return f"{value:.3g} {unit}".rstrip()


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def main(words: list[str]) -> None:
    """take FOLDER…, or write both texts."""
    if words[:1] == ["take"]:
        for folder in words[1:]:
            print(take(Path(folder)))
    elif words:
        sys.exit(f"benchmarks.studies: {words[0]}: 'take FOLDER…' or nothing")
    write_whole(PAGE, page(kept()).encode())
    write_whole(HOW_TO, with_block(HOW_TO.read_text(), kept()).encode())


if __name__ == "__main__":
    main(sys.argv[1:])
