"""Offline HTML page of a run: settings, motion, images, measurements, figures."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from deltact_fab.bench import Run, encode_png, load_protocol, open_run
from deltact_fab.common import Check, InputError, graded, html_table, read_json, write_page
from deltact_fab.estimate import (
    Comparison,
    DeepestPress,
    Interval,
    RunMeasurement,
    ShapeResult,
    TrackingResult,
)

from . import figures, run_figures

DOUBTFUL_PERCENT = 20.0  # by hand, error of the range: above, a fifth of a press is unknown
THUMBNAIL_SCALE = 0.6  # by hand: pictures of presses side by side; larger makes the page heavy


def write_run_page(
    run_folder: str | Path,
    out: Path,
    tracking: TrackingResult,
    measured: RunMeasurement | None = None,
    parts: dict[str, Any] | None = None,
    shape: ShapeResult | None = None,
) -> Path:
    """Write the report of a run, its tracking analysis and measurements to one file.

    measured: shape, contact and force; omitted from the page if None. shape: depth and contacts
    against truth. parts: `parts` (a row per part, with its formats) and `note` (reason for none),
    from the demo. Raises InputError for an unfinished run, MissingLibrary without the extra
    `report`, RunFailed if the disk refuses.
    """
    run = open_run(run_folder)
    if not run.finished:
        raise InputError(f"{run_folder}: the run is not finished; continue with `run --resume`")
    frames, notes, verdict = run.frames(), run.notes(), tracking.verdict
    warned, remarks = run.remarks()
    charts = {
        "by_time": run_figures.plot_error_by_time(tracking),
        "by_step": run_figures.plot_error_by_step(tracking),
    }
    if measured is not None and measured.force is not None:
        charts["force"] = run_figures.plot_force_by_frame(measured.force.frames)
    elif frames["fz_n"].notna().any():
        charts["force"] = run_figures.plot_force_by_frame(frames)
    deepest = measured.deepest if measured is not None else []
    if deepest:
        charts["shape"] = run_figures.plot_deepest_presses(deepest)
    return write_page(
        out,
        "run.html",
        [*plan_checks(run), *_run_checks(warned, tracking, measured, shape)],
        meta=run.meta,
        summary=run.summary(),
        simulated=run.simulated,
        tracking=tracking.as_dict(),
        doubts={name: reasons for name, reasons in verdict.doubts.items() if reasons},
        remarks=remarks,
        methods=_methods(tracking),
        measured=measured,
        shape=shape,
        rule=tracking.RULE,
        best=next(m for m in tracking.methods if m["name"] == verdict.about),
        paper_mm=tracking.PAPER_BEST_MM,
        figures={
            name: figures.to_svg(figure, _FIGURE_WORDS.get(name, ""))
            for name, figure in charts.items()
            if figure
        },
        pictures=[_picture(run, frames, press) for press in deepest],
        contacts=html_table(pd.DataFrame([row for press in deepest for row in _contacts(press)])),
        parts=parts,
        made=html_table(pd.DataFrame(parts["parts"] if parts else [])),
        counts={
            "frames": len(frames),
            "presses": frames["press"].nunique(),
            "normal_n": (-frames["fz_n"]).max(),
            "shear_n": frames[["fx_n", "fy_n"]].abs().to_numpy(float).max(),
        },
        pattern=_picture(run, frames),
        settings=html_table(_settings(run)),
        notes=[
            f"{datetime.fromtimestamp(wall_s, UTC):%Y-%m-%d %H:%M} UTC: {text}"
            for wall_s, text in zip(notes["wall_s"], notes["text"], strict=True)
        ],
    )


def write_imported_page(run: Run, out: Path) -> Path:
    """Write the page of an imported run: its data, notes, force and motion.

    With the verdict of `calibrate force`, if any. Raises like `write_run_page`.
    """
    frames, summary = run.frames(), run.summary()
    if not summary or frames.empty:
        raise InputError(f"{run.folder}: incomplete; import it again")
    t_s = frames["t_s"] - frames["t_s"].iloc[0]
    figure = run_figures.plot_force_motion(t_s, frames, summary["moved_px"])
    farthest = frames.iloc[int(np.argmax(summary["moved_px"]))]
    force = run.folder / "analysis" / "force.json"
    force_data = read_json(force) if force.is_file() else {}
    if "verdict" in force_data:
        share = force_data["models"][force_data["best"]]["normal"]["percent_of_range"]
        status = graded(True, warns=share is None or share > DOUBTFUL_PERCENT)
        text = f"Force from the flow: {force_data['verdict']}."
        checks = [Check("force", value=text, status=status)]
    else:
        text = "Force from the flow is not calibrated; run `calibrate force`."
        checks = [Check("force", value=text, status="warn")]
    warned, remarks = run.remarks()
    counts = {
        "images": f"{len(frames)} of {' x '.join(map(str, run.meta['imported']['image_px']))} px",
        "time, s": t_s.iloc[-1],
        **{f"samples of {name}": n for name, n in summary["samples"].items()},
        **{f"SHA-256 of {name}": digest for name, digest in run.meta["imported"]["sha256"].items()},
    }
    return write_page(
        out,
        "imported.html",
        [
            *Check.warnings("run", warned),
            *checks,
            *Check.warnings("left-out", force_data.get("left_out", [])),
        ],
        name=run.meta["name"],
        about=run.meta["protocol"]["description"],
        notes=[*remarks, *run.notes()["text"]],
        figure=figures.to_svg(figure, "force on the sensor and motion of the image over time"),
        pictures=[
            _thumbnail(run, frames.iloc[0], "first image, reference of the motion"),
            _thumbnail(run, farthest, f"largest motion, after {farthest['t_press_s']:.2f} s"),
        ],
        known=html_table(pd.DataFrame(counts.items(), columns=["what", "value"])),
    )


def plan_checks(run: Run) -> Iterator[Check]:
    """Checks of a run that was planned: promised beside reached, and what was not as planned."""
    promise = run.meta["protocol"].get("promise")
    if promise is None:
        return
    unit, goal, (low, high) = promise["unit"], promise["goal"], promise["interval"]
    upper = f"{high:.2g}" if high < 100 else f"{high:.0f}"
    text = (
        f"Promised: {promise['measure']} to {promise['error']:.2g} {unit} [{low:.2g} to {upper}], "
        f"goal {goal:g} {unit} with chance {promise['chance']:.2g}. "
    )
    reached, remedy = _reached(run, promise["measure"], unit == "%")
    if reached is None:
        yield Check("plan", value=f"{text}Reached: unknown; {remedy}.", status="warn")
    else:
        value, bound = reached.value, reached.high
        span = "" if bound is None else f" [{reached.low:.2g} to {bound:.2g}]"
        promised = low <= value <= high
        result = "met" if value <= goal else "missed"
        if bound is not None and bound <= goal:
            result = "shown"
        text += f"Reached: {value:.2g} {unit}{span} over {reached.over}; the goal is {result}"
        text += "." if promised else ", outside of what was promised."
        # The interval of a mean is what it is; an error on presses to validate is an estimate.
        goal_word = "shown" if promise["measure"] == "normal force" else "met"
        warns = result not in ("shown", goal_word) or not promised
        yield Check("plan", value=text, status=graded(True, warns=warns))
    protocol, _ = load_protocol(str(run.folder / "protocol.toml"))
    deviations = []
    if protocol.digest != promise["digest"]:
        deviations.append("The protocol was changed after it was planned.")
    if skipped := len(run.skipped):
        deviations.append(f"{skipped} planned presses and changes were skipped.")
    yield from Check.warnings("plan-deviation", deviations)


def _reached(run: Run, measure: str, relative: bool) -> tuple[Interval | None, str]:
    """Return what a planned run reached, or None and the reason or remedy.

    Error on presses to validate, of the last `calibrate force`; half width of a mean's interval.
    """
    name = measure.partition(" of ")[2]
    if name:
        return None, f"run `analyze compare --measure {name}` with the runs of both sides"
    if measure == "normal force":
        file = run.folder / "analysis" / "force.json"
        reached = read_json(file).get("validation", {}).get("normal") if file.is_file() else None
        return None if reached is None else Interval(**reached), "run `calibrate force`"
    try:
        mean = Comparison.mean_interval(run, measure.split()[1], relative)
    except InputError as error:
        return None, str(error)
    if mean.low is None or mean.high is None:
        return None, mean.over
    half = (mean.high - mean.low) / 2
    half = 100 * float(np.expm1(half)) if relative else half
    return Interval(half, None, None, mean.over), ""


def _run_checks(
    warned: list[str],
    tracking: TrackingResult,
    measured: RunMeasurement | None,
    shape: ShapeResult | None,
) -> Iterator[Check]:
    """Checks of a run: warnings on its recording first."""
    yield from Check.warnings("run", (f"{line[:1].upper()}{line[1:]}." for line in warned))
    yield Check("tracking", value=tracking.verdict.line, status=graded(tracking.verdict.trusted))
    if shape is not None:
        status = graded(True, warns=bool(shape.missed))
        yield Check("shape", value=f"Shape and contact: {shape.line}", status=status)
    if measured is not None and (force := measured.force) is not None:
        yield Check(
            "force", value=f"{force.line}.", status=graded(True, warns=bool(force.doubtful))
        )


# Alternative text of figures, if the axes are not sufficient.
_FIGURE_WORDS = {
    "shape": "depth, flow and contact on the face at the deepest press of each indenter",
    "force": "force on the sensor in x, y and z, N, against the frame",
}


def _methods(tracking: TrackingResult) -> dict[str, Any]:
    """Table of methods, the recommended one marked, with the paper's below."""
    verdict, rows = tracking.verdict, []
    for m in tracking.methods:
        confident = m["confident_share"] if m["coverage"] is None else m["coverage"]
        rows.append(
            {
                "method / reference": m["name"],
                "mean error over all moving pixels, mm": m["mean_off_dots_mm"],
                "95th percentile, mm": m["p95_off_dots_mm"],
                "error on confident pixels, mm": m["mean_confident_mm"],
                "share of confident pixels": _percent(confident),
                f"confident but >{tracking.WRONG_MM:g} mm off": _percent(
                    m["confident_wrong_share"]
                ),
                "at the dots, mm": m["mean_at_dots_mm"],
                "frames trusted": _percent(m["trusted_share"]),
                "CPU time per frame, ms": m["ms_per_frame"],
                "reference switches": m["reference_switches"],
                "reliable": "no" if verdict.doubts[m["name"]] else "yes",
            }
        )
    marks = ["take" if m["name"] == verdict.take else "" for m in tracking.methods]
    if any(m["mean_at_dots_mm"] is not None for m in tracking.methods):
        rows.append(
            {"method / reference": "the paper's own", "at the dots, mm": tracking.PAPER_BEST_MM}
        )
        marks.append("")
    return html_table(pd.DataFrame(rows), marks=marks)


