"""`deltact-fab gel fit`: the modulus of a lab's own gel, from a measured press."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from ..catalog import validate
from . import gel_options
from .options import PATH
from .output import Answer, answers, progress


def _or_fit(ctx: click.Context, param: click.Parameter, value: str) -> float | None:
    """None: it is fitted."""
    try:
        return None if value == "fit" else float(value)
    except ValueError as why:
        raise click.BadParameter(f"{value!r}: a number of mm or fit is needed") from why


def _place(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    """Checked here, for what is solved before the figure is drawn may take an hour."""
    if value is not None:
        from ..gel.figures import require_place

        require_place(value)
    return value


@click.command(epilog="Example: deltact-fab gel fit measured.csv --indenter sphere:15 --offset fit")
@click.argument("csv", type=PATH)
@click.option("--indenter", required=True, metavar="NAME",
              help="What pressed, as in `gel press`: sphere:15.")  # fmt: skip
@gel_options.AT
@gel_options.of_block
@click.option("--friction", default=0.5, metavar="MU", help="Coefficient of friction.")
@click.option("--offset", "offset_mm", default="0", callback=_or_fit,
              metavar="MM|fit", help="depth_mm at first touch, or fit.")  # fmt: skip
@click.option("--spacing", "spacing_mm", type=float, metavar="MM", show_default="chosen",
              help="Size of the mesh below the indenter.")  # fmt: skip
@click.option("--plot", "plot_path", type=PATH, callback=_place, metavar="FILE",
              help="Figure to write: .png, .svg or .pdf.")  # fmt: skip
@answers
def fit(
    csv: Path, indenter: str, at_mm: tuple[float, float], thickness_mm: float, width_mm: float,
    length_mm: float, poisson: float, friction: float, offset_mm: float | None,
    spacing_mm: float | None, plot_path: Path | None,
) -> Answer:  # fmt: skip
    """Fit the modulus of a gel to a measured press, with a 95 % interval.

    CSV is a table with the columns depth_mm and normal_n (positive when pressed), its rows in the
    order in which they were measured. Friction is the side force over the normal force of a light
    drag, once it stays level.
    """
    from ..elasticity.material import GelMaterial
    from ..gel.fit.fit import fit_press
    from ..gel.fit.measured import read_csv
    from ..shapes.indenter import parse

    skin = gel_options.block(width_mm, length_mm, thickness_mm)
    validate(GelMaterial, {"poisson": poisson, "friction": friction}, "options")
    shape = parse(indenter)
    data = read_csv(csv)
    if offset_mm is not None:
        data = replace(data, depth_mm=data.depth_mm - offset_mm)
    with progress("gel fit") as report:
        found = fit_press(
            data, skin, shape, at_mm, poisson, friction,
            fit_offset=offset_mm is None, spacing_mm=spacing_mm, progress=report,
        )  # fmt: skip
    result = found.as_dict()
    if plot_path is not None:
        from ..gel.figures import save_fit

        save_fit(found, plot_path, f"{data.name}, {shape.name}, {thickness_mm:g} mm gel")
    return Answer(result, _lines(result), asides=result["notes"])


def _lines(result: dict[str, Any]) -> Iterator[str]:
    """For a reader, with the lines to copy into a protocol."""
    yield f"modulus   {_interval(result['modulus_mpa'])} MPa"
    yield f"friction  {result['friction_used']:g}, taken as known"
    if result["offset_mm"]:
        yield f"touch at  depth_mm = {_interval(result['offset_mm'])}"
    yield (
        f"residual  {result['rms_n']:.3g} N rms of {result['points']} values, "
        f"{100 * result['rms_rel']:.2g} % of the rms force; smooth part "
        f"{100 * result['trend_rel']:.2g} %"
    )
    yield f"mesh      about {100 * result['mesh_error_rel']:.2g} % of the modulus, in its interval"
    yield f"\n[specimen]\nmodulus_mpa = {result['modulus_mpa']['value']:.4g}"


def _interval(value: dict[str, float]) -> str:
    return f"{value['value']:.4g} (95 %: {value['low']:.4g} to {value['high']:.4g})"
