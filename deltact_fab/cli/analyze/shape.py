"""`deltact-fab analyze shape`: density, depth and contacts, and their error against truth."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import JSON, PATH, out_folder


@click.command(epilog="Example: deltact-fab analyze shape smoke-run --depth depth.toml")
@click.argument("run", type=PATH)
@click.option("--depth", type=PATH, metavar="FILE",
              help="Calibration made by `calibrate depth`; without it depth is relative."
              )  # fmt: skip
@click.option("--force", type=PATH, metavar="FILE",
              help="Calibration made by `calibrate force`; with it force and pressure are drawn."
              )  # fmt: skip
@out_folder("Folder for the results.", show_default="RUN/analysis")
@JSON
def shape(
    run: Path, depth: Path | None, force: Path | None, out: Path | None, as_json: bool
) -> None:
    """Depth, contacts and the paper's relative depth of the settled frames, and their errors.

    Errors are against the truth of the virtual rig. The depth error is given over the contact and
    over the whole face; most of the face is not pressed, so the second figure flatters.
    """
    from ...analysis.shape import analyse
    from ...report.shape_figures import distribution, gallery
    from ..output import echo_json, echo_table, progress, save_figures

    folder = out or run / "analysis"
    with progress("shape") as report:
        result = analyse(run, depth, force, report)
    files = result.save(folder)
    if as_json:
        echo_json(result.as_dict())
        return
    click.echo(result.line + "\n")
    keys = ("frames", "depth_error_contact_mm", "depth_error_face_mm", "relative_correlation",
            "contact_iou", "centroid_error_mm", "place_error_mm", "area_mm2", "cover")  # fmt: skip
    rows = [("all", result.means()), *((name, result.means(name)) for name in result.indenters)]
    echo_table(("indenter", *keys), [(name, *(means[k] for k in keys)) for name, means in rows])
    click.echo(f"\n{result.note}")
    pictures, field, note = result.pictures, result.field, result.note
    files += save_figures(
        folder,
        lambda: {
            "shape": gallery(pictures, note) if pictures else None,
            "force-distribution": distribution(field, note) if field else None,
        },
    )
    click.echo("written: " + ", ".join(str(f) for f in files))
