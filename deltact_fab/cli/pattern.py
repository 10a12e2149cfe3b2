"""`deltact-fab pattern`: recipes, stickers, their quality, print jobs, and the paper's series."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar

import click

from .cad import load, of_design
from .options import JSON, NEW_FILE

F = TypeVar("F", bound=Callable[..., Any])


@click.group()
def pattern() -> None:
    """Pattern stickers: list, new, make, show, quality, sheet, series, from a sheet's code."""


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
    """Recipes that can be named: local ones and shipped ones."""
    from .. import catalog
    from ..patterns import load_recipe
    from .output import echo_json, echo_table

    names = catalog.names("patterns")
    if as_json:
        echo_json(names)
        return
    recipes = [(name, load_recipe(name)) for name in names]
    echo_table(
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
    )


@pattern.command()
@click.argument("name")
@click.option("--law", default="algorithm1", show_default=True,
              help="How patches are coloured; `schema pattern law` names the laws.")  # fmt: skip
@NEW_FILE
@JSON
def new(name: str, law: str, out: Path | None, as_json: bool) -> None:
    """Write a recipe with every key that its law takes.

    Each key has its meaning and limits above it; recipes are found by their name.
    """
    from ..lab import pattern as write
    from .output import echo_written

    echo_written(write(name, law, out), f"pattern quality {name}", as_json)


@pattern.command()
@click.argument("recipe", required=False)
@click.option("-d", "patch_mm", type=float, help="Patch size in mm, instead of a RECIPE.")
@click.option("-r", "factor", type=float, help="Randomness factor, 0 <= r < 1; goes with -d.")
@click.option("--size", "size_mm", type=float, help="Side of the sticker in mm.  [default: 35]")
@click.option("--seed", type=int, help="Seed of the draw.  [default: the recipe's, or 7]")
@click.option("--dots", "with_dots", is_flag=True, help="Add the 13 x 13 white marker dots.")
@click.option("--dpi", type=float, help="Printer's resolution.  [default: near 1200 with dots]")
@click.option(
    "-o", "out", required=True, type=click.Path(path_type=Path), help="PNG file to write."
)
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
    """Make a sticker's PNG from a RECIPE (a path or a name), or from -d and -r.

    One image pixel is one patch, unless --dpi or dots ask for printer dots. The centres of the
    dots are written beside it, as NAME.dots.csv.
    """
    from ..patterns import make as make_file
    from ..patterns import recipe_from_options

    chosen = recipe_from_options(recipe, patch_mm, factor, size_mm, seed, with_dots)
    made = make_file(chosen, out, dpi)
    _tell(made, as_json)


@pattern.command()
@click.argument("file", type=click.Path(path_type=Path))
@JSON
def show(file: Path, as_json: bool) -> None:
    """Print the recipe that a pattern's PNG carries."""
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
@click.option("--dpi", type=float, help="Printer's resolution.  [default: near 1200 with dots]")
@click.option(
    "-o", "out", required=True, type=click.Path(path_type=Path), help="PNG file to write."
)
@JSON
def from_(code: str, dpi: float | None, out: Path, as_json: bool) -> None:
    """Make the identical sticker again from the CODE that a sheet's QR code and label hold.

    Quote the CODE: it may hold characters that the shell takes for its own.
    """
    from ..patterns import make as make_file
    from ..patterns.code import decode

    made = make_file(decode(code), out, dpi, check_view=False)
    _tell(made, as_json)


