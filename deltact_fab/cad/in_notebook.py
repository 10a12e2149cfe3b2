"""How a part shows itself in a notebook: what it is made of and how large, and a picture."""

from __future__ import annotations

from ..errors import DeltactFabError
from ..notebook import card, drawing
from .build import build_part
from .design import load_design
from .part import Part


def html(part: Part) -> str:
    """Of the standard design; without the CAD kernel without its picture, which says so."""
    from .drafting.picture import part_svg

    design = load_design()
    low, high = part.box(part.source(design))
    sides = (f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
    note, picture, volume = "of the standard design", "", "not known"
    try:
        solid, measured = build_part(part, design)
        volume = f"{measured.volume_mm3 / 1000:.3g} cm³"
        picture = drawing(part_svg(part, design, solid))
    except DeltactFabError as why:
        note += f"; no picture: {why}"
    rows = {
        "material": part.material,
        "made by": part.making or part.process,
        "pieces": f"{part.quantity} a {'sensor' if part.per_sensor else 'lab'}",
        "box": f"{' x '.join(sides)} mm",
        "volume": volume,
    }
    return card(part.name, rows, picture, note)
