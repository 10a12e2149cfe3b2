"""`cad check`: what the built solids are, held against what the sensor needs; one table.

built.py makes solids and meshes, the other files hold one kind of check each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ...aliases import Progress
from ...errors import RunFailed
from ..design import IndenterList
from ..dimensions import Design
from ..kernel import guarded
from ..registry import listed
from . import arithmetic, each_part, together, visibility
from .built import BuiltDesign, Facts, PartMissing
from .row import NOT_RUN, Row, advised, verified

CHECKS: dict[str, Callable[[BuiltDesign], Iterable[Row]]] = {
    "drawings": each_part.drawings,
    "one valid closed solid": each_part.soundness,
    "envelope": together.envelope,
    "interference": together.interference,
    "engagement": together.engagement,
    "wall thickness": each_part.walls,
    "bed contact": each_part.printed,
    "plate deflection": lambda built: arithmetic.bending(built.design),
    "light cone": visibility.light_cone,
    "mold volume closure": together.closure,
    "bench clear": together.bench,
    "indenter height field": each_part.height_fields,
}
"""Each kind of check on solids by the name that its row has when it cannot be made."""
ARITHMETIC = (arithmetic.inequalities, arithmetic.fits, arithmetic.light, visibility.view)


def run(
    design: Design,
    progress: Progress | None = None,
    indenters: IndenterList | None = None,
    cached: bool = False,
) -> list[Row]:
    """Check a design: inequalities first, then every part and the whole as built.

    progress: called with (done, total, what) before each part that is built and each check.
    indenters: cad/indenters.toml when None. cached: what earlier checks found on parts that are the
    same is used, and what is found kept; when nothing is missing the CAD kernel is not imported.

    What fails is a row, a broken inequality and a part that cannot be built among them; one more
    row counts the checks that it leaves undone. Raises MissingLibrary without the CAD kernel, and
    InputError when the list of indenters is unusable.
    """
    rows = [r for told in ARITHMETIC for r in verified(advised(told, design), design)]
    if not all(row.passed for row in rows if row.check == "inequalities"):
        return [*rows, not_run(len(CHECKS), "inequalities fail, see above")]
    rows += verified(arithmetic.platform(design), design)
    done = 0

    def tell(what: str) -> None:
        nonlocal done
        if progress is not None:
            progress(done, total, what)
        done += 1

    facts = Facts() if cached else None
    built = BuiltDesign(design, tuple(listed(indenters, design)), facts=facts, tell=tell)
    total = len(built.parts) + len(CHECKS)
    rows += of_built(built, tell)
    if facts is not None:
        facts.save()
    if progress is not None:
        progress(total, total, "done")
    return rows


def of_built(
    built: BuiltDesign,
    tell: Callable[[str], None] | None = None,
    checks: Iterable[str] = CHECKS,
) -> list[Row]:
    """The checks on what is built; one row counts those that lack a part which cannot be built.

    Any other check that cannot be made is a failing row.
    """
    rows: list[Row] = []
    undone = []
    for check in checks:
        if tell is not None:
            tell(check)
        try:
            with guarded(check):
                rows += verified(CHECKS[check](built), built.design)
        except PartMissing as why:
            undone.append(str(why))
        except RunFailed as why:
            rows.append(Row(check, "", f"not run: {why}", "can be made", False))
    if undone:
        rows.append(not_run(len(undone), "; ".join(dict.fromkeys(undone))))
    return rows


def not_run(count: int, why: str) -> Row:
    """What a failure that has its own row left undone."""
    return Row(NOT_RUN, "assembly", f"{count} were not run: {why}", "all of them", False)
