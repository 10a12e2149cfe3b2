"""`deltact-fab gel`: mechanics of the skin."""

from __future__ import annotations

from pathlib import Path

import click

from ..catalog import validate
from ..levels import LEVELS
from . import gel_options
from .gel_fit import fit
from .gel_path import path
from .group import CommandGroup
from .output import Answer, answers, facts, progress, table

MODELS = ("auto", *LEVELS)


@click.group(cls=CommandGroup)
def gel() -> None:
    """Gel mechanics: press an indenter, fit the modulus, solve a protocol ahead of its run."""


@gel.command(epilog="Example: deltact-fab gel press --indenter sphere:15 --depth 5 --shear-x 3")
@click.option("--indenter", default="sphere:10", metavar="NAME",
              help="What presses: sphere:DIAMETER_MM, or 4dots, 2dots, edges, ellipsoid, hexprism, "
              "star, cylinder, ring, hat, with or without :SIZE_MM; or a shape of "
              "cad/indenters.toml.")  # fmt: skip
@click.option("--depth", "depth_mm", required=True, type=float, metavar="MM",
              help="Depth into the gel.")  # fmt: skip
@click.option("--shear-x", "shear_x_mm", default=0.0, metavar="MM",
              help="Motion along x after pressing.")  # fmt: skip
@click.option("--shear-y", "shear_y_mm", default=0.0, metavar="MM",
              help="Motion along y after pressing.")  # fmt: skip
@gel_options.AT
@click.option("--model", type=click.Choice(MODELS), default="auto",
              help="Level of the gel; auto takes the cheapest within the tolerance.")  # fmt: skip
@gel_options.of_block
@click.option("--modulus", "modulus_mpa", default=0.56, metavar="MPA",
              help="Young's modulus of the gel.")  # fmt: skip
@click.option("--friction", default=0.5, metavar="MU", help="Coefficient of friction.")
@click.option("--tolerance", default=0.03, metavar="SHARE",
              help="Relative error of the force that is allowed.")  # fmt: skip
@click.option("--spacing", "spacing_mm", type=float, metavar="MM", show_default="chosen",
              help="Size of the grid or the cells.")  # fmt: skip
@click.option("--limit-s", "limit_s", default=120.0, metavar="S", help="CPU seconds it may take; "
              "the finest mesh solved by then gives the answer.")  # fmt: skip
@gel_options.PLOT
@answers
def press(
    indenter: str, depth_mm: float, shear_x_mm: float, shear_y_mm: float,
    at_mm: tuple[float, float], model: str, thickness_mm: float, width_mm: float, length_mm: float,
    modulus_mpa: float, poisson: float, friction: float, tolerance: float,
    spacing_mm: float | None, limit_s: float, plot_path: Path | None,
) -> Answer:  # fmt: skip
    """Force, contact area and in-plane displacement of one press (simulated).

    Chooses level, mesh and steps to meet the tolerance, says what it chose, and estimates the
    error. Exit code 1 when the press is refused or does not converge.
    """
    from ..elasticity.material import GelMaterial
    from ..gel.press import press as run
    from ..shapes.indenter import parse

    skin = gel_options.block(width_mm, length_mm, thickness_mm)
    known = {"modulus_mpa": modulus_mpa, "poisson": poisson, "friction": friction}
    material = validate(GelMaterial, known, "options")
    shape = parse(indenter)
    with progress("gel press") as report:
        pressed = run(
            skin, material, shape, at_mm, depth_mm, (shear_x_mm, shear_y_mm),
            model, tolerance, spacing_mm, report, limit_s,
        )  # fmt: skip
    result = pressed.result
    flags = [f"warning: {flag}" for flag in result["flags"]]
    if not result["converged"]:
        return Answer(result, failed=result["reason"], asides=flags)
    if plot_path is not None:
        from ..gel.figures import save_press

        title = (
            f"{shape.name} {depth_mm:g} mm deep, sheared by {shear_x_mm:g}, {shear_y_mm:g} mm; "
            f"{thickness_mm:g} mm gel, {modulus_mpa:g} MPa, friction {friction:g}; "
            f"{result['model']}"
        )
        save_press(pressed, plot_path, title)
    told = table(("simulated", "value"), facts({**result, "flags": None}))
    return Answer(result, told, asides=flags)


gel.add_command(fit)
gel.add_command(path)
