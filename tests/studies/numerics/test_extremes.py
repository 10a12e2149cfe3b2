"""The map of extremes: stored rows are of the cells of now, and those drawn anew are compared."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.gel_strangers import stored
from benchmarks.raytraced import LAWS, Lens, true_motion_mm
from benchmarks.traced import GEL, IMAGED, SKIN, STATES, FaceSpline
from deltact_fab.app.cli.numerics import numerics
from deltact_fab.common.errors import RunFailed
from deltact_fab.present import write_numerics_page
from deltact_fab.studies.numerics import extremes, traced
from deltact_fab.studies.numerics.engine import Case, Flagged, judge
from deltact_fab.studies.numerics.engines import gel
from deltact_fab.studies.numerics.harness import ENGINE_MODULES, load_engine


@pytest.mark.parametrize("name", ENGINE_MODULES)
def test_stored_map_has_all_cells(name: str) -> None:
    cells = load_engine(ENGINE_MODULES[name]).extremes()
    rows, about = extremes.stored_rows([name])
    assert {r["case"] for r in rows} == {c.name for c in cells}
    assert [r["case"] for r in rows if r["outcome"] == "wrong"] == []
    assert all((r["chart"], r["row"], r["column"]) != ("", "", "") for r in rows)
    # A right cell has an error; where an outside answer exists it is within what is stated.
    assert all(r["figure"] <= r["bound"] for r in rows if r["outcome"] == "right")
    assert about["date"]


def test_map_spans_outcomes() -> None:
    rows, _ = extremes.stored_rows(list(ENGINE_MODULES))
    counts = Counter(r["outcome"] for r in rows)
    assert len(rows) > 250
    assert min(counts[name] for name in ("right", "flagged", "refused")) >= 5
    assert sum(r["outside"] for r in rows) > 0.5 * len(rows)


def test_drawn_cells_follow_the_seed() -> None:
    cells = {"gel": gel.extremes(), "none": ()}
    first, again, other = (extremes.draw(cells, False, seed) for seed in (1, 1, 2))
    assert [c.name for c in first["gel"]] == [c.name for c in again["gel"]]
    assert [c.name for c in first["gel"]] != [c.name for c in other["gel"]]
    assert len(first["gel"]) == -(-len(cells["gel"]) // 10)
    assert first["none"] == []
    assert sum(map(len, extremes.draw(cells, True, 1).values())) == 1
    assert extremes.draw({"none": ()}, True, 1) == {"none": []}


def test_another_outcome_than_stored_is_wrong() -> None:
    stored_rows = [{"engine": "e", "case": c, "outcome": "flagged", "note": ""} for c in "abc"]
    anew = [{"engine": "e", "case": "a", "outcome": "flagged", "note": "x"},
            {"engine": "e", "case": "b", "outcome": "right", "note": "y"}]  # fmt: skip
    rows = extremes.update(stored_rows, anew)
    assert [(r["outcome"], r["anew"]) for r in rows] == [
        ("flagged", True), ("wrong", True), ("flagged", False)
    ]  # fmt: skip
    assert rows[1]["note"] == "stored as flagged, now right: y"


@pytest.mark.parametrize("late", ["stored", "anew"])
def test_outcomes_by_time_are_not_compared(late: str) -> None:
    """How far a press gets in the limit is the machine's; a wrong answer stays wrong."""
    notes = {"stored": "", "anew": "", late: f"{extremes.OUT_OF_TIME} 15"}
    stored_row = {"engine": "e", "case": "a", "outcome": "flagged", "note": notes["stored"]}
    for outcome in ("refused", "right", "wrong"):
        new = {"engine": "e", "case": "a", "outcome": outcome, "note": notes["anew"]}
        assert [r["outcome"] for r in extremes.update([stored_row], [new])] == [outcome]


