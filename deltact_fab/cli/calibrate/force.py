"""`deltact-fab calibrate force`: fit it, and say what it may be trusted to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ...errors import InputError
from ..options import PATH, out_file, out_folder, seed
from ..output import Answer, answers, files_line, progress, save_figures, table

if TYPE_CHECKING:
    from ...analysis.force import ForceResult
    from ...report.run_figures import predicted


@click.command(epilog="Example: deltact-fab calibrate force run1 run2 -o calibration.toml")
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
    from ...analysis.force import calibrate, carry_over, write_calibration

    folder = out or runs[0] / "analysis"
    output = file or folder / "calibration.toml"
    if transfer is not None:
        if models:
            raise InputError(
                "--model: does not go with --transfer, which keeps the model of its file"
            )
        with progress("transfer") as report:
            moved, kept, left_out = carry_over(runs, transfer, progress=report)
        told = [f"{moved.line} ({kept.head.origin})", *(f"left out: {line}" for line in left_out)]
        files = write_calibration(kept, output)
        data = {"transfer": moved.as_dict(), "left_out": left_out}
        return Answer(data, [*told, files_line(files)])
    with progress("force") as report:
        result = calibrate(runs, models or None, seed, progress=report)
    told = [*_lines(result, folder), *(f"left out: {line}" for line in result.left_out)]
    files, figure = result.save(folder, output), predicted(result)
    files += save_figures(folder, lambda: {figure.name: figure.draw()})
    return Answer(result.as_dict(), [*told, files_line(files)])


def _lines(result: ForceResult, folder: Path) -> Iterator[str]:
    from ...analysis.force import SPLITS

    yield result.line + "\n"
    for found in (result.early, result.gel):
        if found is not None:
            yield found.line + "\n"
    head = ("model", "component", "adj. R2", "about 0", "fitted", *SPLITS, "range", "% of range")
    keys = (
        "adjusted_r2", "adjusted_r2_about_zero", "rmse_fitted",
        *(f"rmse_left_out_{split}" for split in SPLITS), "range", "percent_of_range",
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