def _contacts(press: DeepestPress) -> list[dict[str, Any]]:
    """Rows of a press's contacts; none if contacts were not requested."""
    result = press.result
    if result.contacts is None:
        return []
    about = {"indenter": press.indenter, "frame": press.frame_id, "cover": _percent(result.cover)}
    return [
        {
            **about,
            "position x, y, mm": f"{c.place_mm[0]:.2f}, {c.place_mm[1]:.2f}",
            "area_mm2": c.area_mm2,
            "peak_depth_mm": c.peak_depth_mm,
            "share of the force": _percent(c.force_share),
            "number": c.count,
            "resolution_mm": c.resolution_mm,
        }
        for c in result.contacts
    ] or [{**about, "position x, y, mm": "no contact found"}]


def _settings(run: Run) -> pd.DataFrame:
    """Settings of the run."""
    pattern, stage = run.pattern, run.summary()["devices"]["stage"]
    recipe = {
        f"pattern: {key}": str(value)
        for key, value in pattern["recipe"].items()
        if value is not None and not isinstance(value, dict)
    }
    dots = pattern.get("dots_mm")
    extra = {
        "dots": f"{len(dots)} of {pattern['dot_diameter_mm']} mm" if dots else "none",
        "seed": str(run.meta["seed"]),
        "controller": stage["banner"] if stage else "none: weights placed by hand",
    }
    settings = {**recipe, **extra, **run.meta["versions"]}
    return pd.DataFrame(settings.items(), columns=["setting", "value"])


def _percent(value: float | None) -> str:
    return "" if value is None else TrackingResult.format_percent(value).replace(" ", "\u00a0")


def _picture(run: Run, frames: pd.DataFrame, press: DeepestPress | None = None) -> Any:
    """Image of a press, or the pattern at rest, as a data URL, and its caption."""
    row = frames.iloc[0] if press is None else frames[frames["frame_id"] == press.frame_id].iloc[0]
    caption = "at rest" if press is None else f"{press.indenter}, {press.depth_mm:.2f} mm deep"
    return _thumbnail(run, row, caption)


def _thumbnail(run: Run, row: pd.Series[Any], caption: str) -> dict[str, str]:
    """Thumbnail of a frame as a data URL, and its caption."""
    import cv2

    image, scale = run.image(str(row["file"])), THUMBNAIL_SCALE
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # JPEG would blur the pattern.
    png = base64.b64encode(encode_png(np.asarray(small, np.uint8))).decode()
    return {"src": f"data:image/png;base64,{png}", "caption": caption}
