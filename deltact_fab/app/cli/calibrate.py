"""`deltact-fab calibrate`: lens, depth and force calibrations, one file each."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from deltact_fab.common import InputError, write_whole

from .group import CommandGroup
from .options import DESIGN_OPTION, PATH_TYPE, out_file, out_folder, seed
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
@click.argument("images", nargs=-1, type=PATH_TYPE)
@click.option("--board", required=True, metavar="skin|NXxNYxMM", help="Board in IMAGES.")
@click.option("--air", multiple=True, type=PATH_TYPE, metavar="PATH",
              help="Image or folder of images of a board in the air; repeatable.")  # fmt: skip
@click.option("--air-board", metavar="NXxNYxMM", show_default="same as --board",
              help="Board in --air.")  # fmt: skip
@click.option("--flat", type=PATH_TYPE, metavar="FILE",
              help="Image of a blank skin, to correct the shading.")  # fmt: skip
@DESIGN_OPTION
@click.option("--serial", metavar="TEXT", help="Serial number of the sensor, for its ledger.")
@out_file("Camera file to write, .toml.", required=True)
@answers
def lens(
    images: tuple[Path, ...], board: str, air: tuple[Path, ...], air_board: str | None,
    flat: Path | None, design: str, serial: str | None, out: Path,
) -> Answer:  # fmt: skip
    """Calibrate the camera through its lens, plate and gel, from IMAGES of a board on the face.

    IMAGES (files or folders) are contact images: the board touches the outer face of the clear gel
    with no air between. Best is one image of the shipped chessboard skin (`pattern sheet
    chessboard`) with --board skin; its middle, the origin of the sensor, must be within 0.8 mm of
    the middle of the image, and the skin turned by less than 45 degrees. Otherwise wet a board onto
    the face at five or more positions that together cover the view; --board 9x7x3 is a board of 9 x
    7 squares of 3 mm.

    Boards in the air beyond the face (--air), tilted and at several heights, improve the
    calibration below the face; on their own they leave the face undetermined. The thicknesses of
    --design are the prior values.
    """
    from deltact_fab.bench import SensorLedger
    from deltact_fab.estimate import calibrate_lens, fit_flat_field
    from deltact_fab.fabricate import load_design

    on_face = parse_board(board, "--board")
    in_air = None if air_board is None else parse_board(air_board, "--air-board")
    if out.suffix != ".toml":
        raise click.BadParameter(f"{out}: must end in .toml", param_hint="-o")
    result = calibrate_lens(_files(images), on_face, _files(air), in_air, load_design(design))
    field = None if flat is None else fit_flat_field(flat, result.lens)
    flat_file = out.with_suffix(".flat.png")
    if field is not None:
        write_whole(flat_file, field.to_png())
    flat_name = None if field is None else flat_file.name
    text = result.camera_toml(flat_name).encode()
    write_whole(out, text)
    data = {"camera": result.lens.as_dict(), **result.as_dict(), "flat": flat_name}
    summary = f"written: {out}" + ("" if field is None else f", {flat_file}")
    id, simulated = hashlib.sha256(text).hexdigest()[:12], result.simulated is not None
    asides = SensorLedger.add_event("lens", serial=serial, id=id, file=out, simulated=simulated)
    return Answer(data, [*_lens_lines(result), summary], asides=asides)


def parse_board(words: str, option: str) -> Checkerboard:
    """Parse a board such as 9x7x3, or return the chessboard skin of the catalogue."""
    from deltact_fab.fabricate import load_recipe
    from deltact_fab.sensor import Checkerboard

    if words != "skin":
        return Checkerboard.parse(words, option)
    recipe = load_recipe("chessboard")
    assert recipe.patch_mm is not None
    return Checkerboard(recipe.n, recipe.n, recipe.patch_mm, skin=True)


def _files(names: tuple[Path, ...]) -> list[Path]:
    """Return the files named, and the images in the folders named."""
    from deltact_fab.bench import ImageFolder

    files: list[Path] = []
    for name in names:
        inside = sorted(p for p in name.glob("*") if p.suffix.lower() in ImageFolder.SUFFIXES)
        if name.is_dir() and not inside:
            raise InputError(f"{name}: no image in this folder ({', '.join(ImageFolder.SUFFIXES)})")
        files += inside if name.is_dir() else [name]
    return files


def _lens_lines(calibration: LensCalibration) -> Iterator[str]:
    data = calibration.as_dict()
    parameters = [{"parameter": name, **p} for name, p in data["parameters"].items()]
    yield from columns_of(("parameter", "value", "sigma", "prior", "prior_sigma"), parameters)
    yield ""
    columns = ("file", "board", "contact", "corners", "outliers", "rms_px")
    yield from columns_of(columns, data["images"])
    yield (
        "\nuncertainty in px of the raw image (one sigma, over 95 % of the view): "
        f"face {calibration.face_px:.3f}, "
        f"3 mm below {calibration.depth_px[3.0]:.2f}, 6 mm below {calibration.depth_px[6.0]:.2f}"
    )
    yield f"contact corners cover {calibration.cover:.0%} of the view"
    if calibration.simulated is not None:
        yield f"simulated images, seed {', '.join(map(str, calibration.simulated))}"
    yield from (f"note: {line}" for line in calibration.notes())


@calibrate.command(epilog="Example: deltact-fab calibrate depth ball-run -o depth.toml")
@click.argument("run", type=PATH_TYPE)
@click.option("--force", type=PATH_TYPE, metavar="FILE", show_default="the design's gel",
              help="Force calibration whose gel to use; both are then as fast as one.")  # fmt: skip
@out_file("Calibration to write.", default=Path("depth.toml"))
@answers
def depth(run: Path, force: Path | None, out: Path) -> Answer:
    """Calibrate depth on RUN, in which a ball of known diameter presses the face.

    Uses the images, the positions of the stage and the diameter of the ball. The protocol
    `ball-press` records such a run.
    """
    from deltact_fab.bench import SensorLedger
    from deltact_fab.estimate import calibrate_depth

    result = calibrate_depth(run, force)
    write_whole(out, result.toml().encode())
    data, lines = {**result.as_dict(), "file": str(out)}, [result.line, f"written: {out}"]
    return Answer(data, lines, asides=SensorLedger.add_event("depth", [run], file=out))


@calibrate.command(epilog="Example: deltact-fab calibrate force run1 run2 -o calibration.toml")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...", type=PATH_TYPE)
@click.option("--model", "models", multiple=True, metavar="MODEL",
              show_default="all", help="sums, paper or inverse-placed; repeatable.")  # fmt: skip
@click.option("--transfer", type=PATH_TYPE, metavar="OTHER.toml", help="Adapt another sensor's "
              "calibration, using the few presses of RUN.")  # fmt: skip
@out_file("Calibration to write.", "file", show_default="calibration.toml in --out")
@out_folder("Folder for the results.", show_default="RUN/analysis")
@seed("Seed of the folds and the learning curve.")
@answers
def force(
    runs: tuple[Path, ...], models: tuple[str, ...], transfer: Path | None, file: Path | None,
    out: Path | None, seed: int,
) -> Answer:  # fmt: skip
    """Calibrate force on runs of one sensor: cross-validate models and write the best one.

    The points are the settled frames. Models are ranked by their error on unseen positions and
    indenters together; errors on unseen presses, points and runs are reported too. The best model
    is shown beside the paper's; force.json has all of them.
    """
    from deltact_fab.bench import SensorLedger
    from deltact_fab.estimate import calibrate_force, transfer_calibration, write_force_calibration
    from deltact_fab.present import plot_predicted_force

    folder = out or runs[0] / "analysis"
    output = file or folder / "calibration.toml"
    if transfer is not None:
        if models:
            raise InputError(
                "--model cannot be used with --transfer, which keeps the model of its file"
            )
        with progress("transfer") as report:
            fit, carried, notes = transfer_calibration(runs, transfer, progress=report)
        lines = [f"{fit.line} ({carried.head.origin})", *(f"note: {line}" for line in notes)]
        files = write_force_calibration(carried, output)
        data: dict[str, Any] = {"transfer": fit.as_dict(), "left_out": notes}
    else:
        with progress("force") as report:
            result = calibrate_force(runs, models or None, seed, progress=report)
        lines = [*_force_lines(result, folder), *(f"note: {line}" for line in result.notes)]
        files, figure = result.save(folder, output), plot_predicted_force(result)
        files += save_figures(folder, lambda: {figure.name: figure.draw()})
        data = result.as_dict()
    asides = SensorLedger.add_event("force", runs, file=output)
    return Answer(data, [*lines, files_line(files)], asides=asides)


def _force_lines(result: ForceResult, folder: Path) -> Iterator[str]:
    yield result.line + "\n"
    yield from (f"{finding}\n" for finding in result.findings)
    head = (
        "model",
        "component",
        "adj. R2",
        "R2 about 0",
        "fitted",
        *result.SPLITS,
        "range",
        "% of range",
    )
    keys = (
        "adjusted_r2", "adjusted_r2_about_zero", "rmse_fitted",
        *(f"rmse_left_out_{split}" for split in result.SPLITS), "range", "percent_of_range",
    )  # fmt: skip
    model_names = {result.best.name, result.paper.name}
    rows = [
        (row["model"], f"{row['component']}, {row['unit']}", *(row.get(key) for key in keys))
        for row in result.rows()
        if row["model"] in model_names
    ]
    yield from table(head, rows)
    yield (
        f"\nall models: {folder / 'force.json'}; {result.calibration.head.origin}; RMSE on the "
        f"{len(result.data)} fitted points, and on points not fitted (unseen: position and "
        "indenter together; press, point: a fifth); as printed: the paper's table, real sensor"
    )
