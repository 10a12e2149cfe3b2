"""`deltact-fab calibrate lens`: the lens from images of boards."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ...errors import InputError
from ...files import write_whole
from ..options import DESIGN, PATH, out_file
from ..output import Answer, answers, columns_of

if TYPE_CHECKING:
    from ...measure.lens import Calibration, Checkerboard


@click.command(
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
    from ...cad.design import load_design
    from ...measure.lens import calibrate, flat_field

    wanted = board_named(board, "--board")
    held = None if air_board is None else board_named(air_board, "--air-board")
    if out.suffix != ".toml":
        raise click.BadParameter(f"{out}: a camera file ends in .toml", param_hint="-o")
    found = calibrate(_files(images), wanted, _files(air), held, load_design(design))
    field = None if flat is None else flat_field(flat, found.lens)
    beside = out.with_suffix(".flat.png")
    if field is not None:
        write_whole(beside, field.png())
    write_whole(out, found.camera_toml(None if field is None else beside.name).encode())
    named = None if field is None else beside.name
    data = {"camera": found.lens.as_dict(), **found.as_dict(), "flat": named}
    told = f"written: {out}" + ("" if field is None else f", {beside}")
    return Answer(data, [*_lines(found), told])


def board_named(words: str, option: str) -> Checkerboard:
    """A board by its numbers, or the catalogue's chessboard skin."""
    from ...measure.lens import Checkerboard
    from ...patterns import load_recipe

    if words != "skin":
        return Checkerboard.parse(words, option)
    recipe = load_recipe("chessboard")
    assert recipe.patch_mm is not None
    return Checkerboard(recipe.n, recipe.n, recipe.patch_mm, skin=True)


def _files(names: tuple[Path, ...]) -> list[Path]:
    """Files as they are named, and the images in the folders among them."""
    from ...rig.camera.files import IMAGE_NAMES

    files: list[Path] = []
    for name in names:
        inside = sorted(p for p in name.glob("*") if p.suffix.lower() in IMAGE_NAMES)
        if name.is_dir() and not inside:
            raise InputError(f"{name}: no image in this folder ({', '.join(IMAGE_NAMES)})")
        files += inside if name.is_dir() else [name]
    return files


def _lines(found: Calibration) -> Iterator[str]:
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
