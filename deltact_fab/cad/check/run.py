"""Every check in the order of the table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...aliases import Progress
from ...errors import RunFailed
from ..design import IndenterList
from ..dimensions import Design
from ..kernel import guarded
from ..overhangs import MIN_CONTACT_MM2
from . import (
    bench,
    bending,
    casting,
    drawings,
    electric,
    fits,
    indenters,
    inequalities,
    pegs,
    printed,
    screws,
    soundness,
    space,
    stray_light,
    thickness,
    visibility,
)
from .built import BuiltDesign
from .row import Row, verified


@dataclass(frozen=True)
class CheckKind:
    """One kind of check; `part` and `limit` stand in the row that says it was not run."""

    name: str
    part: str
    limit: str
    rows: Callable[[BuiltDesign], Iterator[Row]]

    def found(self, built: BuiltDesign) -> list[Row]:
        """Its rows, or those found earlier for a design that gives the same ones."""
        return built.rows(self.name, lambda: verified(self.rows(built), built.design))

    def not_run(self, why: str) -> Row:
        """The failing row of a check that could not be made."""
        return Row(self.name, self.part, f"not run: {why}", self.limit, False)


CHECKS = (
    CheckKind(drawings.NAME, "every part", drawings.LIMIT, drawings.rows),
    CheckKind(soundness.NAME, "every part", soundness.LIMIT, soundness.rows),
    CheckKind("envelope", "assembly", "design.envelope", space.envelope),
    CheckKind("interference", "assembly", f"<= {space.TOUCH_MM3:g} mm3 a pair", space.interference),
    CheckKind("axes coaxial", "screws, pegs", f"<= {screws.AXIS_MM:g} mm", screws.axes),
    CheckKind("engagement", "screws", f">= {screws.ENGAGEMENT_D:g} d", screws.engagement),
    CheckKind(thickness.NAME, "printed parts", "each part's wall", thickness.rows),
    CheckKind(printed.CONTACT, "printed parts", f">= {MIN_CONTACT_MM2:g} mm2", printed.rows),
    CheckKind("snap strain", "cover, camera-holder", "cover.strain_limit", pegs.rows),
    CheckKind(bending.DEFLECTION, "acrylic", "plate.deflection_share", bending.rows),
    CheckKind("view cone", "camera", "the crop's half angle", visibility.view),
    CheckKind("light cone", "light-holder", "all rays reach the face", visibility.light_cone),
    CheckKind("LED strip length", "light-holder", "round the channel", visibility.strip),
    CheckKind(stray_light.NAME, "shell", "0 straight ways", stray_light.rows),
    CheckKind("mold volume closure", "mold, skin-frame, skin", "V(skin)", casting.closure),
    CheckKind("no undercut", "mold", "0 mm2, 0 rays", casting.undercut),
    CheckKind("frame fits its seat", "mold, skin-frame", "mold.fit_mm", casting.seat),
    CheckKind(bench.NAME, "bench", f"within {bench.AXIS_MM:g} mm", bench.rows),
    CheckKind(bench.CLEAR, "bench", "plate.depth_mm deep", bench.stack),
    CheckKind("indenters", "indenters", "stem and height field", indenters.rows),
)


def run(
    design: Design,
    progress: Progress | None = None,
    solids: Mapping[str, Any] | None = None,
    indenters: IndenterList | None = None,
    cached: bool = False,
) -> list[Row]:
    """Check a design: inequalities first, then every part and the whole as built.

    progress: called with (done, total, what) before each part that is built and each check. solids:
    by part name, to be checked in place of what would be built; they are not held against their
    closed forms. indenters: cad/indenters.toml when None. cached: rows of earlier checks are used
    where they would come out the same, and kept for the next time; when all are found the CAD
    kernel is not imported.

    What fails is a row, a broken inequality and a part that cannot be built among them; then the
    checks that need the solids say "not run". Raises MissingLibrary without the CAD kernel, and
    InputError when the list of indenters is unusable.
    """
    rows = list(inequalities.rows(design))
    possible = all(row.passed for row in rows)
    rows += verified(fits.rows(design), design)
    rows += verified(electric.rows(design), design)
    if not possible:
        return rows + [check.not_run("an inequality is broken") for check in CHECKS]
    rows += verified(fits.platform(design), design)
    done = 0

    def tell(what: str) -> None:
        nonlocal done
        if progress is not None:
            progress(done, total, what)
        done += 1

    built = BuiltDesign.make(design, solids, indenters, tell, cached)
    total = len(built.every) + len(CHECKS)
    rows += of_built(built, tell)
    if built.known is not None:
        built.known.save()
    if progress is not None:
        progress(total, total, "done")
    return rows


def of_built(
    built: BuiltDesign,
    tell: Callable[[str], None] | None = None,
    checks: Sequence[CheckKind] = CHECKS,
) -> list[Row]:
    """The checks on what is built; a check that cannot be made is a failing row."""
    rows: list[Row] = []
    for check in checks:
        if tell is not None:
            tell(check.name)
        try:
            with guarded(check.name, {}):
                rows += check.found(built)
        except RunFailed as why:
            rows.append(check.not_run(str(why)))
    return rows
