"""`deltact-fab pattern`: recipes, stickers, their quality, print jobs, and the paper's series."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import click

from .cad import load, of_design
from .group import CommandGroup
from .options import JSON, NEW_FILE, PATH, PATTERN_NAME, SEED, Named, out_file, out_folder, seed


def _laws() -> list[str]:
    from ..patterns.laws import LAWS

    return list(LAWS)


RECIPES = click.argument("recipes", nargs=-1, required=True, metavar="RECIPE...", type=PATTERN_NAME)
PNG = out_file("PNG file to write.", required=True)
MARKER_DOTS = click.option(
    "--dots/--no-dots", "with_dots", default=True, show_default=True,
    help="With the marker dots, or without.",
)  # fmt: skip
PRINTER = click.option("--printer", type=PATH, metavar="FILE",
                       help="The printer as `pattern verify -o` found it.")  # fmt: skip
DPI = click.option(
    "--dpi", type=float, show_default="near 1200 with dots", metavar="DPI",
    help="Resolution of the printer.",
)  # fmt: skip


@click.group(cls=CommandGroup)
def pattern() -> None:
    """Pattern stickers: recipes, their quality, and the sheets to print.

    A RECIPE is a name of `pattern list` or a path.
    """


def _tell(made: Any, as_json: bool) -> None:
    """What was made, for a program or for a person: it has `as_dict` and `lines`."""
    from .output import echo_json

    if as_json:
        echo_json(made.as_dict())
        return
    for line in made.lines():
        click.echo(line)


@pattern.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Recipes that can be named: your own and the shipped ones."""
    from .. import catalog
    from ..patterns import load_recipe
    from .output import echo_rows

    recipes = [(name, load_recipe(name)) for name in catalog.names("patterns")]
    echo_rows(
        ("recipe", "law", "d_mm", "r", "channels", "scales_mm", "dots"),
        [
            (
                name,
                r.law,
                r.patch_mm,
                r.r,
                r.channels,
                r.scales_mm and ", ".join(f"{s:g}" for s in r.scales_mm),
                r.dots and f"{r.dots.columns} x {r.dots.rows}",
            )
            for name, r in recipes
        ],
        as_json,
    )


@pattern.command(epilog="Example: deltact-fab pattern new mine --law octave")
@click.argument("name")
@click.option("--law", default="algorithm1", show_default=True, type=Named(_laws, files=False),
              metavar="LAW", help="How patches are coloured; `schema pattern law` lists the laws.",
              )  # fmt: skip
@NEW_FILE
@JSON
def new(name: str, law: str, out: Path | None, as_json: bool) -> None:
    """Write a new recipe with every key that its law takes.

    Above each key stand its meaning and its limits.
    """
    from ..lab import pattern as write
    from .output import echo_written

    echo_written(write(name, law, out), as_json, f"pattern quality {name}")


@pattern.command(epilog="Example: deltact-fab pattern make -d 0.15 -r 0.1 --dots -o sticker.png")
@click.argument("recipe", required=False, type=PATTERN_NAME)
@click.option("-d", "patch_mm", type=float, metavar="MM", help="Patch size, instead of a RECIPE.")
@click.option("-r", "factor", type=float, metavar="R",
              help="Randomness factor, 0 <= r < 1; goes with -d.")  # fmt: skip
@click.option("--size", "size_mm", type=float, metavar="MM", show_default="35",
              help="Side of the sticker.")  # fmt: skip
@click.option("--seed", type=SEED, metavar="N", show_default="the recipe's, or 7",
              help="Seed of the random pattern.")  # fmt: skip
@click.option("--dots", "with_dots", is_flag=True, help="Add the 13 x 13 white marker dots.")
@DPI
@PNG
@JSON
def make(
    recipe: str | None,
    patch_mm: float | None,
    factor: float | None,
    size_mm: float | None,
    seed: int | None,
    with_dots: bool,
    dpi: float | None,
    out: Path,
    as_json: bool,
) -> None:
    """Make a sticker's PNG from a RECIPE, or from -d and -r.

    One image pixel is one patch; with --dpi or marker dots it is one printer dot. The centres of
    the marker dots are written beside the PNG, as NAME.dots.csv.
    """
    from ..patterns import make as make_file
    from ..patterns import recipe_from_options

    chosen = recipe_from_options(recipe, patch_mm, factor, size_mm, seed, with_dots)
    made = make_file(chosen, out, dpi)
    _tell(made, as_json)


@pattern.command()
@click.argument("file", type=PATH)
@JSON
def show(file: Path, as_json: bool) -> None:
    """Show the recipe stored in FILE, the PNG of a pattern."""
    from ..patterns import read_recipe
    from .output import echo_json, echo_table

    recipe = read_recipe(file)
    data = recipe.model_dump(exclude_none=True)
    if as_json:
        echo_json(data)
        return
    rows = [(key, value) for key, value in data.items() if key != "dots"]
    rows += [("n", recipe.n), ("printed_mm", recipe.printed_mm)]
    rows += [(f"dots.{key}", value) for key, value in data.get("dots", {}).items()]
    echo_table(("key", "value"), rows)


