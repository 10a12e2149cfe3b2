"""`deltact-fab analyze shape`: density, depth and contacts, and their error against truth."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import PATH, out_folder
from ..output import Answer, answers, columns_of, files_line, progress, save_figures


@click.command(epilog="Example: deltact-fab analyze shape smoke-run --depth depth.toml")
@click.argument("run", type=PATH)
@click.option("--depth", type=PATH, metavar="FILE", help="Calibration made by `calibrate depth`; "
              "without it depth is relative.")  # fmt: skip
@click.option("--force", type=PATH, metavar="FILE", help="Calibration made by `calibrate force`; "
              "with it force and pressure are drawn.")  # fmt: skip
@out_folder("Folder for the results.", show_default="RUN/analysis")
@answers
def shape(run: Path, depth: Path | None, force: Path | None, out: Path | None) -> Answer:
    """Depth, contacts and the paper's relative depth of the settled frames, and their errors.

    Errors are against the truth of the virtual rig. The depth error is given over the contact and
    over the whole face; most of the face is not pressed, so the second figure flatters.
    """
    from ...analysis.shape import analyse
    from ...report.shape_figures import distribution, gallery

    folder = out or run / "analysis"
    with progress("shape") as report:
        result = analyse(run, depth, force, report)
    files = result.save(folder)
    keys = ("frames", "depth_error_contact_mm", "depth_error_face_mm", "relative_correlation",
            "contact_iou", "centroid_error_mm", "place_error_mm", "area_mm2", "cover")  # fmt: skip
    rows = [{"indenter": name, **result.means(name)} for name in result.indenters]
    told = columns_of(("indenter", *keys), [{"indenter": "all", **result.means()}, *rows])
    pictures, field, note = result.pictures, result.field, result.note
    files += save_figures(
        folder,
        lambda: {
            "shape": gallery(pictures, note) if pictures else None,
            "force-distribution": distribution(field, note) if field else None,
        },
    )
    lines = [f"{result.line}\n", *told, f"\n{note}", files_line(files)]
    return Answer(result.as_dict(), lines)
