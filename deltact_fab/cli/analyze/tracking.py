"""`deltact-fab analyze tracking`: how far each tracker is off."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import PATH, out_folder
from ..output import Answer, answers, columns_of, files_line, progress, save_figures


@click.command(epilog="Example: deltact-fab analyze tracking smoke-run --method fused")
@click.argument("run", type=PATH)
@click.option("--method", "methods", multiple=True, metavar="METHOD[/REFERENCE]",
              show_default="those worth comparing", help="fused, dis-medium, dis-fast, "
              "farneback-paper, or paper; as in dis-medium/static, with one of "
              "anchored (fused only), composed, summed, static; repeatable.")  # fmt: skip
@out_folder("Folder for the results.", show_default="RUN/analysis")
@answers
def tracking(run: Path, methods: tuple[str, ...], out: Path | None) -> Answer:
    """Tracking error against truth and, as in the paper, at the dots; and which method to use."""
    from ... import record
    from ...analysis.tracking_error import PAPER_BEST_MM, analyse
    from ...report.run_figures import error_by_time

    folder = out or run / "analysis"
    with progress("tracking error") as report:
        result = analyse(run, methods or None, progress=report)
    keys = ("mean_off_dots_mm", "p95_off_dots_mm", "mean_confident_mm", "coverage",
            "confident_wrong_share", "mean_at_dots_mm", "peak_true_mm", "trusted_share",
            "ms_per_frame")  # fmt: skip
    rows = [{"indenter": "all", **row} for row in (*result.methods, *result.by_indenter)]
    origin = f"simulated, seed {result.seed}" if result.simulated else "measured"
    lines = [
        *(f"warning: {line}" for line in record.open(run).remarks()[0]),
        f"{result.verdict.line}\n",
        *columns_of(("name", "indenter", *keys), rows),
        f"\n{origin}; the paper's best at the dots, on a real sensor: {PAPER_BEST_MM} mm",
    ]
    dots = result.dots
    if dots and dots["mean_vs_truth_mm"] is not None:
        lines.append(
            f"dots against truth: mean {dots['mean_vs_truth_mm']:.4f} mm, "
            f"at most {dots['max_vs_truth_mm']:.4f} mm, {dots['lost']} lost"
        )
    lines += [f"left out: {line}" for line in result.left_out]
    files = result.save(folder) + save_figures(folder, lambda: {"tracking": error_by_time(result)})
    return Answer(result.as_dict(), [*lines, files_line(files)])
