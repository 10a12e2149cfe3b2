"""How a part shows itself in a notebook: what it is made of and how large, and a picture."""

from __future__ import annotations

from ..errors import DeltactFabError
from ..notebook import card, drawing
from .build import expected
from .design import load_design
from .part import Part


def html(part: Part) -> str:
    """Of the standard design; without the CAD kernel without its picture, which says so."""
    from .drafting.picture import part_svg

    design = load_design()
    wanted = expected(part, design)
    low, high = wanted.box_mm
    sides = (f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
    note, picture = "of the standard design", ""
    try:
        picture = drawing(part_svg(part, design))
    except DeltactFabError as why:
        note += f"; no picture: {why}"
    rows = {
        "material": part.material,
        "made by": part.making or part.process,
        "pieces": f"{part.quantity} a {'sensor' if part.per_sensor else 'lab'}",
        "box": f"{' x '.join(sides)} mm",
        "volume": f"{sum(wanted.volume_mm3) / 2 / 1000:.3g} cm³",
    }
    return card(part.name, rows, picture, note)
