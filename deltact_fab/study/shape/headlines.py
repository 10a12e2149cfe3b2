"""The figures that count of presses of objects, with their intervals over presses or places."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...analysis.shape import GOALS
from ...report.result import Headline
from ..intervals import Interval, Scale, estimate, rmse

if TYPE_CHECKING:
    import pandas as pd

NINE_D_TACT_MM = 0.0462
"""Mean depth error that 9DTact gives of one press of a ball (arXiv 2308.14277)."""
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
        found.append(
            _head("pressure field, mean error over the contact, of its peak", "",
                  _mean(both["pressure_error"], list(both["job"]), "press"), goal=GOAL_FIELD,
                  remark=_edges(both))
        )  # fmt: skip
    return tuple(found)


def _edges(frames: pd.DataFrame) -> str:
    """What a share of the peak hides."""
    share = (frames["peak_kpa"] / frames["true_peak_kpa"]).groupby(frames["indenter"]).mean()
    return (
        f"cells of 1 mm round edges off: the peak found is {share.min():.2f} of the true one with "
        f"{share.idxmin()}, {share.max():.2f} with {share.idxmax()}, so where edges press hard "
        "this share flatters"
    )


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
            _head(f"{NORMAL} {words}", "N", _few(rmse(off, of, "press"), of),
                  goal=None if beyond else GOAL_N,
                  remark=f"{remark}forces of {low:.1f} to {high:.1f} N; in the mean "
                  f"{100 * float((off / part['normal_n']).mean()):+.0f} %")
        )  # fmt: skip
        remark = ""
    return found


def _depth(frames: pd.DataFrame) -> list[Headline]:
    known = frames.dropna(subset=["depth_error_contact_mm"])
    found = [
        _head("depth over the contact, mean error", "mm",
              _mean(known["depth_error_contact_mm"], list(known["job"]), "press"),
              goal=GOALS["depth_error_contact_mm"],
              remark=f"to say 'depth is zero' errs by {known['zero_error_contact_mm'].mean():.2f} "
              "mm"),
        _head("depth over the face, mean error", "mm",
              _mean(known["depth_error_face_mm"], list(known["job"]), "press"),
              goal=GOALS["depth_error_face_mm"],
              remark="most of a face is not pressed, so this figure flatters"),
    ]  # fmt: skip
    for name, part in known.groupby("indenter", sort=False):
        remark = ""
        if str(name).startswith("sphere:"):
            remark = (
                f"9DTact gives {NINE_D_TACT_MM:g} mm for one ball: another sensor, a real one, and "
                "another experiment"
            )
        found.append(
            _head(f"{name}: depth over the contact, mean error", "mm",
                  _mean(part["depth_error_contact_mm"], list(part["job"]), "place"), remark=remark)
        )  # fmt: skip
    part = known.dropna(subset=["relative_correlation"])
    found.append(
        _head("the paper's density: correlation with the true depth", "",
              _mean(part["relative_correlation"], list(part["job"]), "press", "correlation"),
              better="high", remark=f"of our depth: {known['depth_correlation'].mean():.2f}")
    )  # fmt: skip
    return found


def _mean(
    values: pd.Series[float], groups: list[str], each: str, scale: Scale = "positive"
) -> Interval:
    return _few(estimate(values, groups, lambda rows: float(rows.mean()), each, scale), groups)


def _few(found: Interval, groups: list[str]) -> Interval:
    """Without the interval that two groups give, which says nothing."""
    if len(set(groups)) >= FEWEST or found.low is None:
        return found
    return Interval(found.value, None, None, f"{found.over}: too few for an interval")


def _head(what: str, unit: str, of: Interval, **more: Any) -> Headline:
    return Headline(what, of.value, unit, of.low, of.high, of.over, **more)
