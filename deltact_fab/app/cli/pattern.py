"""`deltact-fab pattern`: recipes, stickers, their quality, print jobs, and the paper's series."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Literal

import click

from deltact_fab.common import (
    InputError,
    MissingLibrary,
    catalogue_names,
    toml_text,
    write_new_file,
    write_whole,
)

from .cad import FORCE_OPTION, design_options
from .group import CommandGroup
from .options import NAME_OR_PATH, NEW_FILE, PATH_TYPE, SEED_TYPE, out_file, out_folder, seed
from .output import (
    Answer,
    answers,
    columns_of,
    file_note,
    files_line,
    grade,
    listing,
    pairs,
    progress,
    table,
)

RECIPES_ARGUMENT = click.argument("recipes", nargs=-1, required=True, metavar="RECIPE...",
                                  type=NAME_OR_PATH)  # fmt: skip
PRINTER_OPTION = click.option("--printer", type=PATH_TYPE, metavar="FILE",
                       help="Printer file written by `pattern verify -o`.")  # fmt: skip


@click.group(cls=CommandGroup)
def pattern() -> None:
    """Pattern stickers: recipes, their quality, and the sheets to print.

    A RECIPE is a name of `pattern list` or a path.
    """


@pattern.command("list")
@answers
def list_() -> Answer:
    """List recipes: your own and the shipped ones."""
    from deltact_fab.fabricate import load_recipe

    rows = []
    for name in catalogue_names("patterns"):
        r = load_recipe(name)
        scales = r.scales_mm and ", ".join(f"{s:g}" for s in r.scales_mm)
        dots = r.dots and f"{r.dots.columns} x {r.dots.rows}"
        rows.append((name, r.law, r.patch_mm, r.r, r.channels, scales, dots))
    return listing(("recipe", "law", "d_mm", "r", "channels", "scales_mm", "dots"), rows)


@pattern.command(epilog="Example: deltact-fab pattern new mine --law octave")
@click.argument("name")
@click.option("--law", default="algorithm1", metavar="LAW",
              help="Law that colours the patches; `schema pattern` lists them.")  # fmt: skip
@NEW_FILE
@answers
def new(name: str, law: str, out: Path | None) -> Answer:
    """Write a new recipe with every key of its law.

    Each key has a comment with its meaning and limits.
    """
    from ..lab import pattern as write

    return file_note(write(name, law, out), f"pattern quality {name}")


@pattern.command(epilog="Example: deltact-fab pattern make -d 0.15 -r 0.1 --dots -o sticker.png")
@click.argument("recipe", required=False, type=NAME_OR_PATH)
@click.option("-d", "patch_mm", type=float, metavar="MM", help="Patch size, instead of a RECIPE.")
@click.option("-r", "factor", type=float, metavar="R",
              help="Randomness factor, 0 <= r < 1; needs -d.")  # fmt: skip
@click.option("--size", "size_mm", type=float, metavar="MM", show_default="35",
              help="Side of the sticker.")  # fmt: skip
@click.option("--seed", type=SEED_TYPE, metavar="N", show_default="the recipe's, or 7",
              help="Seed of the random pattern.")  # fmt: skip
@click.option("--dots", "with_dots", is_flag=True, help="Add the 13 x 13 white marker dots.")
@click.option("--dpi", type=float, show_default="near 1200 with dots", metavar="DPI",
              help="Resolution of the printer.")  # fmt: skip
@out_file("PNG file to write.", required=True)
@answers
def make(
    recipe: str | None, patch_mm: float | None, factor: float | None, size_mm: float | None,
    seed: int | None, with_dots: bool, dpi: float | None, out: Path,
) -> Answer:  # fmt: skip
    """Make a sticker's PNG from a RECIPE, or from -d and -r.

    RECIPE may also be the quoted text of a sheet's QR code or label, to remake that sticker. One
    image pixel is one patch; with --dpi or marker dots it is one printer dot. The centres of the
    marker dots are written next to the PNG, as NAME.dots.csv.
    """
    from deltact_fab.fabricate import choose_recipe, read_code
    from deltact_fab.fabricate import make_pattern as make_file

    coded = None if recipe is None else read_code(recipe)
    if coded is not None:
        if (patch_mm, factor, size_mm, seed, with_dots) != (None, None, None, None, False):
            raise click.UsageError("with a sheet's code, only --dpi may be given")
        sticker = make_file(coded, out, dpi, check_view=False)
    else:
        chosen = choose_recipe(recipe, patch_mm, factor, size_mm, seed, with_dots)
        sticker = make_file(chosen, out, dpi)
    data = sticker.as_dict()
    return Answer(data, table(("key", "value"), pairs(data)))


@pattern.command(epilog="Example: deltact-fab pattern show sticker.png")
@click.argument("recipe", type=NAME_OR_PATH)
@answers
def show(recipe: str) -> Answer:
    """Show the keys of RECIPE, which may also be the PNG of a pattern or a sheet's code."""
    from deltact_fab.fabricate import load_recipe, read_code, read_recipe

    if recipe.lower().endswith(".png"):
        loaded = read_recipe(Path(recipe))
    else:
        loaded = read_code(recipe) or load_recipe(recipe)
    data = loaded.model_dump(exclude_none=True)
    values = {**data, "n": loaded.n, "printed_mm": loaded.printed_mm}
    return Answer(data, table(("key", "value"), pairs(values)))


