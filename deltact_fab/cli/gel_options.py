"""What `gel press` and `gel fit` take alike: a place and a block of gel."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ..catalog import validate
from .options import Point

if TYPE_CHECKING:
    from ..shapes import SkinDimensions

F = TypeVar("F", bound=Callable[..., Any])


AT = click.option(
    "--at", "at_mm", type=Point(), default="0,0", metavar="X,Y",
    help="Where it presses, mm from the centre of the face.",
)  # fmt: skip


def of_block(command: F) -> F:
    """Options that say what block of gel is pressed."""
    for option in (
        click.option("--poisson", default=0.49, metavar="NU",
                     help="Poisson's ratio of the gel."),
        click.option("--length", "length_mm", default=34.0, metavar="MM",
                     help="Length of the gel, along y."),
        click.option("--width", "width_mm", default=36.0, metavar="MM",
                     help="Width of the gel, along x."),
        click.option("--thickness", "thickness_mm", default=12.0, metavar="MM",
                     help="Thickness of the gel."),
    ):  # fmt: skip
        command = option(command)
    return command


def block(width_mm: float, length_mm: float, thickness_mm: float) -> SkinDimensions:
    """The gel as the levels know it. Raises InputError for sizes out of range."""
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