@pattern.command("from")
@click.argument("code")
@DPI
@PNG
@JSON
def from_(code: str, dpi: float | None, out: Path, as_json: bool) -> None:
    """Make the same sticker again from CODE, the text of a sheet's QR code and label.

    Put CODE in quotes: some of its characters mean something to a shell.
    """
    from ..patterns import make as make_file
    from ..patterns.code import decode

    made = make_file(decode(code), out, dpi, check_view=False)
    _tell(made, as_json)


@pattern.command(epilog="Example: deltact-fab pattern quality dense octave")
@RECIPES
@click.option("--dpi", type=int, default=1200, show_default=True, metavar="DPI",
              help="Resolution of the printer.")  # fmt: skip
@PRINTER
@click.option("--mm-per-px", type=float, default=0.0378, show_default=True, metavar="MM",
              help="Size of a camera pixel on the resting face.")  # fmt: skip
@seed("Seed of halftone and noise.")
@MARKER_DOTS
@JSON
def quality(
    recipes: tuple[str, ...],
    dpi: int,
    printer: Path | None,
    mm_per_px: float,
    seed: int,
    with_dots: bool,
    as_json: bool,
) -> None:
    """Figures of merit of each RECIPE, as designed and as printed and photographed (simulated)."""
    from dataclasses import asdict

    from ..imaging import Printer
    from ..patterns import load_recipe
    from ..patterns.quality import measure
    from .output import echo_json, echo_table, progress

    chosen = [(name, load_recipe(name)) for name in recipes]
    model = Printer(dpi=dpi)
    if printer is not None:
        from ..patterns.verify import load_printer

        own = load_printer(printer)
        model = Printer(dpi, spread_um=own.spread_um, misregistration_um=own.misregistration_um)
    rows = []
    with progress("pattern quality") as tell:
        for done, (name, recipe) in enumerate(chosen):
            tell(done, len(chosen), name)
            bare = recipe.dots is None or with_dots or recipe.law == "dot-matrix"
            asked = recipe if bare else recipe.model_copy(update={"dots": None})
            rows.append((name, measure(asked, model, None, mm_per_px, seed)))
        tell(len(chosen), len(chosen), "done")
    if as_json:
        echo_json([{"recipe": name, "simulated": True, **asdict(q)} for name, q in rows])
        return
    columns = ("recipe", "", "gradient", "SSSIG", "contrast level 0", "level 3", "level 4", "peak",
               "peak_mm")  # fmt: skip
    table = [
        (name, when, f.mean_gradient, f.sssig, f.contrast[0], f.contrast[3], f.contrast[4], f.peak,
         f.peak_mm)
        for name, q in rows
        for when, f in (("designed", q.designed), ("photographed", q.photographed))
    ]  # fmt: skip
    echo_table(columns, table, names=2)
    click.echo("")
    echo_table(
        ("recipe", "dots a patch", "print keeps", "printable", "px a patch", "camera keeps",
         "seen"),
        [
            (name, q.dots_a_patch, q.print_contrast, q.printable, q.px_a_patch,
             q.camera_contrast, q.seen)
            for name, q in rows
        ],
    )  # fmt: skip
    click.echo(
        f"\nphotographed: simulated at {dpi} dpi and {mm_per_px:g} mm/px, seed {seed}; values of "
        f"{'printer and camera' if printer is None else 'the camera'} are assumed"
    )


TRANSFER = click.option(
    "--transfer", type=click.Choice(("face-down", "slide")), default="face-down", show_default=True,
    help="Which side faces the gel: the ink, or the film (mirrored).",
)  # fmt: skip
SCALE_X = click.option("--scale-x", type=float, metavar="FACTOR", show_default="1",
                       help="100 mm divided by what the printed ruler in x measures."
                       )  # fmt: skip
SCALE_Y = click.option("--scale-y", type=float, metavar="FACTOR", show_default="1",
                       help="100 mm divided by what the printed ruler in y measures."
                       )  # fmt: skip


def _scales(
    x: float | None, y: float | None, otherwise: tuple[float, float]
) -> tuple[float, float]:
    """The scales that are given, else the others."""
    return (otherwise[0] if x is None else x, otherwise[1] if y is None else y)


PAPER = click.option(
    "--paper", default="A4", show_default=True, metavar="SIZE",
    help="A2, A3, A4, A5, SRA3, Letter, Legal or Tabloid.",
)  # fmt: skip


@pattern.command(
    epilog="Example: deltact-fab pattern sheet dense-with-dots --copies 4 -o sheet.pdf"
)
@RECIPES
@PAPER
@TRANSFER
@of_design
@click.option("--dpi", type=float, default=1200.0, show_default=True, metavar="DPI",
              help="Resolution of the printer.")  # fmt: skip
