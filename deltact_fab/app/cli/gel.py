"""`deltact-fab gel`: mechanics of the skin."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from deltact_fab.common import InputError, validate
from deltact_fab.sensor import GEL_LEVELS

from .group import CommandGroup
from .options import JOBS_OPTION, NAME_OR_PATH, ON_OPTION, PATH_TYPE, RIG_OPTION, Decorator, Point
from .output import Answer, answers, columns_of, pairs, progress, table

if TYPE_CHECKING:
    from deltact_fab.sensor import SkinDimensions
    from deltact_fab.simulate import PressRow

MODEL_NAMES = ("auto", *GEL_LEVELS)


AT_OPTION = click.option(
    "--at", "at_mm", type=Point(), default="0,0", metavar="X,Y",
    help="Position of the press, mm from the centre of the face."
)  # fmt: skip


def block_options(command: Decorator) -> Decorator:
    """Add options that describe the block of gel."""
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


def build_block(width_mm: float, length_mm: float, thickness_mm: float) -> SkinDimensions:
    """Return the gel's dimensions for the models. Raises InputError for sizes out of range."""
    from deltact_fab.sensor import SkinDimensions

    return validate(
        SkinDimensions,
        {
            "width_mm": width_mm,
            "length_mm": length_mm,
            "thickness_mm": thickness_mm,
            # No model has a frame or a fillet: these only need to be consistent.
            "protrusion_mm": thickness_mm,
            "edge_fillet_mm": min(2.0, thickness_mm / 2, width_mm / 4, length_mm / 4),
        },
        "options",
    )


@click.group(cls=CommandGroup)
def gel() -> None:
    """Gel mechanics: press an indenter, fit the modulus, solve a protocol ahead of its run."""


@gel.command(epilog="Example: deltact-fab gel press --indenter sphere:15 --depth 5 --shear-x 3")
@click.option("--indenter", default="sphere:10", metavar="NAME",
              help="Indenter: sphere:DIAMETER_MM, or 4dots, 2dots, edges, ellipsoid, hexprism, "
              "star, cylinder, ring, hat, with or without :SIZE_MM; or a shape of "
              "cad/indenters.toml.")  # fmt: skip
@click.option("--depth", "depth_mm", required=True, type=float, metavar="MM",
              help="Depth into the gel.")  # fmt: skip
@click.option("--shear-x", "shear_x_mm", default=0.0, metavar="MM",
              help="Motion along x after pressing.")  # fmt: skip
@click.option("--shear-y", "shear_y_mm", default=0.0, metavar="MM",
              help="Motion along y after pressing.")  # fmt: skip
@AT_OPTION
@click.option("--model", type=click.Choice(MODEL_NAMES), default="auto",
              help="Gel model; auto takes linear or hyperelastic, the cheaper within the "
              "tolerance; tabulated is for many presses.")  # fmt: skip
@block_options
@click.option("--modulus", "modulus_mpa", default=0.56, metavar="MPA",
              help="Young's modulus of the gel.")  # fmt: skip
@click.option("--friction", default=0.5, metavar="MU", help="Coefficient of friction.")
@click.option("--tolerance", default=0.03, metavar="SHARE",
              help="Allowed relative error of the force.")  # fmt: skip
@click.option("--spacing", "spacing_mm", type=float, metavar="MM", show_default="chosen",
              help="Grid spacing or cell size.")  # fmt: skip
@click.option("--limit-s", "limit_s", default=120.0, metavar="S", help="Limit of CPU seconds; "
              "the result is that of the finest mesh solved by then.")  # fmt: skip
