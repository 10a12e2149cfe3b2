"""One offline HTML page of a run: what was made, moved, seen and measured, with its figures."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .. import record
from ..analysis.measured import MeasuredRun
from ..analysis.shape import ShapeResult
from ..analysis.tracking_error import (
    ARROW_STEP_PX,
    PAPER_BEST_MM,
    RULE,
    WRONG_MM,
    TrackingResult,
    percent,
    shown,
)
from ..errors import InputError
from . import figures, run_figures
from .templating import environment, render, save

if TYPE_CHECKING:
    import pandas as pd

DASH = "–"
ARROW_GAIN = 2.0
STRIP_FRAMES = 4


def write(
    run_folder: str | Path,
    out: Path,
    tracking: TrackingResult,
    measured: MeasuredRun | None = None,
    parts: dict[str, Any] | None = None,
    layer_costs: Sequence[dict[str, Any]] = (),
    shape: ShapeResult | None = None,
) -> Path:
    """Write the report of a run, its tracking analysis and what was measured to one file.

    measured: shape, contact and force of it; without it the page has no word of them. shape: its
    depth and contacts against truth.
    parts: `parts` (a row a part, with its formats) and `note` (why there are none), from the demo.
    layer_costs: what each layer costs that a scene may leave out, as `numerics` measured it; what
    was not measured is not in the page.
    Raises InputError for a run that is not finished, MissingLibrary without the extra `report`,
    RunFailed when the disk refuses.
    """
    pages = environment(fig=_fig, percent=_percent)
    pages.globals["shown"] = shown
    measured_costs = [cost for cost in layer_costs if cost["seconds"] is not None]
    run = record.open(run_folder)
    if not run.finished:
        raise InputError(f"{run_folder}: the run is not finished; go on with `run --resume`")
    frames, notes = run.frames(), run.notes()
    verdict = tracking.verdict
    drawn = {
        "by_time": run_figures.error_by_time(
            tracking.methods, verdict, PAPER_BEST_MM, run.simulated
        ),
        "by_indenter": run_figures.error_by_indenter(tracking.by_indenter, verdict, PAPER_BEST_MM),
        **_by_step(tracking),
    }
    if measured is not None and measured.force is not None:
        drawn["force"] = run_figures.force_by_frame(measured.force.frames)
    elif frames["fz_n"].notna().any():
        drawn["force"] = run_figures.force_by_frame(frames)
    if measured is not None and measured.deepest:
        drawn["shape"] = run_figures.deepest_presses(measured.deepest)
    page = render(
        pages,
        "run.html",
        meta=run.meta,
        summary=run.summary(),
        pattern=run.pattern,
        simulated=run.simulated,
        tracking=tracking.as_dict(),
        methods=_METHODS,
        at_dots=_AT_DOTS,
        measured=measured,
        shape=shape,
        rule=RULE,
        best=next(m for m in tracking.methods if m["name"] == verdict.about),
        paper_mm=PAPER_BEST_MM,
        figures={
            name: figures.to_svg(figure, _SHOWN.get(name, ""))
            for name, figure in drawn.items()
            if figure
        },
        pattern_png=_png(run.image(str(frames["file"].iloc[0]))),
        strips=_strips(run, frames, tracking),
        arrow_gain=ARROW_GAIN,
        parts=parts,
        layer_costs=measured_costs,
        counts=_counts(frames),
        # What operators said.
        notes=[
            {"at": f"{datetime.fromtimestamp(wall_s, UTC):%Y-%m-%d %H:%M} UTC", "text": text}
            for wall_s, text in zip(notes["wall_s"], notes["text"], strict=True)
        ],
    )
    return save(page, out)


# What a figure shows, where its axes do not say it all.
_SHOWN = {
    "shape": "depth, flow and contact on the face at the deepest press of each indenter",
    "force": "force on the sensor in x, y and z, N, against the frame",
}
# Above a column of the methods' tables: what stands in it.
_METHODS: dict[str, Callable[[dict[str, Any]], str]] = {
    "mean error over all moving pixels, mm": lambda m: _fig(m["mean_off_dots_mm"]),
    "95 % are below, mm": lambda m: _fig(shown(m, "p95_off_dots_mm")),
    "where it is sure, mm": lambda m: _fig(m["mean_confident_mm"]),
    "share known for sure": lambda m: _percent(
        m["confident_share"] if m["coverage"] is None else m["coverage"]
    ),
    f"of that off by over {WRONG_MM:g} mm": lambda m: _percent(m["confident_wrong_share"]),
    "frames trusted": lambda m: _percent(m["trusted_share"]),
    "CPU time a frame, ms: median": lambda m: _fig(m["cpu_ms"]["p50"], 1),
    "95 % are below, ms": lambda m: _fig(m["cpu_ms"]["p95"], 1),
}
_AT_DOTS: dict[str, Callable[[dict[str, Any]], str]] = {
    "at dots, mm": lambda m: _fig(m["mean_at_dots_mm"]),
    "at moving dots, mm": lambda m: _fig(m["mean_at_moving_dots_mm"]),
    "still pixels, mm": lambda m: _fig(m["mean_still_mm"]),
    "read as in-plane, mm": lambda m: _fig(m["mean_as_in_plane_mm"]),
    "moving px": lambda m: _fig(m["n_moving_px"]),
    "new references": lambda m: str(m["reference_switches"]),
}


def _by_step(tracking: TrackingResult) -> dict[str, Any]:
    """Error and coverage against the frame, of whatever of them is known."""
    names = [m["name"] for m in tracking.methods]
    error, words = tracking.verdict.error, tracking.verdict.error_words
    table, drawn = tracking.frames, {}
    if error is not None:
        label = f"mean error, mm\n({words})"
        drawn["by_step"] = run_figures.by_step(table, names, error, label)
    with_truth = table["coverage"].notna().any()
    sure, of = ("coverage", "moving pattern") if with_truth else ("confident_share", "image")
    if len(table):
        label = f"share of the {of}\nthat is known for sure"
        drawn["sure_by_step"] = run_figures.by_step(table, names, sure, label, log=False)
    return drawn


def _percent(value: float | None) -> str:
    return DASH if value is None else percent(value).replace(" ", "\u00a0")


def _fig(value: Any, digits: int = 4) -> str:
    """A number as a person reads it; a dash where nothing was measured."""
    if value is None:
        return DASH
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")  # a thin space that does not break
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value)


def _counts(frames: pd.DataFrame) -> dict[str, Any]:
    counts: dict[str, Any] = {"frames": len(frames), "presses": frames["press"].nunique()}
    if frames["fz_n"].notna().any():
        counts["peak_normal_n"] = float((-frames["fz_n"]).max())
        counts["peak_shear_n"] = float(frames[["fx_n", "fy_n"]].abs().to_numpy().max())
    return counts


def _strips(
    run: record.Run, frames: pd.DataFrame, tracking: TrackingResult
) -> list[dict[str, Any]]:
    """A strip an indenter: the end of the press and the extremes of shear, with flow arrows."""
    import cv2

    strips = []
    for indenter in dict.fromkeys(frames["indenter"]):
        part = frames[frames["indenter"] == indenter]
        ends = part.groupby("step_id", sort=False).tail(1)
        ends = ends[ends["kind"].isin(["press", "shear"])]
        chosen = ends.head(1 + 3 * (STRIP_FRAMES - 1))
        keep = [i for i, s in enumerate(chosen["step_id"]) if not str(s).endswith("0")]
        pictures = []
        for row in chosen.iloc[keep[:STRIP_FRAMES]].itertuples():
            image = run.image(str(row.file))
            arrows = tracking.arrows.get(str(row.frame_id))
            if arrows is not None:
                image = run_figures.flow_picture(image, arrows, ARROW_STEP_PX, ARROW_GAIN)
            # Six tenths of the size: a strip shows four pictures side by side.
            small = cv2.resize(image, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
            pictures.append(
                {
                    "src": _png(np.asarray(small, np.uint8)),
                    "caption": str(row.step_id).rsplit("/", 1)[-1],
                    "pose": "pose not recorded"
                    if np.isnan(row.z_mm)
                    else f"x {row.x_mm:+.2f}, y {row.y_mm:+.2f}, z {row.z_mm:+.2f} mm",
                }
            )
        strips.append({"indenter": indenter, "pictures": pictures})
    return strips


def _png(image: NDArray[np.uint8]) -> str:
    """A data URL; JPEG would smear the pattern."""
    return "data:image/png;base64," + base64.b64encode(record.encode_png(image)).decode()
