"""`deltact-fab calibrate`: what turns images into millimetres and newtons, one file each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from deltact_fab.common import InputError, write_whole

from .group import CommandGroup
from .options import DESIGN, PATH, out_file, out_folder, seed
from .output import Answer, answers, columns_of, files_line, progress, save_figures, table

if TYPE_CHECKING:
    from deltact_fab.estimate import ForceResult, LensCalibration
    from deltact_fab.sensor import Checkerboard


@click.group(cls=CommandGroup, context_settings={"ignore_unknown_options": True})
def calibrate() -> None:
    """Calibrations of a sensor, in this order: lens, depth, force. Each is one file."""


@calibrate.command(
    epilog="Example: deltact-fab calibrate lens photos/contact --board skin -o camera.toml"
)
@click.argument("images", nargs=-1, type=PATH)
@click.option("--board", required=True, metavar="skin|NXxNYxMM", help="Board that IMAGES show.")
@click.option("--air", multiple=True, type=PATH, metavar="PATH", help="Image, or folder of images, "
              "of a board held in the air; repeatable.")  # fmt: skip
@click.option("--air-board", metavar="NXxNYxMM", show_default="as --board",
              help="Board that --air shows.")  # fmt: skip
@click.option("--flat", type=PATH, metavar="FILE",
              help="Image of a blank skin, to correct the shading.")  # fmt: skip
@DESIGN
@out_file("Camera file to write, .toml.", required=True)
@answers
def lens(
    images: tuple[Path, ...], board: str, air: tuple[Path, ...], air_board: str | None,
    flat: Path | None, design: str, out: Path,
) -> Answer:  # fmt: skip
    """Calibrate the camera through its lens, plate and gel, from IMAGES of a board on the face.

    IMAGES (files, or folders of them) are contact images: the board touches the outer face of the
    clear gel with no air between. Best is one image of the shipped chessboard skin (`pattern sheet
    chessboard`) with --board skin; its middle, the origin of the sensor, must be within 0.8 mm of
    the middle of the image, and the skin turned by less than 45 degrees. Otherwise wet a board onto
    the face at five or more places that together cover the view; --board 9x7x3 is a board of 9 x 7
    squares of 3 mm.

    Boards held in the air beyond the face (--air), tilted and at several heights, improve the
    calibration below the face; on their own they leave the face undetermined. The thicknesses of
    --design are what is assumed beforehand.
    """
    from deltact_fab.estimate import calibrate_lens, fit_flat_field
    from deltact_fab.fabricate import load_design

    wanted = board_named(board, "--board")
    held = None if air_board is None else board_named(air_board, "--air-board")
    if out.suffix != ".toml":
        raise click.BadParameter(f"{out}: a camera file ends in .toml", param_hint="-o")
    found = calibrate_lens(_images(images), wanted, _images(air), held, load_design(design))
    field = None if flat is None else fit_flat_field(flat, found.lens)
    beside = out.with_suffix(".flat.png")
    if field is not None:
        write_whole(beside, field.to_png())
    write_whole(out, found.camera_toml(None if field is None else beside.name).encode())
    named = None if field is None else beside.name
    data = {"camera": found.lens.as_dict(), **found.as_dict(), "flat": named}
    told = f"written: {out}" + ("" if field is None else f", {beside}")
    return Answer(data, [*_lens_lines(found), told])


def board_named(words: str, option: str) -> Checkerboard:
    """A board by its numbers, or the catalogue's chessboard skin."""
    from deltact_fab.fabricate import load_recipe
    from deltact_fab.sensor import Checkerboard

    if words != "skin":
        return Checkerboard.parse(words, option)
    recipe = load_recipe("chessboard")
    assert recipe.patch_mm is not None
    return Checkerboard(recipe.n, recipe.n, recipe.patch_mm, skin=True)


def _images(names: tuple[Path, ...]) -> list[Path]:
    """Files as they are named, and the images in the folders among them."""
    from deltact_fab.bench import ImageFolder

    files: list[Path] = []
    for name in names:
        inside = sorted(p for p in name.glob("*") if p.suffix.lower() in ImageFolder.SUFFIXES)
        if name.is_dir() and not inside:
            raise InputError(f"{name}: no image in this folder ({', '.join(ImageFolder.SUFFIXES)})")
        files += inside if name.is_dir() else [name]
    return files


