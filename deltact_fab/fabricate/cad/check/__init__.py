"""`cad check`: what the built solids are, held against what the sensor needs; one table.

built.py makes solids and meshes, the other files hold one kind of check each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from deltact_fab.common import Check, Progress, RunFailed

from ..design import IndenterList
from ..dimensions import Design
from ..kernel import guarded
from ..registry import list_parts
from . import arithmetic, each_part, together, visibility
from .built import BuiltDesign, Facts, PartMissing
from .row import add_remedies, mark_unverified

CHECKS: dict[str, tuple[str, Callable[[BuiltDesign], Iterable[Check]]]] = {
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
"""Each kind of check on solids: id and name of its row when it cannot be made."""
ARITHMETIC = (arithmetic.inequalities, arithmetic.fits, arithmetic.light, visibility.view)


def check_design(
    design: Design,
    progress: Progress | None = None,
    indenters: IndenterList | None = None,
    cached: bool = False,
) -> list[Check]:
    """Check a design: inequalities first, then every part and the whole as built.

    progress: called with (done, total, what) before each part that is built and each check.
    indenters: cad/indenters.toml when None. cached: what earlier checks found on parts that are the
    same is used, and what is found kept; when nothing is missing the CAD kernel is not imported.

    What fails is a row, a broken inequality and a part that cannot be built among them; one more
    row counts the checks that it leaves undone. Raises MissingLibrary without the CAD kernel, and
    InputError when the list of indenters is unusable.
    """
    rows = [
        r for checks in ARITHMETIC for r in mark_unverified(add_remedies(checks, design), design)
    ]
    if any(row.failed for row in rows if row.name == "inequalities"):
        return [*rows, not_run(len(CHECKS), "inequalities fail, see above")]
    rows += mark_unverified(arithmetic.platform(design), design)
    started = 0

    def tell(step: str) -> None:
        nonlocal started
        if progress is not None:
            progress(started, total, step)
        started += 1

    facts = Facts() if cached else None
    model = BuiltDesign(design, tuple(list_parts(indenters, design)), facts=facts, tell=tell)
    total = len(model.parts) + len(CHECKS)
    rows += check_solids(model, tell)
    if facts is not None:
        facts.save()
    if progress is not None:
        progress(total, total, "done")
    return rows


def check_solids(
    model: BuiltDesign,
    tell: Callable[[str], None] | None = None,
    checks: Iterable[str] = CHECKS,
) -> list[Check]:
    """The checks on what is built; one row counts those that lack a part which cannot be built.

    Any other check that cannot be made is a failing row.
    """
    rows: list[Check] = []
    undone = []
    for id in checks:
        name, check = CHECKS[id]
        if tell is not None:
            tell(name)
        try:
            with guarded(name):
                rows += mark_unverified(check(model), model.design)
        except PartMissing as error:
            undone.append(str(error))
        except RunFailed as error:
            rows.append(Check(id, name, "", f"not run: {error}", "can be made", "fail"))
    if undone:
        rows.append(not_run(len(undone), "; ".join(dict.fromkeys(undone))))
    return rows


def not_run(count: int, reason: str) -> Check:
    """The row of what a failure, which has its own row, left undone."""
    value = f"{count} were not run: {reason}"
    return Check("solids", "checks on solids", "assembly", value, "all of them", "not run")
