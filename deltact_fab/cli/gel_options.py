"""What `gel press` and `gel fit` take alike: a place, a block of gel, a file for the figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..shapes import SkinDimensions


def _point(ctx: click.Context, param: click.Parameter, value: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in value.split(","))
    except ValueError as why:
        raise click.BadParameter(f"{value!r}: two numbers in mm are needed, as in 0,0") from why
    return x, y


def _place(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    """Checked here, for what is solved before the figure is drawn may take an hour."""
    if value is not None:
        from ..gel.figure_file import require_place

        require_place(value)
    return value


at = click.option(
    "--at", "at_mm", default="0,0", show_default=True, callback=_point, help="x,y in mm."
)
plot = click.option(
    "--plot",
    "plot_path",
    type=click.Path(path_type=Path),
    callback=_place,
    help="Figure: png, svg, pdf.",
)


def block(width_mm: float, length_mm: float, thickness_mm: float) -> SkinDimensions:
    """The gel as the levels know it. Raises InputError for sizes out of range."""
    from ..catalog import validate
    from ..shapes import SkinDimensions

    return validate(
        SkinDimensions,
        {
            "width_mm": width_mm,
            "length_mm": length_mm,
            "thickness_mm": thickness_mm,
            # No level has a frame or a fillet: these need only be consistent.
            "protrusion_mm": thickness_mm,
            "edge_fillet_mm": min(2.0, thickness_mm / 2, width_mm / 4, length_mm / 4),
        },
        "options",
    )