@pattern.command(epilog="Example: deltact-fab pattern quality dense octave")
@RECIPES_ARGUMENT
@click.option("--dpi", type=int, default=1200, metavar="DPI", help="Resolution of the printer.")
@PRINTER_OPTION
@click.option("--mm-per-px", type=float, default=0.0378, metavar="MM",
              help="Size of a camera pixel on the resting face.")  # fmt: skip
@seed("Seed of halftone and noise.")
@answers
def quality(
    recipes: tuple[str, ...], dpi: int, printer: Path | None, mm_per_px: float, seed: int
) -> Answer:
    """Compute figures of merit of each RECIPE, as designed and as photographed (simulated)."""
    from deltact_fab.fabricate import load_recipe, measure_quality
    from deltact_fab.sensor import Printer

    chosen = [(name, load_recipe(name)) for name in recipes]
    model = Printer(dpi=dpi)
    if printer is not None:
        from deltact_fab.fabricate import load_printer

        fit = load_printer(printer)
        model = Printer(dpi, spread_um=fit.spread_um, misregistration_um=fit.misregistration_um)
    merits = []
    with progress("pattern quality") as tell:
        for index, (name, recipe) in enumerate(chosen):
            tell(index, len(chosen), name)
            merits.append((name, measure_quality(recipe, model, None, mm_per_px, seed)))
    figures = ("mean_gradient", "sssig", "contrast", "peak", "peak_mm")
    rows = [
        (name, when, *(getattr(f, key) for key in figures))
        for name, q in merits
        for when, f in (("designed", q.designed), ("photographed", q.photographed))
    ]
    keys = ("dots_a_patch", "print_contrast", "printable", "px_a_patch", "camera_contrast", "seen")
    body = table(("recipe", *keys), [(n, *(getattr(q, key) for key in keys)) for n, q in merits])
    note = (
        f"photographed: simulated at {dpi} dpi and {mm_per_px:g} mm/px, seed {seed}; values of "
        f"{'printer and camera' if printer is None else 'the camera'} are assumed"
    )
    data = [{"recipe": name, "simulated": True, **asdict(q)} for name, q in merits]
    return Answer(data, [*table(("recipe", "", *figures), rows), "", *body, "", note])


TRANSFER_OPTION = click.option(
    "--transfer", type=click.Choice(("face-down", "slide")), default="face-down",
    help="Side towards the gel: face-down, the ink; slide, the film (mirrored)."
)  # fmt: skip
SCALE_X, SCALE_Y = (
    click.option(f"--scale-{axis}", type=float, metavar="FACTOR", show_default="1",
                 help=f"100 mm divided by the measured length of the printed {axis} ruler.")
    for axis in "xy"
)  # fmt: skip


def _choose_scales(
    x: float | None, y: float | None, otherwise: tuple[float, float]
) -> tuple[float, float]:
    """Return the given scales, else the defaults."""
    return (otherwise[0] if x is None else x, otherwise[1] if y is None else y)


PAPER_OPTION = click.option(
    "--paper", default="A4", metavar="SIZE", help="A2, A3, A4, A5, SRA3, Letter, Legal or Tabloid.",
)  # fmt: skip


