"""`deltact-fab analyze`: errors of trackers and of shape; comparison of two sides."""

from __future__ import annotations

from pathlib import Path

import click

from .group import CommandGroup
from .options import PATH_TYPE, Quantity, RepeatedOptions, out_folder
from .output import Answer, answers, columns_of, files_line, progress, save_figures


@click.group(cls=CommandGroup)
def analyze() -> None:
    """Analyses of recorded runs: tracking error, shape, comparison."""


@analyze.command(epilog="Example: deltact-fab analyze tracking smoke-run --method fused")
@click.argument("run", type=PATH_TYPE)
@click.option("--method", "methods", multiple=True, metavar="METHOD[/REFERENCE]",
              show_default="fused and paper", help="paper, as the paper's group has published "
              "it; or fused, dis-medium, dis-fast, farneback; as in dis-medium/static, with one of "
              "anchored (fused only), composed, summed, static; repeatable.")  # fmt: skip
@out_folder("Folder for the results.", show_default="RUN/analysis")
@answers
def tracking(run: Path, methods: tuple[str, ...], out: Path | None) -> Answer:
    """Tracking error against truth and, as in the paper, at the dots; recommends a method."""
    from deltact_fab.bench import open_run
    from deltact_fab.estimate import analyse_tracking
    from deltact_fab.present import plot_error_by_time

    folder = out or run / "analysis"
    with progress("tracking error") as report:
        result = analyse_tracking(run, methods or None, progress=report)
    keys = ("mean_off_dots_mm", "p95_off_dots_mm", "mean_confident_mm", "coverage",
            "confident_wrong_share", "mean_at_dots_mm", "peak_true_mm", "trusted_share",
            "ms_per_frame")  # fmt: skip
    rows = [{"indenter": "all", **row} for row in (*result.methods, *result.by_indenter)]
    origin = f"simulated, seed {result.seed}" if result.simulated else "measured"
    lines = [
        *(f"warning: {line}" for line in open_run(run).remarks()[0]),
        f"{result.verdict.line}\n",
        *columns_of(("name", "indenter", *keys), rows),
        f"\n{origin}; the paper's best at the dots, on a real sensor: {result.PAPER_BEST_MM} mm",
    ]
    lines += [f"note: {line}" for line in result.left_out]
    files = result.save(folder) + save_figures(
        folder, lambda: {"tracking": plot_error_by_time(result)}
    )
    return Answer(result.as_dict(), [*lines, files_line(files)])


@analyze.command(epilog="Example: deltact-fab analyze shape smoke-run --depth depth.toml")
@click.argument("run", type=PATH_TYPE)
@click.option("--depth", type=PATH_TYPE, metavar="FILE",
              help="Depth calibration; without it depth is relative.")  # fmt: skip
@click.option("--force", type=PATH_TYPE, metavar="FILE",
              help="Force calibration; with it force and pressure are drawn.")  # fmt: skip
@out_folder("Folder for the results.", show_default="RUN/analysis")
@answers
def shape(run: Path, depth: Path | None, force: Path | None, out: Path | None) -> Answer:
    """Depth, contacts and the paper's relative depth of the settled frames, and their errors.

    Errors are against the truth of the virtual rig. The depth error is given over the contact and
    over the whole face, most of which is not pressed: the second figure is optimistic.
    """
    from deltact_fab.estimate import analyse_shape
    from deltact_fab.present import plot_distribution, plot_gallery

    folder = out or run / "analysis"
    with progress("shape") as report:
        result = analyse_shape(run, depth, force, report)
    files = result.save(folder)
    keys = ("frames", "depth_error_contact_mm", "depth_error_face_mm", "relative_correlation",
            "contact_iou", "centroid_error_mm", "place_error_mm", "area_mm2", "cover")  # fmt: skip
    rows = [{"indenter": name, **result.means(name)} for name in result.indenters]
    error_lines = columns_of(("indenter", *keys), [{"indenter": "all", **result.means()}, *rows])
    pictures, field, note = result.pictures, result.field, result.note
    files += save_figures(
        folder,
        lambda: {
            "shape": plot_gallery(pictures, note) if pictures else None,
            "force-distribution": plot_distribution(field, note) if field else None,
        },
    )
    lines = [f"{result.line}\n", *error_lines, f"\n{note}", files_line(files)]
    return Answer(result.as_dict(), lines)


@analyze.command(
    cls=RepeatedOptions,
    epilog="Example: deltact-fab analyze compare --a old-* --b new-* --margin 10%",
)
@click.option("--a", "a", type=PATH_TYPE, multiple=True, required=True, metavar="RUN",
              help="Run of side a; repeatable.")  # fmt: skip
@click.option("--b", "b", type=PATH_TYPE, multiple=True, required=True, metavar="RUN",
              help="Run of side b; repeatable.")  # fmt: skip
@click.option("--measure", default="tracking", show_default=True,
              type=click.Choice(["tracking", "time", "depth", "noise", "force"]),
              help="What is compared; smaller is better.")  # fmt: skip
@click.option("--margin", type=Quantity("%", "mm", "ms", "N"), default="10%", metavar="SIZE",
              show_default=True, help="Sides within it are equal: in %, or as 0.02mm.")  # fmt: skip
@click.option("--unit", default="sensor", show_default=True,
              type=click.Choice(["sensor", "gel", "print", "mounting"]),
              help="What is made anew between units.")  # fmt: skip
@click.option("--method", metavar="METHOD[/REFERENCE]", show_default="fused",
              help="Tracker of tracking and time, as of `analyze tracking`.")  # fmt: skip
@out_folder("Folder for comparison.json.")
@answers
def compare(
    a: tuple[Path, ...], b: tuple[Path, ...], measure: str, margin: tuple[float, str], unit: str,
    method: str | None, out: Path | None,
) -> Answer:  # fmt: skip
    """Difference of two sides of runs, with interval by units, and equality within a margin.

    Each unit is one sensor, by its serial number or as drawn by `run --sensor`; the presses on it
    are repeats. A run that names no unit is refused. With one unit a side the answer is about these
    two only. What the reference presses of a run show as drift is taken out.
    """
    from deltact_fab.estimate import Comparison, write_results

    with progress("comparison") as report:
        result = Comparison.from_runs(a, b, measure, margin, unit, method, progress=report)
    files = write_results(out, {"comparison.json": result.as_dict()}) if out else []
    lines = [
        *columns_of(("side", "unit", "figure", "presses"), result.rows),
        f"\n{result.line}",
        *(f"note: {note}" for note in result.notes),
    ]
    return Answer(result.as_dict(), [*lines, *([files_line(files)] if files else [])])