def _lens_lines(found: LensCalibration) -> Iterator[str]:
    said = found.as_dict()
    known = [{"parameter": name, **p} for name, p in said["parameters"].items()]
    yield from columns_of(("parameter", "value", "sigma", "prior", "prior_sigma"), known)
    yield ""
    seen = ("file", "board", "contact", "corners", "outliers", "rms_px")
    yield from columns_of(seen, said["images"])
    yield (
        "\nuncertainty in px of the raw image (one sigma, over 95 % of the view): "
        f"face {found.face_px:.3f}, "
        f"3 mm below {found.depth_px[3.0]:.2f}, 6 mm below {found.depth_px[6.0]:.2f}"
    )
    yield f"contact corners cover {found.cover:.0%} of the view"
    if found.simulated is not None:
        yield f"simulated images, seed {', '.join(map(str, found.simulated))}"
    yield from (f"note: {line}" for line in found.notes())


@calibrate.command(epilog="Example: deltact-fab calibrate depth ball-run -o depth.toml")
@click.argument("run", type=PATH)
@click.option("--force", type=PATH, metavar="FILE", show_default="the design's gel",
              help="Calibration of force whose gel is taken, so that a measurement with both is "
              "as fast as with one.")  # fmt: skip
@out_file("Calibration to write.", default=Path("depth.toml"))
@answers
def depth(run: Path, force: Path | None, out: Path) -> Answer:
    """Calibrate depth on RUN, in which a ball of known diameter presses the face.

    It uses the images, the positions of the stage and the diameter of the ball. The protocol
    `ball-press` makes such a run.
    """
    from deltact_fab.estimate import calibrate_depth

    made = calibrate_depth(run, force)
    write_whole(out, made.toml().encode())
    return Answer({**made.as_dict(), "file": str(out)}, [made.line, f"written: {out}"])


@calibrate.command(epilog="Example: deltact-fab calibrate force run1 run2 -o calibration.toml")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=PATH)
@click.option("--model", "models", multiple=True, metavar="MODEL",
              show_default="all", help="sums, paper or inverse-placed; repeatable.")  # fmt: skip
@click.option("--transfer", type=PATH, metavar="OTHER.toml", help="Carry another sensor's "
              "calibration over, using the few presses of RUN.")  # fmt: skip
@out_file("Calibration to write.", "file", show_default="calibration.toml in --out")
@out_folder("Folder for the results.", show_default="RUN/analysis")
@seed("Seed of the folds and the learning curve.")
@answers
def force(
    runs: tuple[Path, ...], models: tuple[str, ...], transfer: Path | None, file: Path | None,
    out: Path | None, seed: int,
) -> Answer:  # fmt: skip
    """Calibrate force on runs of one sensor: models are cross-validated, the best one is written.

    The points are the settled frames. Positions and indenters are left out together, which shows
    how far a model can be trusted on what it was not fitted to; presses, points and runs too. The
    best model is shown beside the paper's; force.json has all of them.
    """
    from deltact_fab.estimate import calibrate_force, transfer_calibration, write_force_calibration
    from deltact_fab.present import plot_predicted_force

    folder = out or runs[0] / "analysis"
    output = file or folder / "calibration.toml"
    if transfer is not None:
        if models:
            raise InputError(
                "--model: does not go with --transfer, which keeps the model of its file"
            )
        with progress("transfer") as report:
            moved, kept, left_out = transfer_calibration(runs, transfer, progress=report)
        told = [f"{moved.line} ({kept.head.origin})", *(f"left out: {line}" for line in left_out)]
        files = write_force_calibration(kept, output)
        data = {"transfer": moved.as_dict(), "left_out": left_out}
        return Answer(data, [*told, files_line(files)])
    with progress("force") as report:
        result = calibrate_force(runs, models or None, seed, progress=report)
    told = [*_force_lines(result, folder), *(f"left out: {line}" for line in result.left_out)]
    files, figure = result.save(folder, output), plot_predicted_force(result)
    files += save_figures(folder, lambda: {figure.name: figure.draw()})
    return Answer(result.as_dict(), [*told, files_line(files)])


def _force_lines(result: ForceResult, folder: Path) -> Iterator[str]:
    yield result.line + "\n"
    for found in (result.early, result.gel):
        if found is not None:
            yield found.line + "\n"
    head = (
        "model",
        "component",
        "adj. R2",
        "about 0",
        "fitted",
        *result.SPLITS,
        "range",
        "% of range",
    )
    keys = (
        "adjusted_r2", "adjusted_r2_about_zero", "rmse_fitted",
        *(f"rmse_left_out_{split}" for split in result.SPLITS), "range", "percent_of_range",
    )  # fmt: skip
    shown = {result.best.name, result.paper.name}
    rows = [
        (row["model"], f"{row['component']}, {row['unit']}", *(row.get(key) for key in keys))
        for row in result.rows()
        if row["model"] in shown
    ]
    yield from table(head, rows)
    yield (
        f"\n{folder / 'force.json'} has all models; RMSE on the {len(result.data)} points "
        "fitted to, and on what was left out (unseen: position and indenter together; press, "
        "point: a fifth); "
        f"{result.calibration.head.origin}; as printed: the paper's table, on a real sensor"
    )