def test_flagged_is_told_from_refused(tmp_path: Path) -> None:
    def fail(error: Exception) -> float:
        raise error

    def outcome(error: Exception) -> str:
        cell = ("chart", "row", "column")
        case = Case(
            "c", "right or refused", lambda _: fail(error), 1.0, says="deep|steep", cell=cell
        )
        return str(judge(case, tmp_path)["outcome"])

    assert outcome(Flagged("too steep")) == "flagged"
    assert outcome(RunFailed("too deep")) == "refused"
    assert outcome(RunFailed("no disk")) == "wrong"


def test_gel_error_over_stated_is_wrong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A truth that is 10 % elsewhere makes the cell wrong."""
    monkeypatch.setattr(gel, "CELL_LIMIT_S", 120.0)  # a fresh clone compiles within it
    truth = gel.load_truths()[0]
    force = (0.0, 0.0, 1.1 * truth.force_n[2])
    for press, outcome in ((truth, "right"), (gel.replace(truth, force_n=force), "wrong")):
        cell = gel.ExtremePress("chart", "row", "column", press, "depth", outside=True)
        case = Case("c", "right or refused", cell.check, 1.0, says="flagged")
        assert judge(case, tmp_path)["outcome"] == outcome


def test_stored_truths_are_the_ray_tracers() -> None:
    lens, presses = Lens(), traced.TracedPresses.load()
    truth = list(stored(GEL).values())[IMAGED // len(STATES)]
    motion = FaceSpline.of(truth, STATES[IMAGED % len(STATES)])
    points = np.stack(np.meshgrid(presses.x_mm, presses.y_mm), axis=-1)[::7, ::7]
    shift = true_motion_mm(lens, motion, points)  # type: ignore[arg-type]
    known = presses.shift[presses.imaged][::7, ::7] * traced.UNIT_MM
    np.testing.assert_allclose(known, shift, atol=0.6 * traced.UNIT_MM)
    index = np.stack(np.meshgrid(*map(np.arange, SKIN.corners)), -1).reshape(-1, 2)
    flat = np.column_stack((SKIN.at_mm(index), np.zeros(len(index))))
    px = traced.load()["equisolid skin"]
    seen = np.isfinite(px[:, 0])
    other = Lens(law=LAWS["equisolid"]).project_px(flat)
    np.testing.assert_allclose(px[seen], other[seen], atol=1e-9)


def test_traced_flow_has_its_noise() -> None:
    presses = traced.TracedPresses.load()
    clean, noisy = (presses.flow(4, noise_px=n) for n in (0.0, 0.1))
    off_px = (noisy.shift_mm - clean.shift_mm) / traced.TRACED_VIEW.mm_per_px
    assert off_px.std() == pytest.approx(0.1, rel=0.05)


def test_page_warns_of_a_stale_map(tmp_path: Path) -> None:
    cell = {"engine": "e", "case": "a", "chart": "c", "row": "r", "column": "1", "anew": False,
            "outcome": "right", "figure": 0.5, "outside": True}  # fmt: skip
    meta: dict[str, Any] = {"machine": {"processor": "", "cores": 1}, "quick": True, "seconds": 1.0,
                            "versions": {"deltact-fab": "0"}, "seed": 3}  # fmt: skip
    engine = {"name": "e", "title": "E", "about": "About."}
    texts = []
    for stale in ([], ["e"]):
        meta["map"] = {"stale": stale, "date": "2026-01-02", "digests": {"e": "f00"}}
        data = {"engines": [engine], "curves": [], "stability": [], "extremes": [cell],
                "meta": meta}  # fmt: skip
        texts.append(write_numerics_page(data, tmp_path / "page.html").read_text())
    assert "1 stored, 0 computed for this page" in texts[0]
    words = "The stored map of e is of other code"
    assert [words in text for text in texts] == [False, True]
    assert ['class="verdict warn"' in text for text in texts] == [False, True]


def test_help_names_every_engine() -> None:
    assert numerics.help is not None
    assert [name for name in ENGINE_MODULES if name not in numerics.help] == []