@click.option("--copies", type=int, default=1, show_default=True, metavar="N",
              help="Copies of each sticker.")  # fmt: skip
@SCALE_X
@SCALE_Y
@PRINTER
@out_file("PDF to write.", required=True)
@JSON
def sheet(
    recipes: tuple[str, ...],
    paper: str,
    dpi: float,
    transfer: Literal["face-down", "slide"],
    copies: int,
    scale_x: float | None,
    scale_y: float | None,
    printer: Path | None,
    out: Path,
    design: str,
    changes: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write a sheet to print: each RECIPE at its exact size, with cut marks, rulers and QR code.

    Around each sticker is the margin of film that the design's skin needs; cut as the guide says.
    """
    from ..errors import InputError
    from ..patterns import load_recipe
    from ..patterns.sheet import write
    from .output import progress

    scale = (1.0, 1.0)
    if printer is not None:
        from ..patterns.verify import load_printer

        known = load_printer(printer)
        scale = known.scale_x, known.scale_y
    chosen = [load_recipe(name) for name in recipes]
    sensor = load(design, changes)
    # For no design that was named a small sticker is a trial print.
    source = click.get_current_context().get_parameter_source("design")
    named = bool(changes) or source is not click.core.ParameterSource.DEFAULT
    for name, recipe in zip(recipes, chosen, strict=True):
        beyond = sensor.optics.beyond(recipe.printed_mm) if named else None
        if beyond is not None:
            raise InputError(f"{name}: size_mm: {beyond} by --design {design}")
    with progress("pattern sheet") as tell:
        done = write(
            chosen,
            out,
            paper=paper,
            dpi=dpi,
            transfer=transfer,
            copies=copies,
            scale=_scales(scale_x, scale_y, scale),
            sensor=sensor,
            progress=tell,
        )
    _tell(done, as_json)


@pattern.command(epilog="Example: deltact-fab pattern verify scan.png dense -o my-printer.toml")
@click.argument("scan", type=PATH)
@click.argument("recipe", type=PATTERN_NAME)
@click.option("--dpi", type=float, metavar="DPI", show_default="the file's",
              help="Resolution of the scan.")  # fmt: skip
@TRANSFER
@SCALE_X
@SCALE_Y
@out_file("Write what the print tells of its printer, for the next sheet and `pattern quality`.")
@JSON
@click.pass_context
def verify(
    context: click.Context,
    scan: Path,
    recipe: str,
    dpi: float | None,
    transfer: str,
    scale_x: float | None,
    scale_y: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Hold SCAN, a scan or photograph of a print, against its RECIPE.

    RECIPE may also be the text of the sheet's QR code. --transfer and the scales are those that the
    sheet was written with. A photograph, which has no dpi, tells no scale. Exit code 1 when a row
    fails.
    """
    from dataclasses import asdict

    from ..catalog import as_toml, write_new
    from ..patterns import load_recipe
    from ..patterns.code import PREFIX, decode
    from ..patterns.verify import verify as judge
    from .output import echo_judged

    coded = recipe.upper().startswith(PREFIX)
    asked = decode(recipe) if coded else load_recipe(recipe)
    scaled = _scales(scale_x, scale_y, (1.0, 1.0))
    done = judge(scan, asked, dpi, transfer == "slide", scaled)
    if out is not None:
        write_new(out, as_toml(asdict(done.printer())))
    echo_judged(str(scan), done, "right", as_json)
    if out is not None and not as_json:
        click.echo(f"\nwritten: {out}; pattern sheet --printer {out}")
    if not done.passed:
        context.exit(1)


@pattern.command()
@out_folder("New folder to write.", required=True)
@seed("Seed of every pattern.", 7)
@PAPER
@TRANSFER
@click.option("--dpi", type=int, default=1200, show_default=True, metavar="DPI",
              help="Resolution of the printer.")  # fmt: skip
@MARKER_DOTS
@JSON
def series(
    out: Path,
    seed: int,
    paper: str,
    dpi: int,
    transfer: Literal["face-down", "slide"],
    with_dots: bool,
    as_json: bool,
) -> None:
    """Write the 17 patterns that the paper compares: recipes, sheets to print, quality, a page."""
    from ..errors import MissingLibrary
    from ..patterns.series import write
    from ..report import patterns_page
    from .output import progress

    try:
        page = patterns_page.ready()
    except MissingLibrary as why:
        page = None
        click.echo(f"no page: {why}", err=True)
    with progress("pattern series") as tell:
        done = write(
            out,
            seed=seed,
            dpi=dpi,
            paper=paper,
            transfer=transfer,
            with_dots=with_dots,
            page=page,
            progress=tell,
        )
    _tell(done, as_json)
