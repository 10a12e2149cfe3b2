"""On every kind of page a warning reaches the verdict, once, and no page with one is green."""

from __future__ import annotations

import html
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from made_up_study import study

from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.common.checks import Check
from deltact_fab.common.templating import page_verdict
from deltact_fab.fabricate import export_parts, guide, select_parts
from deltact_fab.fabricate.cad.check.verdict import DesignVerdict
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns import series as job
from deltact_fab.present.report import index_page, numerics_page, page, patterns_page, study_page
from deltact_fab.present.report.first_light import render_examples as pairs
from deltact_fab.present.report.result import StudyResult

TOLD = "a made-up warning of <the test>"
WARNED = {"id": "made up", "text": TOLD, "warns": True}


@pytest.fixture
def warned_run(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Callable[[bool], Path]:
    """A run, made when it is asked for, with or without a warning in its summary."""
    kept: dict[str, Any] = {}

    def made(warned: bool) -> Path:
        mini_run: Path = request.getfixturevalue("mini_run")
        if not kept:
            kept.update(open_run(mini_run).summary())
        remarks = [one for one in kept["remarks"] if not one["warns"]]
        told = {**kept, "remarks": [*remarks, *([WARNED] if warned else [])]}
        monkeypatch.setattr(Run, "summary", lambda run: told)
        return mini_run

    made.tracked = lambda: request.getfixturevalue("tracked")  # type: ignore[attr-defined]
    return made


def run(warned: bool, out: Path, warned_run: Callable[[bool], Path]) -> Path:
    folder = warned_run(warned)
    tracked = warned_run.tracked()  # type: ignore[attr-defined]
    sure = [{**m, "coverage": 1.0, "trusted_share": 1.0, "confident_wrong_share": 0.0}
            for m in tracked.methods]  # fmt: skip
    return page.write_run_page(folder, out / "report.html", replace(tracked, methods=sure))


def imported(
    warned: bool, out: Path, warned_run: Callable[[bool], Path], percent: float = 2.0
) -> Path:
    # A copy: workers share the run.
    opened = open_run(shutil.copytree(warned_run(warned), out / "run"))
    opened.meta["imported"] = {"image_px": [8, 8], "sha256": {}}
    more = {"samples": {}, "moved_px": [0.0] * len(opened.frames())}
    opened.summary().update(more)
    (opened.folder / "analysis").mkdir(exist_ok=True)
    force = opened.folder / "analysis" / "force.json"
    models = {"best": {"normal": {"percent_of_range": percent}}}
    told = {"verdict": "normal force to 0.1 N", "left_out": [], "best": "best", "models": models}
    force.write_text(json.dumps(told))
    return page.write_imported_page(opened, out / "report.html")


def made_up_study(warned: bool, out: Path, _: Any) -> Path:
    plain = replace(study(), headlines=(), settings={StudyResult.GEL_FLAGS: TOLD} if warned else {})
    return study_page.write_study_page(plain, out / "s")


def index(warned: bool, out: Path, warned_run: Callable[[bool], Path]) -> Path:
    return index_page.write_index(warned_run(warned), out / "index.html")


def numerics(warned: bool, out: Path, _: Any) -> Path:
    case = {"engine": "a", "case": TOLD, "outcome": "wrong" if warned else "right"}
    meta = {"machine": {"processor": "", "cores": 1}, "quick": True, "seconds": 1.0,
            "versions": {"deltact-fab": "0"}, "map": {"stale": []}}  # fmt: skip
    data = {"engines": [], "curves": [], "stability": [case], "extremes": [], "meta": meta}
    return numerics_page.write_numerics_page(data, out / "numerics.html")


def patterns(warned: bool, out: Path, _: Any) -> Path:
    entries = [
        replace(entry, recipe=entry.recipe.model_copy(update={"size_mm": 7.0}))
        for entry in job.list_series(seed=3, with_dots=False)
        if entry.name in ("d0p075-r0p6", "d0p2-r0p1")
    ]
    job.write_series(out / "s", seed=3, entries=entries, page=patterns_page.write_patterns_page)
    kept = out / "s" / job.SERIES_FIGURES
    data = json.loads(kept.read_text())
    data["patterns"][0]["quality"]["seen"] = not warned
    data["patterns"][1]["quality"]["seen"] = True
    kept.write_text(json.dumps(data))
    return patterns_page.write_patterns_page(out / "s")


def rehearsal(warned: bool, out: Path, _: Any) -> Path:
    cell = {"fault": "pulled", "moment": "press", "outcome": "at rest", "deeper_mm": 0.0,
            "wrong": "", "passed": not warned}  # fmt: skip
    found = {"passed": not warned, "verdict": TOLD, "of": 1, "steps": 1, "cells": [cell]}
    return numerics_page.write_rehearsal_page(found, "smoke", "virtual", out)[0]


def fabrication_guide(warned: bool, out: Path, _: Any) -> Path:
    drawn = guide.Pictures(note=TOLD if warned else "")
    return guide.write_guide(
        measured(), out / "guide.html", examples=pairs, pictures=drawn,
        verdict=DesignVerdict("mine", (Check("a"),)),
    )  # fmt: skip


def failing_guide(warned: bool, out: Path, _: Any) -> Path:
    return guide.write_guide(
        measured(), out / "guide.html", examples=pairs,
        pictures=guide.Pictures(), verdict=verdict(warned), force=True,
    )  # fmt: skip


def verdict(fails: bool) -> DesignVerdict:
    return DesignVerdict("mine", (Check("a", TOLD, status="fail" if fails else "pass"),))


def export_index(warned: bool, out: Path, _: Any) -> Path:
    parts = select_parts(["acrylic"])
    design = load_design()
    export_parts(design, parts, ["svg"], 0.01, out, judge=lambda: verdict(warned), force=True)
    return out / "index.html"


def measured() -> Any:
    """The design with every dimension measured."""
    design = load_design()
    sections = {
        name: replace(getattr(design, name), measured=tuple(keys))
        for name, keys in unverified(design).items()
    }
    return replace(design, **sections)


def unverified(design: Any) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for key in design.unverified():
        section, _, name = key.partition(".")
        found.setdefault(section, []).append(name)
    return found


def level(written: Path) -> tuple[str, str]:
    """The verdict's level and words; the page's other text holds no warning of them again."""
    text = written.read_text()
    (shown,) = re.findall(r'<div class="verdict (\w+)">(.*?)</div>', text, re.DOTALL)
    return shown[0], html.unescape(shown[1])


@pytest.mark.parametrize(
    ("make", "says"),
    [(run, TOLD), (imported, TOLD), (made_up_study, TOLD), (index, "1 of 1 is"), (numerics, TOLD),
     (patterns, "resolves 1 of 2"), (rehearsal, TOLD), (fabrication_guide, TOLD),
     (failing_guide, TOLD), (export_index, TOLD)],
)  # fmt: skip
def test_a_warning_reaches_the_verdict_once(
    make: Any, says: str, tmp_path: Path, warned_run: Callable[[bool], Path]
) -> None:
    good, _ = level(make(False, tmp_path / "good", warned_run))
    bad, words = level(make(True, tmp_path / "bad", warned_run))
    assert good == "pass"
    assert bad in ("warn", "fail")
    assert words.lower().count(says.lower()) == 1


def test_poor_force_is_no_pass(tmp_path: Path, warned_run: Callable[[bool], Path]) -> None:
    bad, words = level(imported(False, tmp_path, warned_run, percent=60.0))
    assert bad == "warn"
    assert "normal force to 0.1 N" in words


def test_worst_is_verdict_without_duplicates() -> None:
    found = [
        Check("1", value="a"), Check("2", value="c", status="fail"),
        *Check.warnings("3", ["b"]), Check("4", value="a"),
    ]  # fmt: skip
    shown = page_verdict(found)
    assert [(check.value, check.status) for check in shown.checks] == [
        ("a", "pass"), ("c", "fail"), ("b", "warn"),
    ]  # fmt: skip
    assert shown.status == "fail"
    assert page_verdict([]).status == "pass"
