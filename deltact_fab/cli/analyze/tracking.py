"""`deltact-fab analyze tracking`: how far each tracker is off."""

from __future__ import annotations

from pathlib import Path

import click

from ..options import JSON, PATH, out_folder


@click.command(epilog="Example: deltact-fab analyze tracking smoke-run --method fused")
@click.argument("run", type=PATH)
@click.option(
    "--method",
    "methods",
    multiple=True,
    metavar="METHOD[/REFERENCE]",
    show_default="those worth comparing",
    help="fused, dis-medium, dis-fast, farneback-paper, or paper; as in dis-medium/static, "
    "with one of anchored (fused only), composed, summed, static; repeatable.",
)
@out_folder("Folder for the results.", show_default="RUN/analysis")
@JSON
def tracking(run: Path, methods: tuple[str, ...], out: Path | None, as_json: bool) -> None:
    """Tracking error against truth and, as in the paper, at the dots; and which method to use."""
    from ... import record
    from ...analysis.tracking_error import PAPER_BEST_MM, analyse
    from ...report.run_figures import error_by_time
    from ..output import echo_json, echo_table, progress, save_figures

    with progress("tracking error") as report:
        result = analyse(run, methods or None, progress=report)
    files = result.save(out or run / "analysis")
    if as_json:
        echo_json(result.as_dict())
        return
    for line in record.open(run).remarks()[0]:
        click.echo(f"warning: {line}")
    click.echo(result.verdict.line + "\n")
    keys = ("mean_off_dots_mm", "p95_off_dots_mm", "mean_confident_mm", "coverage",
            "confident_wrong_share", "mean_at_dots_mm", "peak_true_mm", "trusted_share",
            "ms_per_frame")  # fmt: skip
    rows = [
        (row["name"], row.get("indenter", "all"), *(row[key] for key in keys))
        for row in (*result.methods, *result.by_indenter)
    ]
    echo_table(("method", "indenter", *keys), rows, names=2)
    origin = f"simulated, seed {result.seed}" if result.simulated else "measured"
    click.echo(f"\n{origin}; the paper's best at the dots, on a real sensor: {PAPER_BEST_MM} mm")
    dots = result.dots
    if dots and dots["mean_vs_truth_mm"] is not None:
        click.echo(
            f"dots against truth: mean {dots['mean_vs_truth_mm']:.4f} mm, "
            f"at most {dots['max_vs_truth_mm']:.4f} mm, {dots['lost']} lost"
        )
    for line in result.left_out:
        click.echo(f"left out: {line}")
    files += save_figures(
        out or run / "analysis",
        lambda: {"tracking": error_by_time(result)},
    )
    click.echo("written: " + ", ".join(str(f) for f in files))