@answers
def press(
    indenter: str, depth_mm: float, shear_x_mm: float, shear_y_mm: float,
    at_mm: tuple[float, float], model: str, thickness_mm: float, width_mm: float, length_mm: float,
    modulus_mpa: float, poisson: float, friction: float, tolerance: float,
    spacing_mm: float | None, limit_s: float,
) -> Answer:  # fmt: skip
    """Force, contact area and in-plane displacement of one press (simulated).

    Chooses model, mesh and steps for the tolerance, reports the choice, and estimates the error.
    Exit code 1 if the press is refused or does not converge.
    """
    from deltact_fab.physics import press_gel as run
    from deltact_fab.sensor import GelMaterial, parse_indenter

    skin = build_block(width_mm, length_mm, thickness_mm)
    settings = {"modulus_mpa": modulus_mpa, "poisson": poisson, "friction": friction}
    material = validate(GelMaterial, settings, "options")
    shape = parse_indenter(indenter)
    with progress("gel press") as report:
        pressed = run(
            skin, material, shape, at_mm, depth_mm, (shear_x_mm, shear_y_mm),
            model, tolerance, spacing_mm, report, limit_s,
        )  # fmt: skip
    result = pressed.result
    flags = [f"warning: {flag}" for flag in result["flags"]]
    if not result["converged"]:
        return Answer(result, failed=result["reason"], asides=flags)
    lines = table(("simulated", "value"), pairs({**result, "flags": None}))
    return Answer(result, lines, asides=flags)


def _parse_offset(ctx: click.Context, param: click.Parameter, value: str) -> float | None:
    """Parse a number of mm, or `fit` as None."""
    try:
        return None if value == "fit" else float(value)
    except ValueError as error:
        raise click.BadParameter(f"{value!r}: must be a number in mm, or fit") from error


@gel.command(epilog="Example: deltact-fab gel fit measured.csv --indenter sphere:15 --offset fit")
@click.argument("source", metavar="CSV|RUN", type=PATH_TYPE)
@click.option("--press", "press_name", metavar="NAME", show_default="the only one",
              help="Press of RUN.")  # fmt: skip
@click.option("--indenter", metavar="NAME", show_default="that of the press of RUN",
              help="Indenter, as in `gel press`: sphere:15; needed with CSV.")  # fmt: skip
@AT_OPTION
@block_options
@click.option("--friction", default=0.5, metavar="MU", help="Coefficient of friction.")
@click.option("--offset", "offset_mm", default="0", callback=_parse_offset,
              metavar="MM|fit", help="depth_mm at first touch, or fit.")  # fmt: skip
@click.option("--spacing", "spacing_mm", type=float, metavar="MM", show_default="chosen",
              help="Size of the mesh below the indenter.")  # fmt: skip
@answers
def fit(
    source: Path, press_name: str | None, indenter: str | None, offset_mm: float | None,
    spacing_mm: float | None, **options: Any,
) -> Answer:  # fmt: skip
    """Fit the modulus of a gel to a measured press, with a 95 % interval.

    The last lines are keys of a protocol.

    CSV is a table with the columns depth_mm and normal_n (positive when pressed), rows in the order
    of measurement. Of a press of RUN, up to its first drag, indenter, place, gel and friction stand
    in the run; options given here replace them. Friction is the ratio of side force to normal force
    in a light drag, once it is constant.
    """
    from deltact_fab.estimate import StraightPress
    from deltact_fab.physics import MeasuredIndentation, fit_press
    from deltact_fab.sensor import GelMaterial, parse_indenter

    notes: list[str] = []
    shape = None if indenter is None else parse_indenter(indenter)
    if source.is_dir():
        curve = StraightPress.from_run(source, press_name)
        of_default = click.get_current_context().get_parameter_source
        options |= {
            name: value for name, value in curve.options.items()
            if of_default(name) is ParameterSource.DEFAULT
        }  # fmt: skip
        shape, notes = shape or curve.indenter, curve.notes
        data = MeasuredIndentation.from_rows(
            curve.name, curve.depth_mm, curve.normal_n, curve.dragged
        )
    elif press_name is not None:
        raise InputError(f"{source}: --press: only for a run folder")
    else:
        data = MeasuredIndentation.from_csv(source)
    if shape is None:
        raise InputError(f"{source}: --indenter: needed with a table of depths and forces")
    at_mm, poisson, friction = (options.pop(name) for name in ("at_mm", "poisson", "friction"))
    skin = build_block(**options)
    validate(GelMaterial, {"poisson": poisson, "friction": friction}, "options")
    if offset_mm is not None:
        data = replace(data, depth_mm=data.depth_mm - offset_mm)
    with progress("gel fit") as report:
        estimate = fit_press(
            data, skin, shape, at_mm, poisson, friction,
            fit_offset=offset_mm is None, spacing_mm=spacing_mm, progress=report,
        )  # fmt: skip
    result = estimate.as_dict()
    result["notes"] += notes
    if source.is_dir():
        result |= {"press": curve.name, "indenter": shape.name, "at_mm": list(at_mm), **options,
                   "poisson": poisson}  # fmt: skip
    lines = [*table(("key", "value"), pairs({**result, "notes": None})), "\n[specimen]"]
    lines.append(f"modulus_mpa = {estimate.modulus_mpa.value:.4g}")
    return Answer(result, lines, asides=result["notes"])


