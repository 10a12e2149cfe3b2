"""`deltact-fab gel`: mechanics of the skin."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click

from ..catalog import validate
from ..errors import InputError, RunFailed
from ..levels import LEVELS
from . import gel_options
from .gel_fit import fit
from .gel_path import path
from .group import CommandGroup
from .options import JSON
from .output import echo_json, progress

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
@JSON
def press(
    indenter: str, depth_mm: float, shear_x_mm: float, shear_y_mm: float,
    at_mm: tuple[float, float], model: str, thickness_mm: float, width_mm: float, length_mm: float,
    modulus_mpa: float, poisson: float, friction: float, tolerance: float,
    spacing_mm: float | None, limit_s: float, as_json: bool,
) -> None:  # fmt: skip
    """Force, contact area and in-plane displacement of one press (simulated).

    Chooses level, mesh and steps to meet the tolerance, says what it chose, and estimates the
    error. Exit code 1 when the press is refused or does not converge.
    """
    from ..elasticity.material import GelMaterial
    from ..gel.press import press as run
    from ..gel.press import refused
    from ..shapes.indenter import parse

    try:
        skin = gel_options.block(width_mm, length_mm, thickness_mm)
        material = validate(
            GelMaterial,
            {"modulus_mpa": modulus_mpa, "poisson": poisson, "friction": friction},
            "options",
        )
        shape = parse(indenter)
        with progress("gel press") as report:
            pressed = run(
                skin, material, shape, at_mm, depth_mm, (shear_x_mm, shear_y_mm),
                model, tolerance, spacing_mm, report, limit_s,  # click.Choice
            )  # fmt: skip
    except InputError as why:
        if as_json:
            echo_json(refused(depth_mm, model, str(why)).result)
        raise
    result = pressed.result
    if as_json:
        echo_json(result)
    if not result["converged"]:
        raise click.exceptions.Exit(1) if as_json else RunFailed(result["reason"])
    if not as_json:
        for line in _lines(result):
            click.echo(line)
    for flag in result["flags"]:
        click.echo(f"warning: {flag}", err=True)


def _lines(result: dict[str, Any]) -> Iterator[str]:
    fx, fy, fz = result["force_n"]
    estimate, picked = result["error_estimate"], result["picked"]
    yield (
        f"force on the sensor: {fx:+.3f} {fy:+.3f} {fz:+.3f} N (simulated), error about "
        f"{100 * estimate['force_rel']:.2g} %"
    )
    stretch = result["max_stretch"]
    yield (
        f"contact {result['contact_area_mm2']:.3g} mm² ± {result['contact_area_error_mm2']:.2g}, "
        f"sticking {result['stick_area_mm2']:.3g} mm² ± {result['stick_area_error_mm2']:.2g}, its "
        "middle at ({:.2f}, {:.2f}) mm".format(*result["centroid_mm"])
    )
    yield (
        "in plane at most "
        f"{result['peak_in_plane_mm']:.3f} mm, error about {estimate['displacement_mm']:.2g} mm rms"
        + (f", stretch up to {stretch:.2f}" if stretch else "")
    )
    yield f"chosen: {picked['why']}; {picked['dofs']} unknowns, {result['seconds']:.1f} s"


gel.add_command(fit)
gel.add_command(path)
