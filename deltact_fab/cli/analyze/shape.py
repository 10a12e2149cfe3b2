"""`deltact-fab analyze shape`: density, depth and contacts, and their error against truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ...analysis.shape import ShapeResult


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--depth",
    type=click.Path(path_type=Path),
    metavar="depth.toml",
    help="Calibration by `calibrate-depth`; without it the depth is uncalibrated.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder; default RUN/analysis.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def shape(run: Path, depth: Path | None, out: Path | None, as_json: bool) -> None:
    """Depth, contacts and the paper's relative depth of settled frames, and how far they are off.

    Errors are against the virtual rig's truth. The depth's stands twice, over the contact and over
    the face: most of a face is not pressed, so the second one flatters.
    """
    from ...analysis.shape import analyse
    from ..output import echo_json, progress, save_figures

    folder = out or run / "analysis"
    with progress("shape") as report:
        result = analyse(run, depth, progress=report)
    files = result.save(folder)
    if as_json:
        echo_json(result.as_dict())
        return
    _tell(result)
    files += save_figures(folder, lambda: _figures(result))
    click.echo("written: " + ", ".join(str(f) for f in files))


def _tell(result: ShapeResult) -> None:
    from ..output import echo_table

    click.echo(result.line + "\n")
    keys = ("frames", "depth_error_contact_mm", "depth_error_face_mm", "relative_correlation",
            "contact_iou", "centroid_error_mm", "place_error_mm", "area_mm2", "cover")  # fmt: skip
    rows = [("all", result.means()), *((name, result.means(name)) for name in result.indenters)]
    echo_table(("indenter", *keys), [(name, *(means[k] for k in keys)) for name, means in rows])
    click.echo(f"\n{result.note}")


def _figures(result: ShapeResult) -> dict[str, Any]:
    from ...report.shape_figures import gallery

    return {"shape": gallery(result.pictures, result.note)} if result.pictures else {}
