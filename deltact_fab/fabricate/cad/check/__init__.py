"""`cad check`: compare the built solids with the requirements of the sensor; one table.

built.py makes solids and meshes, each other file holds one kind of check.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from deltact_fab.common import Check, Progress, RunFailed

from ..design import IndenterList
from ..dimensions import Design
from ..kernel import guarded
from ..registry import list_parts
from . import arithmetic, each_part, together, visibility
from .built import BuiltDesign, Facts, PartMissing
from .row import PAPER_BASES, Bases, add_remedies, fails, mark_unverified, name_culprits

SOLID_CHECKS: dict[str, tuple[str, Callable[[BuiltDesign], Iterable[Check]]]] = {
    "drawings": ("drawings", each_part.drawings),
    "soundness": ("one valid closed solid", each_part.soundness),
    "envelope": ("envelope", together.envelope),
    "interference": ("interference", together.interference),
    "engagement": ("engagement", together.engagement),
    "wall-thickness": ("wall thickness", each_part.walls),
    "bed-contact": ("bed contact", each_part.platform_contact),
    "plate-deflection": ("plate deflection", lambda model: arithmetic.bending(model.design)),
    "light-cone": ("light cone", visibility.light_cone),
    "mold-closure": ("mold volume closure", together.closure),
    "bench-clear": ("bench clear", together.bench),
    "height-fields": ("indenter height field", each_part.height_fields),
}
"""Each kind of check on solids: id, and name of its row if it cannot run."""
PER_PART_CHECKS = ("drawings", "wall-thickness", "bed-contact")
"""Checks of SOLID_CHECKS whose rows need no part but their subject."""
ARITHMETIC_CHECKS = (
    arithmetic.inequalities,
    arithmetic.fits,
    arithmetic.stock,
    arithmetic.light,
    visibility.view,
)


def check_design(
    design: Design,
    progress: Progress | None = None,
    indenters: IndenterList | None = None,
    cached: bool = False,
    bases: Bases = PAPER_BASES,
) -> list[Check]:
    """Check a design: inequalities first, then every part and the whole as built.

    progress: called with (count, total, step) before each part that is built and each check.
    indenters: cad/indenters.toml if None. cached: reuse results of earlier checks on unchanged
    parts and store new ones; when nothing is missing the CAD kernel is not imported. bases: as in
    `reference_designs`, for the remedies.

    Every failure is a row, also a broken inequality and a part that cannot be built; one more
    row counts the checks skipped because of it. Raises MissingLibrary without the CAD kernel, and
    InputError when the list of indenters is unusable.
    """
    rows = check_arithmetic(design, bases)
    if any(row.failed for row in rows if row.name == "inequalities"):
        return [*rows, not_run(len(SOLID_CHECKS), "constraints fail, see above")]
    platform = name_culprits(
        arithmetic.platform(design),
        design,
        lambda changed, row: not fails(arithmetic.platform(changed), row),
        bases,
    )
    rows += mark_unverified(platform, design)
    started = 0

    def report(step: str) -> None:
        nonlocal started
        if progress is not None:
            progress(started, total, step)
        started += 1

    facts = Facts() if cached else None
    parts = tuple(list_parts(indenters, design))
    model = BuiltDesign(design, parts, facts=facts, report=report, bases=bases)
    total = len(model.parts) + len(SOLID_CHECKS)
    rows += check_solids(model, report)
    if facts is not None:
        facts.save()
    if progress is not None:
        progress(total, total, "done")
    return rows


def check_arithmetic(design: Design, bases: Bases = PAPER_BASES) -> list[Check]:
    """Run the checks that need no solids."""
    rows: list[Check] = []
    for checks in ARITHMETIC_CHECKS:
        rows += mark_unverified(add_remedies(checks, design, bases), design)
    return rows


def check_solids(
    model: BuiltDesign,
    report: Callable[[str], None] | None = None,
    checks: Iterable[str] = SOLID_CHECKS,
) -> list[Check]:
    """Run the checks on solids; one row counts those skipped for a part that cannot be built.

    Any other check that cannot run is a failing row.
    """
    rows: list[Check] = []
    undone = []
    trials: dict[Design, BuiltDesign] = {}
    for id in checks:
        name, check = SOLID_CHECKS[id]
        if report is not None:
            report(name)
        try:
            with guarded(name):
                results = list(check(model))
        except PartMissing as error:
            undone.append(str(error))
            continue
        except RunFailed as error:
            results = [Check(id, name, "", f"not run: {error}", "runs", "fail")]
        passes = partial(_passes, model, trials, id)
        with_remedies = name_culprits(results, model.design, passes, model.bases)
        rows += mark_unverified(with_remedies, model.design)
    if undone:
        rows.append(not_run(len(undone), "; ".join(dict.fromkeys(undone))))
    return rows


def _passes(
    model: BuiltDesign, trials: dict[Design, BuiltDesign], id: str, changed: Design, row: Check
) -> bool:
    """Return whether the row passes on a changed design, whose solids are kept in `trials`."""
    if changed not in trials:
        parts = tuple(part for part in model.parts if part.places(changed))
        trials[changed] = BuiltDesign(changed, parts, facts=model.facts or Facts())
    trial = trials[changed]
    if id in PER_PART_CHECKS:
        subject = row.subject.partition(",")[0]
        trial = replace(trial, parts=tuple(part for part in trial.parts if part.name == subject))
    try:
        with guarded(row.name):
            return not fails(SOLID_CHECKS[id][1](trial), row)
    except RunFailed:
        return False


def not_run(count: int, reason: str) -> Check:
    """Return the row that counts checks skipped because of a failure with its own row."""
    value = f"{count} skipped: {reason}"
    return Check("solids", "checks on solids", "assembly", value, "all run", "not run")
