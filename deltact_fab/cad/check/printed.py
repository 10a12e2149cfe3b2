"""How printed parts stand on the platform, and what of them hangs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

from ..part import Part
from ..print_orientation import MIN_CONTACT_MM2, Stand, laid, stand
from .built import BuiltDesign
from .row import Row

CONTACT, CEILINGS = "bed contact", "ceilings"


def rows(built: BuiltDesign) -> Iterator[Row]:
    """What each part that stands straight has on the platform, and the ceilings of every part.

    One that nothing supports may span what the printer bridges.
    """
    for part in built.parts:
        if part.printed:
            yield from _of_part(built, part)


def _of_part(built: BuiltDesign, part: Part) -> Iterator[Row]:
    kept = built.fact(
        CONTACT, (part.name,), lambda: asdict(stand(laid(built.mesh(part.name), part.lies)))
    )
    on = Stand(**kept)
    if not part.lies.tilt_deg:
        limit = f">= {MIN_CONTACT_MM2:g} mm2"
        passed = on.contact_mm2 >= MIN_CONTACT_MM2
        yield Row(CONTACT, part.name, f"{on.contact_mm2:.1f} mm2", limit, passed)
    if on.ceilings_mm2:
        span_mm = built.design.resin_printer.ceiling_span_mm
        limit = f"<= {span_mm:g} mm across (resin_printer.ceiling_span_mm), or on supports"
        passed = bool(part.lies.supports) or on.span_mm <= span_mm
        yield Row(CEILINGS, part.name, on.words(part.lies.supports), limit, passed)