@pattern.command()
@click.argument("recipes", nargs=-1, required=True, metavar="RECIPE...")
@click.option("--dpi", type=int, default=1200, show_default=True, help="Printer's resolution.")
@click.option(
    "--mm-per-px", type=float, default=0.0378, show_default=True, help="Camera's scale at rest."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of halftone and noise.")
@click.option("--dots/--no-dots", "with_dots", default=True, help="With the marker dots, or bare.")
@JSON
def quality(
    recipes: tuple[str, ...],
    dpi: int,
    mm_per_px: float,
    seed: int,
    with_dots: bool,
    as_json: bool,
) -> None:
    """Figures of merit of each RECIPE, as designed and after printer and camera (simulated)."""
    from ..imaging import Printer
    from ..patterns import load_recipe
    from ..patterns.quality import measure
    from .output import echo_json, echo_table, progress

    chosen = [(name, load_recipe(name)) for name in recipes]
    rows = []
    with progress("pattern quality") as tell:
        for done, (name, recipe) in enumerate(chosen):
            tell(done, len(chosen), name)
            bare = recipe.dots is None or with_dots or recipe.law == "dot-matrix"
            asked = recipe if bare else recipe.model_copy(update={"dots": None})
            rows.append((name, measure(asked, Printer(dpi=dpi), None, mm_per_px, seed)))
        tell(len(chosen), len(chosen), "done")
    if as_json:
        echo_json([{"recipe": name, "simulated": True, **q.as_dict()} for name, q in rows])
        return
    columns = ("recipe", "", "gradient", "SSSIG", "contrast level 0", "level 3", "level 4",
               "checkerboard", "anisotropy", "streaks", "peak", "peak_mm")  # fmt: skip
    table = []
    for name, q in rows:
        for when, f in (("designed", q.designed), ("photographed", q.photographed)):
            board = None if f.checkerboard is None else sum(f.checkerboard) / len(f.checkerboard)
            table.append(
                (name, when, f.mean_gradient, f.sssig, f.contrast[0], f.contrast[3],
                 f.contrast[4], board, f.anisotropy, f.streaks, f.peak, f.peak_mm)
            )  # fmt: skip
    echo_table(columns, table)
    click.echo("")
    echo_table(
        ("recipe", "dots a patch", "print keeps", "printable", "px a patch", "camera keeps",
         "seen"),
        [
            (name, q.dots_a_patch, q.print_contrast, "yes" if q.printable else "no", q.px_a_patch,
             q.camera_contrast, "yes" if q.seen else "no")
            for name, q in rows
        ],
    )  # fmt: skip
    click.echo(
        f"\nphotographed: simulated at {dpi} dpi and {mm_per_px:g} mm/px, seed {seed}; printer and "
        "camera have assumed values"
    )


def of_sheet(command: F) -> F:
    """Options of a print job."""
    for option in (
        click.option(
            "--transfer",
            type=click.Choice(("face-down", "slide")),
            default="face-down",
            show_default=True,
            help="Ink towards the gel, or film towards the gel (mirrored).",
        ),
        click.option("--paper", default="A4", show_default=True, help="A5 to A2, Letter..."),
    ):
        command = option(command)
    return command


@pattern.command()
@click.argument("recipes", nargs=-1, required=True, metavar="RECIPE...")
@of_sheet
@of_design
@click.option("--dpi", type=float, default=1200.0, show_default=True, help="Printer's resolution.")
@click.option("--copies", type=int, default=1, show_default=True, help="Of each sticker.")
@click.option("--whole-dots", is_flag=True, help="Make d a whole number of printer dots.")
@click.option("--scale-x", type=float, default=1.0, help="100 / what the ruler in x measures.")
@click.option("--scale-y", type=float, default=1.0, help="100 / what the ruler in y measures.")
@click.option(
    "-o",
    "out",
    required=True,
    type=click.Path(path_type=Path),
    help="File to write: .pdf, .png or .tif.",
)
@JSON
def sheet(
    recipes: tuple[str, ...],
    paper: str,
    dpi: float,
    transfer: Literal["face-down", "slide"],
    copies: int,
    whole_dots: bool,
    scale_x: float,
    scale_y: float,
    out: Path,
    design: str,
    changes: tuple[str, ...],
    as_json: bool,
) -> None:
    """Print job of each RECIPE: exact millimetres, cut marks, rulers, QR code; lossless.

    Each sticker has the film of the design's skin around it, as the guide says to cut it.
    """
    from ..patterns import load_recipe
    from ..patterns.sheet import write
    from .output import progress

    chosen = [load_recipe(name) for name in recipes]
    sensor = load(design, changes)
    with progress("pattern sheet") as tell:
        done = write(
            chosen,
            out,
            paper=paper,
            dpi=dpi,
            transfer=transfer,
            copies=copies,
            whole_dots=whole_dots,
            scale=(scale_x, scale_y),
            sensor=sensor,
            progress=tell,
        )
    _tell(done, as_json)


@pattern.command()
@click.option(
    "--out", required=True, type=click.Path(path_type=Path), help="Folder to write, whole."
)
@click.option("--seed", type=int, default=7, show_default=True, help="Seed of every pattern.")
@of_sheet
@click.option("--dpi", type=int, default=1200, show_default=True, help="Printer's resolution.")
@click.option("--dots/--no-dots", "with_dots", default=True, help="With the marker dots, or bare.")
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
    """The 17 patterns of the paper's two selections: recipes, print job, quality, one page."""
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
