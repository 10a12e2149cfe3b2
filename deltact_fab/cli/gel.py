"""`deltact-fab gel`: mechanics of the skin."""

from __future__ import annotations

import click


def _point(ctx: click.Context, param: click.Parameter, value: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in value.split(","))
    except ValueError as why:
        raise click.BadParameter(f"{value!r}: two numbers in mm are needed, as in 0,0") from why
    return x, y


@click.group()
def gel() -> None:
    """Gel mechanics: press an indenter."""


@gel.command()
@click.option("--indenter", default="sphere:10", show_default=True)
@click.option("--depth", "depth_mm", required=True, type=float, help="mm into the gel.")
@click.option("--shear-x", "shear_x_mm", default=0.0, show_default=True, help="mm, after pressing.")
@click.option("--shear-y", "shear_y_mm", default=0.0, show_default=True, help="mm, after pressing.")
@click.option("--at", "at_mm", default="0,0", show_default=True, callback=_point, help="x,y in mm.")
@click.option("--model", type=click.Choice(["auto", "layer"]), default="auto", show_default=True)
@click.option("--thickness", "thickness_mm", default=12.0, show_default=True)
@click.option("--width", "width_mm", default=36.0, show_default=True)
@click.option("--length", "length_mm", default=34.0, show_default=True)
@click.option("--modulus", "modulus_mpa", default=0.56, show_default=True, help="Young's, MPa.")
@click.option("--poisson", default=0.49, show_default=True)
@click.option("--friction", default=0.5, show_default=True)
@click.option("--spacing", "spacing_mm", default=0.2, show_default=True, help="Grid, mm.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def press(
    indenter: str,
    depth_mm: float,
    shear_x_mm: float,
    shear_y_mm: float,
    at_mm: tuple[float, float],
    model: str,
    thickness_mm: float,
    width_mm: float,
    length_mm: float,
    modulus_mpa: float,
    poisson: float,
    friction: float,
    spacing_mm: float,
    as_json: bool,
) -> None:
    """Force and contact area of one press (simulated); exit 1 when refused or not converged."""
    from ..catalog import validate
    from ..gel.material import GelMaterial
    from ..gel.press import press as run
    from ..shapes import SkinDimensions
    from ..shapes.indenter import parse
    from .output import echo_json

    skin = validate(
        SkinDimensions,
        {
            "width_mm": width_mm,
            "length_mm": length_mm,
            "thickness_mm": thickness_mm,
            # The layer knows nothing of the sides: they need only be consistent.
            "protrusion_mm": thickness_mm,
            "edge_fillet_mm": min(2.0, thickness_mm / 2, width_mm / 4, length_mm / 4),
        },
        "options",
    )
    material = validate(
        GelMaterial,
        {"modulus_mpa": modulus_mpa, "poisson": poisson, "friction": friction},
        "options",
    )
    result = run(
        skin, material, parse(indenter), at_mm, depth_mm, (shear_x_mm, shear_y_mm), spacing_mm
    )
    if as_json:
        echo_json(result)
    elif result["converged"]:
        fx, fy, fz = result["force_n"]
        estimate = result["error_estimate"]
        click.echo(
            f"force on the sensor: {fx:+.3f} {fy:+.3f} {fz:+.3f} N (simulated, {result['model']}, "
            f"grid error about {100 * estimate['force_rel']:.2g} %), contact "
            f"{result['contact_area_mm2']:.2f} mm2, {result['seconds']:.1f} s"
        )
        if result["beyond_small_strain"]:
            click.echo("warning: beyond 10 % of the thickness, past small strain", err=True)
    if not result["converged"]:
        if not as_json:
            click.echo(f"deltact-fab: {result['reason']}", err=True)
        raise click.exceptions.Exit(1)
