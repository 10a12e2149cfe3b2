"""`deltact-fab analyze`: figures of recorded runs."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def analyze() -> None:
    """Analyses of recorded runs."""


@analyze.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--method",
    "methods",
    multiple=True,
    help="METHOD or METHOD/REFERENCE, repeatable; as in dis-fast or farneback/summed.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder; default RUN/analysis.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def tracking(run: Path, methods: tuple[str, ...], out: Path | None, as_json: bool) -> None:
    """Tracking error of dense flow at the dots (the paper's) and off the dots against truth."""
    from ..analysis.tracking_error import DEFAULT_METHODS, PAPER_BEST_MM, analyse
    from ..errors import MissingLibrary
    from .output import echo_json, echo_table, progress

    with progress("tracking error") as report:
        result = analyse(run, methods or DEFAULT_METHODS, progress=report)
    files = result.save(out or run / "analysis")
    if as_json:
        echo_json(result.as_dict())
        return
    keys = ("mean_at_dots_mm", "mean_off_dots_mm", "p95_off_dots_mm", "n_moving_px",
            "peak_true_mm", "ms_per_frame")  # fmt: skip
    rows = [(m["name"], "all", *(m[k] for k in keys)) for m in result.methods]
    rows += [(m["name"], m["indenter"], *(m[k] for k in keys)) for m in result.by_indenter]
    echo_table(("method", "indenter", *keys), rows)
    origin = f"simulated, seed {result.seed}" if result.simulated else "measured"
    click.echo(f"\n{origin}; the paper's best at the dots, on a real sensor: {PAPER_BEST_MM} mm")
    dots = result.dots
    if dots["mean_vs_truth_mm"] is not None:
        click.echo(
            f"dots against truth: mean {dots['mean_vs_truth_mm']:.4f} mm, "
            f"p95 {dots['p95_vs_truth_mm']:.4f} mm, {dots['lost']} lost"
        )
    try:
        from ..record import write_whole
        from ..report.figures import error_by_indenter, to_svg

        figure = (out or run / "analysis") / "tracking.svg"
        write_whole(figure, to_svg(error_by_indenter(result.by_indenter, PAPER_BEST_MM)).encode())
        files.append(figure)
    except MissingLibrary as why:
        click.echo(f"no figure: {why}", err=True)
    click.echo("written: " + ", ".join(str(f) for f in files))