@pattern.command(
    epilog="Example: deltact-fab pattern sheet dense-with-dots --copies 4 -o sheet.pdf"
)
@RECIPES_ARGUMENT
@PAPER_OPTION
@TRANSFER_OPTION
@design_options
@click.option("--dpi", type=float, default=1200.0, metavar="DPI", help="Resolution of the printer.")
@click.option("--copies", type=int, default=1, metavar="N", help="Copies of each sticker.")
@SCALE_X
@SCALE_Y
@PRINTER_OPTION
@FORCE_OPTION
@out_file("PDF to write.", required=True)
@answers
def sheet(
    recipes: tuple[str, ...], paper: str, dpi: float, transfer: Literal["face-down", "slide"],
    copies: int, scale_x: float | None, scale_y: float | None, printer: Path | None, force: bool,
    out: Path, design: str, changes: tuple[str, ...],
) -> Answer:  # fmt: skip
    """Write a sheet to print: each RECIPE at its exact size, with cut marks, rulers and QR code.

    Each sticker has the film margin of the design's skin around it; cut as the guide shows. With
    --design it has the design's size, a recipe of another size is written beside the sheet, and the
    sheet begins with the verdict of `cad check`.
    """
    from deltact_fab.fabricate import load_design, load_recipe, write_sheet

    scale = (1.0, 1.0)
    if printer is not None:
        from deltact_fab.fabricate import load_printer

        profile = load_printer(printer)
        scale = profile.scale_x, profile.scale_y
    chosen = [load_recipe(name) for name in recipes]
    sensor, verdict = load_design(design, changes), ""
    # Without an explicit design, a small sticker is a trial print.
    source = click.get_current_context().get_parameter_source("design")
    explicit = bool(changes) or source is not click.core.ParameterSource.DEFAULT
    # For a design the stickers have its size; a recipe that changes is a file of its own.
    resized: dict[Path, str] = {}
    if explicit:
        from deltact_fab.fabricate import judge_design

        with progress("cad check") as tell:
            design_verdict = judge_design(sensor, design, tell)
        design_verdict.require(force)
        verdict = design_verdict.headline
    for k, (name, recipe) in enumerate(zip(recipes, chosen, strict=True)):
        if explicit:
            chosen[k] = recipe.fitted(sensor.optics.view_mm, sensor.skin.face_mm)
        if chosen[k] != recipe:
            resized[out.with_name(f"{out.stem}-{Path(name).stem}.toml")] = chosen[k].file_text()
    with progress("pattern sheet") as tell:
        result = write_sheet(
            chosen, out, paper=paper, dpi=dpi, transfer=transfer, copies=copies,
            scale=_choose_scales(scale_x, scale_y, scale), sensor=sensor, verdict=verdict,
            progress=tell,
        )  # fmt: skip
    for path, text in resized.items():
        write_whole(path, text.encode())
    data = result.as_dict()
    lines = table(("key", "value"), pairs({**data, "stickers": None, "codes": None}))
    columns = ("dots_per_patch", "side_mm", "file_side_mm", "print_error_mm", "code")
    kinds = columns_of(columns, {s["code"]: s for s in data["stickers"]}.values())
    notes = [
        *filter(None, [verdict]),
        *(f"size for --design {design}; recipe: {path}" for path in resized),
    ]
    return Answer(data, [*lines, "", *kinds, *notes])


@pattern.command(epilog="Example: deltact-fab pattern verify scan.png dense -o my-printer.toml")
@click.argument("scan", type=PATH_TYPE)
@click.argument("recipe", type=NAME_OR_PATH)
@click.option("--dpi", type=float, metavar="DPI", show_default="the file's",
              help="Resolution of the scan.")  # fmt: skip
@TRANSFER_OPTION
@SCALE_X
@SCALE_Y
@out_file("Printer file to write, for `pattern sheet` and `pattern quality`.")
@answers
def verify(
    scan: Path, recipe: str, dpi: float | None, transfer: str, scale_x: float | None,
    scale_y: float | None, out: Path | None,
) -> Answer:  # fmt: skip
    """Compare SCAN, a scan or photograph of a print, with its RECIPE.

    RECIPE may also be the text of the sheet's QR code. Give --transfer and the scales that the
    sheet was written with. Scale cannot be checked without a dpi, as in a photograph. Exit code 1
    if a row fails.
    """
    from deltact_fab.fabricate import load_recipe, read_code
    from deltact_fab.fabricate import verify_print as judge

    if not scan.is_file() and Path(recipe).is_file() and Path(recipe).suffix != ".toml":
        raise InputError(f"SCAN {str(scan)!r}, RECIPE {recipe!r}: swapped; expected the scan first")
    expected = read_code(recipe) or load_recipe(recipe)
    scale = _choose_scales(scale_x, scale_y, (1.0, 1.0))
    result = judge(scan, expected, dpi, transfer == "slide", scale)
    if out is None:
        return grade(str(scan), result, "OK")
    write_new_file(out, toml_text(asdict(result.printer())))
    return grade(str(scan), result, "OK", "", f"written: {out}; pattern sheet --printer {out}")


@pattern.command()
@out_folder("New folder to write.", required=True)
@seed("Seed of every pattern.", 7)
@PAPER_OPTION
@TRANSFER_OPTION
@click.option("--dpi", type=int, default=1200, metavar="DPI", help="Resolution of the printer.")
@answers
def series(
    out: Path, seed: int, paper: str, dpi: int, transfer: Literal["face-down", "slide"]
) -> Answer:
    """Write the 17 patterns that the paper compares: recipes, sheets, quality, a page."""
    from deltact_fab.common import require_pages
    from deltact_fab.fabricate import write_series
    from deltact_fab.present import write_patterns_page

    page, asides = None, []
    try:  # check before the series is made
        require_pages()
        page = write_patterns_page
    except MissingLibrary as error:
        asides = [f"no page: {error}"]
    with progress("pattern series") as tell:
        result = write_series(
            out, seed=seed, dpi=dpi, paper=paper, transfer=transfer, page=page, progress=tell,
        )  # fmt: skip
    data = result.as_dict()
    lines = table(("key", "value"), pairs({**result.figures, "patterns": None}))
    return Answer(data, [*lines, files_line(result.files)], asides=asides)
