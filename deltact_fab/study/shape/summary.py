"""The results of presses of objects: verdict, tables, figures, data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import pandas as pd

from ...analysis.shape import GOALS, PressShape, ShapeMaps
from ...report import shape_figures
from ...report.result import Headline, ReportFigure, ReportTable, StudyResult, records
from ..intervals import Interval, Scale, estimate, headline, rmse, told

NINE_D_TACT_MM = 0.0462
"""Mean depth error that 9DTact gives of one press of a ball (arXiv 2308.14277)."""
NINE_D_TACT = (
    f"9DTact gives {NINE_D_TACT_MM:g} mm for one ball: another sensor, a real one, and another "
    "experiment"
)
NORMAL = "Normal force by the flow"
FEWEST = 3
"""Groups of an interval."""
GOAL_N = 0.2
GOAL_FIELD = 0.3
"""Of the peak pressure, in the mean over the contact."""


def headlines(frames: pd.DataFrame, force_left_out_n: float | None = None) -> tuple[Headline, ...]:
    """Of what has a truth, or a force sensor; their intervals are over presses or places."""
    found: list[Headline] = []
    if "depth_error_contact_mm" in frames:
        found += _depth(frames)
    if {"found_normal_n", "normal_n"} <= set(frames.columns):
        found += _force(frames.dropna(subset=["found_normal_n", "normal_n"]), force_left_out_n)
    if "pressure_error" in frames:
        both = frames.dropna(subset=["pressure_error"])
        share = (both["peak_kpa"] / both["true_peak_kpa"]).groupby(both["indenter"]).mean()
        found.append(
            headline(
                "pressure field, mean error over the contact, of its peak",
                "",
                _mean(both["pressure_error"], list(both["job"]), "press"),
                goal=GOAL_FIELD,
                remark=f"cells of 1 mm round edges off: the peak found is {share.min():.2f} of the "
                f"true one with {share.idxmin()}, {share.max():.2f} with {share.idxmax()}, so "
                "where edges press hard this share flatters",
            )
        )
    return tuple(found)


def _force(frames: pd.DataFrame, left_out_n: float | None) -> list[Headline]:
    """Error of the normal force, apart where a calibration, of force or depth, does not reach."""
    remark = "" if left_out_n is None else f"{left_out_n:.2f} N on a place of its ball left out; "
    found = []
    outside = frames["force_extrapolated"].astype(bool) | frames["extrapolated"].astype(bool)
    for beyond, words in ((False, "within the calibrations"), (True, "beyond the calibrations")):
        part = frames[outside == beyond]
        if part.empty:
            continue
        off, of = part["found_normal_n"] - part["normal_n"], list(part["job"])
        low, high = float(part["normal_n"].min()), float(part["normal_n"].max())
        found.append(
            headline(
                f"{NORMAL} {words}", "N", _few(rmse(off, of, "press"), of),
                goal=None if beyond else GOAL_N,
                remark=f"{remark}forces of {low:.1f} to {high:.1f} N; in the mean "
                f"{100 * float((off / part['normal_n']).mean()):+.0f} %",
            )
        )  # fmt: skip
        remark = ""
    return found


def _depth(frames: pd.DataFrame) -> list[Headline]:
    known = frames.dropna(subset=["depth_error_contact_mm"])

    def head(what: str, part: pd.DataFrame, column: str, each: str, **more: Any) -> Headline:
        scale: Scale = "correlation" if "correlation" in column else "positive"
        unit = "mm" if column.endswith("_mm") else ""
        return headline(what, unit, _mean(part[column], list(part["job"]), each, scale), **more)

    return [
        head(
            "depth over the contact, mean error", known, "depth_error_contact_mm", "press",
            goal=GOALS["depth_error_contact_mm"],
            remark=f"to say 'depth is zero' errs by {known['zero_error_contact_mm'].mean():.2f} mm",
        ),
        head(
            "depth over the face, mean error", known, "depth_error_face_mm", "press",
            goal=GOALS["depth_error_face_mm"],
            remark="most of a face is not pressed, so this figure flatters",
        ),
        *(
            head(
                f"{name}: depth over the contact, mean error", part, "depth_error_contact_mm",
                "place", remark=NINE_D_TACT if str(name).startswith("sphere:") else "",
            )
            for name, part in known.groupby("indenter", sort=False)
        ),
        head(
            "the paper's density: correlation with the true depth",
            known.dropna(subset=["relative_correlation"]), "relative_correlation", "press",
            better="high", remark=f"of our depth: {known['depth_correlation'].mean():.2f}",
        ),
    ]  # fmt: skip


def _mean(
    values: pd.Series[float], groups: list[str], each: str, scale: Scale = "positive"
) -> Interval:
    return _few(estimate(values, groups, lambda rows: float(rows.mean()), each, scale), groups)


def _few(found: Interval, groups: list[str]) -> Interval:
    """Without the interval that two groups give, which says nothing."""
    if len(set(groups)) >= FEWEST or found.low is None:
        return found
    return Interval(found.value, None, None, f"{found.over}: too few for an interval")


WORDS = {
    "indenter": "object", "tip_depth_mm": "tip, mm", "places": "places",
    "depth_error_contact_mm": "error, contact, mm", "depth_error_face_mm": "error, face, mm",
    "true_peak_depth_mm": "peak true, mm", "peak_depth_mm": "found, mm",
    "true_area_mm2": "contact true, mm2", "area_mm2": "found, mm2",
    "contact_iou": "overlap", "relative_correlation": "density to depth",
    "depth_correlation": "depth to depth", "normal_n": "force sensor, N",
    "found_normal_n": "found, N", "true_peak_kpa": "pressure peak true, kPa",
    "peak_kpa": "found, kPa", "pressure_error": "pressure error, of the peak",
}  # fmt: skip
"""Columns of the table of objects, and what stands above them."""
_ONLY_KEPT = ("places", "depth_correlation", "pressure_error", "true_peak_kpa", "peak_kpa")
"""Of them, those that the page has no room for."""
_MEANS = tuple(name for name in WORDS if name not in ("indenter", "tip_depth_mm", "places"))
PAPER = (
    "The paper shows these shapes and gives no number for them, so there is none to stand beside; "
    "nor does it give a size, a place or a depth."
)
DENSITY = (
    "The paper's Gaussian density tells outlines, edges and steps: at edges the pattern crowds, on "
    "a flat face it hardly changes. Off the axis parallax shifts what presses, so the density "
    "crowds on one side and spreads on the other. It is no map of the depth."
)
TWIST = (
    "A stage of three axes does not turn: the twist is a ball sheared far from the centre, which "
    "gives torque about the face's middle; a turn about the ball's own axis would show as a whirl."
)


def result(
    presses: Mapping[str, PressShape],
    pictures: Sequence[ShapeMaps],
    press: ShapeMaps | None,
    twist: ShapeMaps | None,
    note: str,
    force_left_out_n: float | None = None,
) -> StudyResult:
    """All but where the presses are from: settings, seed and what was left out are its maker's.

    presses: by name. pictures, press, twist, note: as of `drawn`.
    """
    frames = frame_of(presses)
    heads = headlines(frames, force_left_out_n)
    return StudyResult(
        study="shapes",
        title="Shapes and force distribution",
        verdict=verdict(frames, heads),
        data=data(frames, heads, presses),
        simulated=False,
        seed=0,
        scale=None,
        headlines=heads,
        tables=tables(frames),
        figures=drawn(pictures, press, twist, note),
        notes=(DENSITY,),
    )


def frame_of(presses: Mapping[str, PressShape]) -> pd.DataFrame:
    """A row a settled frame that presses; columns as the rows of `PressShape`, and `job`."""
    rows = [
        {"job": job, **row}
        for job, seen in presses.items()
        for row in seen.rows
        if row["tip_depth_mm"] > 0
    ]
    table = pd.DataFrame(rows)
    return table.dropna(axis="columns", how="all")


def by_object(frames: pd.DataFrame) -> pd.DataFrame:
    """Means over the places of each object at each depth, of what is known."""
    known = [name for name in _MEANS if name in frames]
    unsheared = frames[frames["kind"] != "shear"] if "kind" in frames else frames
    depths = unsheared["tip_depth_mm"].round(2)
    grouped = unsheared.assign(tip_depth_mm=depths).groupby(
        ["indenter", "tip_depth_mm"], sort=False
    )
    table = grouped[known].mean()
    table.insert(0, "places", grouped["job"].nunique())
    return table.reset_index()


def tables(frames: pd.DataFrame) -> tuple[ReportTable, ...]:
    """By object and depth, and every frame."""
    objects = by_object(frames)
    return (
        ReportTable(
            "shapes-by-object",
            "Means over the places at which each object was pressed. Contact: where the true depth "
            "or pressure says so, and what was found; overlap: of both, of all that either has; "
            "density to depth: correlation of the paper's density with the true depth. The CSV has "
            "peaks of the pressure too.",
            objects,
            shown=tuple(name for name in map(str, objects) if name not in _ONLY_KEPT),
            words={name: words for name, words in WORDS.items() if name in objects},
        ),
        ReportTable(
            "shapes-frames",
            "Every settled frame.",
            frames,
            shown=tuple(
                name
                for name in ("indenter", "press", "tip_depth_mm", "depth_error_contact_mm",
                             "peak_depth_mm", "area_mm2", "normal_n", "found_normal_n")
                if name in frames
            ),
        ),
    )  # fmt: skip


def drawn(
    pictures: Sequence[ShapeMaps], press: ShapeMaps | None, twist: ShapeMaps | None, note: str
) -> tuple[ReportFigure, ...]:
    """The gallery, the depth against truth where there is one, forces where there is a field."""
    found = []
    if pictures:
        found.append(
            ReportFigure(
                "shapes-gallery",
                "The paper's gallery: object; camera image with the flow; Gaussian density of 3 px "
                "as a hot map, redder where it is deeper; the face, deepest upwards.",
                partial(shape_figures.gallery, pictures, note),
            )
        )
    if any(picture.true_depth_mm is not None for picture in pictures):
        found.append(
            ReportFigure(
                "shapes-depth-error",
                "Above: sections through the tip. Below: measured less true depth; black the "
                "contact found, dashed the true one.",
                partial(shape_figures.against_truth, pictures, note),
            )
        )
    for name, picture, what in (
        ("force-distribution-press", press, "of a ball pressed down"),
        ("force-distribution-twist", twist, "of a ball sheared far from the centre"),
    ):
        if picture is not None and shape_figures.has_field(picture):
            found.append(
                ReportFigure(
                    name,
                    f"The paper's force distribution, {what}: flow, normal force and shear, with "
                    "the contact in white, and below what is true where that is known.",
                    partial(shape_figures.distribution, picture, note),
                )
            )
    return tuple(found)


def verdict(frames: pd.DataFrame, heads: Sequence[Headline]) -> tuple[str, ...]:
    """Sentences, the answer first."""
    names = ", ".join(dict.fromkeys(frames["indenter"]))
    lines = []
    if "depth_error_contact_mm" in frames:
        first, face = heads[0], heads[1]
        lines.append(
            f"Depth of {names} is off by {told(first, 'mm', '.2f')} over the contact and "
            f"{told(face, 'mm', '.3f')} over the face ({first.over}); {_met(first)}, {_met(face)}."
        )
        by = frames.groupby("indenter", sort=False)["depth_error_contact_mm"].mean()
        lines.append(
            f"Best is {by.idxmin()} ({by.min():.2f} mm), worst {by.idxmax()} ({by.max():.2f} mm)."
        )
        relative = frames["relative_correlation"].mean()
        lines.append(
            f"The paper's density correlates with the true depth by {relative:.2f} in the mean, "
            f"the depth by {frames['depth_correlation'].mean():.2f}."
        )
    else:
        lines.append(f"{names}: no truth, so the error of the depth is not known.")
    for head in heads:
        if head.unit == "N":
            lines.append(
                f"{head.what}: off by {told(head, 'N', '.2f')} (root mean square, {head.over}); "
                f"{head.remark}."
            )
        elif head.what.startswith("pressure field"):
            share = told(head, digits=".2f")
            lines.append(
                f"The pressure field is off by {share} of its peak in the mean over the contact."
            )
    return (*lines, PAPER)


def _met(head: Headline) -> str:
    return f"the goal of {head.goal:g} is {'met' if head.met else 'missed'}"


def data(
    frames: pd.DataFrame, heads: Sequence[Headline], presses: Mapping[str, PressShape]
) -> dict[str, Any]:
    """Plain data, for `--json`."""
    by = {
        str(object_): {
            name: float(part[name].mean())
            for name in _MEANS
            if name in part and part[name].notna().any()
        }
        for object_, part in frames.groupby("indenter", sort=False)
    }
    ways = sorted({str(seen.contact_by) for seen in presses.values()} - {"None"})
    return {
        "headlines": [head.as_dict() for head in heads],
        "objects": by,
        "by_object_and_depth": _known(by_object(frames)),
        "frames": _known(frames),
        "contact_by": ways,
        "goals": {**GOALS, "normal_n": GOAL_N, "pressure_error": GOAL_FIELD},
        "nine_d_tact_depth_error_mm": NINE_D_TACT_MM,
        "paper": None,
    }


def _known(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of plain data; what is not known is left out."""
    return [{k: v for k, v in row.items() if v is not None} for row in records(table)]
