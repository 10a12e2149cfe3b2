"""`deltact-fab gel fit`: the modulus of a lab's own gel, from a measured press."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from ..catalog import validate
from . import gel_options
from .options import PATH
from .output import Answer, answers, facts, progress, table


def _or_fit(ctx: click.Context, param: click.Parameter, value: str | None) -> float | str | None:
    if value is None or value == "fit":
        return value
    try:
        return float(value)
    except ValueError as why:
        what = "number of mm" if param.name == "offset_mm" else "number"
        raise click.BadParameter(f"{value!r}: a {what} or fit is needed") from why


@click.command(epilog="Example: deltact-fab gel fit measured.csv --indenter sphere:15 --offset fit")
@click.argument("csv", type=PATH)
@click.option("--indenter", required=True, metavar="NAME",
              help="What pressed, as in `gel press`: sphere:15.")  # fmt: skip
@gel_options.AT
@gel_options.of_block
@click.option("--friction", callback=_or_fit, metavar="MU|fit",
              show_default="fit where the file has a drag, else 0.5",
              help="Coefficient of friction, or fit.")  # fmt: skip
@click.option("--offset", "offset_mm", default="0", callback=_or_fit,
              metavar="MM|fit", help="depth_mm at first touch, or fit.")  # fmt: skip
@click.option("--spacing", "spacing_mm", type=float, metavar="MM", show_default="chosen",
              help="Size of the mesh below the indenter.")  # fmt: skip
@gel_options.PLOT
@answers
def fit(
    csv: Path, indenter: str, at_mm: tuple[float, float], thickness_mm: float, width_mm: float,
    length_mm: float, poisson: float, friction: float | str | None, offset_mm: float | str,
    spacing_mm: float | None, plot_path: Path | None,
) -> Answer:  # fmt: skip
    """Fit the modulus, and the friction, of a gel to a measured press, with 95 % intervals.

    Ends with the lines to copy into a protocol.

    CSV is a table with the columns depth_mm and normal_n (positive when pressed), and for a drag
    also shear_x_mm, shear_y_mm, fx_n and fy_n (the force on the sensor), its rows in the order in
    which they were measured.
    """
    from ..elasticity.material import GelMaterial
    from ..gel.fit.fit import fit_press
    from ..gel.fit.measured import read_csv
    from ..shapes.indenter import parse

    skin = gel_options.block(width_mm, length_mm, thickness_mm)
    known = friction if isinstance(friction, float) else None
    validate(GelMaterial, {"poisson": poisson, "friction": known or 0.0}, "options")
    shape = parse(indenter)
    data = read_csv(csv)
    if isinstance(offset_mm, float):
        data = replace(data, depth_mm=data.depth_mm - offset_mm)
    with progress("gel fit") as report:
        found = fit_press(
            data, skin, shape, at_mm, poisson, known,
            fit_friction=True if friction == "fit" else None, fit_offset=offset_mm == "fit",
            spacing_mm=spacing_mm, progress=report,
        )  # fmt: skip
    result = found.as_dict()
    if plot_path is not None:
        from ..gel.figures import save_fit

        save_fit(found, plot_path, f"{data.name}, {shape.name}, {thickness_mm:g} mm gel")
    told = [*table(("key", "value"), facts({**result, "notes": None})), "\n[specimen]"]
    told.append(f"modulus_mpa = {found.modulus_mpa.value:.4g}")
    if found.friction:
        told.append(f"friction = {found.friction.value:.3g}")
    return Answer(result, told, asides=result["notes"])
