"""Map of stiff and extreme cases: stored outcomes, a share of which each page computes anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from deltact_fab.common import code_digest, read_json
from deltact_fab.paths import asset

from .engine import Case

MAP_FILE = "numerics_map.json"
SHARE_ANEW = 0.1  # by hand: of the cells of an engine
ENGINES_PACKAGE = "studies.numerics.engines"
OUT_OF_TIME = "--limit-s"  # definition: in the note of an outcome that a CPU limit decided


def draw(cells: Mapping[str, Sequence[Case]], quick: bool, seed: int) -> dict[str, list[Case]]:
    """Draw the cells that are computed anew, by engine; if quick one of all."""
    rng = np.random.default_rng(seed)
    only = rng.choice(sorted(name for name in cells if cells[name]) or [""])
    out: dict[str, list[Case]] = {}
    for name, cases in cells.items():
        count = int(name == only) if quick else math.ceil(SHARE_ANEW * len(cases))
        order = rng.permutation(len(cases))
        out[name] = [cases[i] for i in sorted(order[:count])]
    return out


def stored_rows(engines: Sequence[str]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Stored rows of these engines, and date, versions and digests of the map.

    stale: engines whose code has changed since.
    """
    data = read_json(asset(MAP_FILE))
    rows = [row for row in data.pop("rows") if row["engine"] in engines]
    stale = [
        name
        for name, digest in data["digests"].items()
        if name in engines and digest != map_digest(name)
    ]
    return rows, data | {"stale": stale}


def map_digest(engine: str) -> str:
    """Digest of the code behind an engine's cells."""
    return code_digest(f"{ENGINES_PACKAGE}.{engine}")


def update(
    stored: Sequence[dict[str, Any]], anew: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Stored rows with those computed anew in place; another outcome than stored is wrong.

    Unless a CPU limit decided one of the two: how far a press gets in it is the machine's.
    """
    fresh = {(row["engine"], row["case"]): row for row in anew}
    out = []
    for row in stored:
        new = fresh.pop((row["engine"], row["case"]), None)
        if new is None:
            out.append(row | {"anew": False})
            continue
        timed = any(OUT_OF_TIME in r["note"] for r in (row, new)) and new["outcome"] != "wrong"
        if new["outcome"] != row["outcome"] and not timed:
            note = f"stored as {row['outcome']}, now {new['outcome']}: {new['note']}"
            new = new | {"outcome": "wrong", "note": note}
        out.append(new | {"anew": True})
    return out + [row | {"anew": True} for row in fresh.values()]