@gel.command(epilog="Example: deltact-fab gel path pattern-selection --jobs 2")
@click.argument("protocol", type=NAME_OR_PATH)
@RIG_OPTION
@JOBS_OPTION
@ON_OPTION
@answers
def path(protocol: str, rig_name: str, jobs: int | None, on: str) -> Answer:
    """Solve every press of PROTOCOL on the simulated gel and keep the results for `run`.

    If stopped, the same command continues: complete presses are kept. A press that fails does not
    stop the others; exit code 1 if one failed. `run` uses results that were solved with the
    [virtual.gel] settings of its rig file.
    """
    from deltact_fab.bench import load_protocol, load_rig
    from deltact_fab.common import open_executor
    from deltact_fab.fabricate import load_design
    from deltact_fab.simulate import require_gel_level, solve_presses

    declared, source = load_protocol(protocol)
    rig, rig_source = load_rig(rig_name)
    if rig.kind != "virtual":
        raise InputError(
            f"{rig_source}: kind: {rig.kind!r} has no simulated gel; name a virtual rig"
        )
    sensor = load_design(declared.specimen.design)
    require_gel_level(declared, sensor, str(source))
    level = declared.specimen.gel_model
    started = time.monotonic()
    with open_executor(on, jobs) as executor, progress("gel path") as tick:
        rows = solve_presses([declared], sensor.skin, rig.virtual.gel, executor, tick)
    seconds = time.monotonic() - started
    failed = [row for row in rows if row.failure]
    data = {
        "protocol": declared.name,
        "level": level,
        "wall_seconds": seconds,
        "failed": len(failed),
        "presses": [asdict(row) for row in rows],
    }
    return Answer(data, _table(rows, level, seconds), "" if failed else None, _warnings(rows))


def _table(rows: list[PressRow], level: str, seconds: float) -> list[str]:
    names = ("press", "knots", "done", "found", "like", "seconds")
    zones = ("contact_area_mm2", "contact_area_error_mm2", "stick_area_mm2", "stick_area_error_mm2")
    n_solved = sum(r.done for r in rows if not r.found)
    return [
        *columns_of((*names, *zones), [{**vars(row), **asdict(row.zones)} for row in rows]),
        f"{len(rows)} presses (simulated, {level}), {n_solved} knots solved in {seconds:.1f} s; "
        "found: from the cache; like: mirror image of that press; zones at the end of the press",
    ]


def _warnings(rows: list[PressRow]) -> list[str]:
    lines = []
    for row in rows:
        for flag, count in ({} if row.like else row.flags).items():
            lines.append(f"warning: {row.press}: {flag} ({count} of {row.knots} knots)")
        if row.failure:
            lines.append(f"failed: {row.press}: {row.failure}")
    return lines
