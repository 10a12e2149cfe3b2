"""The results of a calibration's points: verdict, headlines, tables, plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from ...analysis.force import (
    FORCES,
    PAPER,
    PAPER_TABLE,
    ForceResult,
    component,
)
from ...analysis.force.judge import EvaluatedModel
from ...report.force_figures import drawn
from ...report.result import Headline, ReportTable, StudyResult, records
from ..gel_remarks import MODULUS_FACTOR, remark
from ..intervals import Interval, headline, rmse
from .reasons import by_group, error, parts, why_missed, why_not_the_papers

STUDY = "force-calibration"
GOAL_N, GOAL_SHEAR = 0.2, 0.02
"""Of the normal force, and of the range in shear, on a left-out position or indenter."""
WORDS = {"normal": "normal force", "shear_x": "shear along x", "shear_y": "shear along y"}
LEFT_OUT = {"position": "a position left out", "indenter": "an indenter left out"}


def models(result: ForceResult) -> dict[str, EvaluatedModel]:
    """The two that the study shows."""
    return {"paper": result.paper, "best": result.best}


def told(result: ForceResult, scale: float | None, modulus: ReportTable | None) -> StudyResult:
    """Everything but the scene: settings and what was left out are its maker's.

    modulus: the table of what its factor changes, of a simulated gel.
    """
    where = by_group(result, models(result))
    refits = parts(result, PAPER)
    heads = [*_best(result, where), *_paper(result, refits)]
    verdict = _verdict(result, heads)
    tables = [
        _compared(result),
        _left_out(where),
        ReportTable(
            "force-paper-refits",
            "The paper's model fitted to parts. What it gains on a part of the points alone "
            "is what one linear model of its sums cannot say of all. The last row is of "
            "points that its fit has not seen.",
            refits,
        ),
        _learning(result),
    ]
    data = _data(result, heads, verdict)
    notes: tuple[str, ...] = ()
    if modulus is not None:
        tables.append(modulus)
        rows = records(modulus.frame)
        data["modulus"] = {"factor": MODULUS_FACTOR, "at": rows}
        notes = (remark(STUDY, rows[1]["modulus_mpa"]),)
    return StudyResult(
        study=STUDY,
        title="Force calibration",
        verdict=verdict,
        data=data,
        simulated=result.calibration.head.made.simulated,
        seed=result.seed,
        scale=scale,
        headlines=tuple(heads),
        tables=tuple(tables),
        figures=tuple(drawn(result)),
        notes=notes,
        files={"points.csv": result.points().to_csv(index=False)},
    )


def modulus(
    result: ForceResult, modulus_mpa: float, range_n: Sequence[float], range_nmm: Sequence[float]
) -> ReportTable:
    """Ranges, errors and the load on the force sensor, at the modulus and its two ends."""
    wrench = np.abs(result.data.wrench).max(axis=0)
    sensor = np.array([*range_n, *range_nmm])
    of = result.figures()[result.best.name]
    rows = []
    for factor in (1 / MODULUS_FACTOR, 1.0, MODULUS_FACTOR):
        row: dict[str, Any] = {"modulus_mpa": factor * modulus_mpa}
        for name in FORCES:
            row[f"{name}_range_n"] = factor * of[name]["range_n"]
        for name in FORCES:
            held = of[name]["rmse_left_out_position_n"]
            row[f"{name}_rmse_left_out_position_n"] = None if held is None else factor * held
        share = factor * wrench / sensor
        row["of_sensor_force_range"] = float(share[:3].max())
        row["of_sensor_moment_range"] = float(share[3:].max())
        rows.append(row)
    return ReportTable(
        "force-modulus",
        "What the modulus's factor of 2 changes. Newtons, all alike, and how much of the force "
        "sensor's range the settled points take (above 1 they would be refused as saturated).",
        pd.DataFrame(rows),
    )


def _interval(result: ForceResult, judged: EvaluatedModel, left_out: str, name: str) -> Interval:
    """RMSE of a component over what was left out; of test points over distinct presses."""
    points, off = result.data.points, error(judged, result.data, left_out, name)
    if left_out != "test":
        return rmse(off, points[left_out].to_numpy(), left_out)
    alike = (points["indenter"] + " " + points["position"]).to_numpy()
    return rmse(off[judged.test], alike[judged.test], "distinct press")


def _best(result: ForceResult, where: pd.DataFrame) -> list[Headline]:
    """The best model on what it never saw."""
    heads = []
    for left_out, words in LEFT_OUT.items():
        if left_out not in result.best.predicted:
            continue
        for name in FORCES:
            span = float(np.ptp(component(result.data.wrench, name)))
            goal = GOAL_N if name == "normal" else GOAL_SHEAR * span
            found = _interval(result, result.best, left_out, name)
            remark = f"of {span:.2f} N"
            if found.value > goal:
                remark += "; " + why_missed(where, "best", left_out, name)
            what = f"{result.best.name}, {WORDS[name]}, {words}: RMSE"
            heads.append(headline(what, "N", found, goal=goal, remark=remark))
    return heads


def _paper(result: ForceResult, refits: pd.DataFrame) -> list[Headline]:
    """The paper's model on the paper's split, beside what the paper printed."""
    judged = models(result)["paper"]
    heads = []
    for name, (_, printed_n) in PAPER_TABLE.items():
        found = _interval(result, judged, "test", name)
        remark = ""
        if found.low is not None and found.low > printed_n:
            remark = why_not_the_papers(result, refits, name)
        what = f"paper's model, {WORDS[name]}, test points: RMSE"
        heads.append(headline(what, "N", found, paper=printed_n, remark=remark))
    return heads


def _verdict(result: ForceResult, heads: list[Headline]) -> tuple[str, ...]:
    lines = [f"The model {result.line}."]
    held = [head for head in heads if head.goal is not None]
    if held:
        goal = (
            f"The goal, {GOAL_N:g} N in normal force and {GOAL_SHEAR:.0%} of the range in shear on "
            "what was left out, is "
        )
        missed = "; ".join(
            f"{head.what.partition(', ')[2]} {head.value:.3f} N for {head.goal:.3f}"
            for head in held
            if not head.met
        )
        lines.append(f"{goal}missed, for the reasons beside the figures: {missed}." if missed
                     else f"{goal}met.")  # fmt: skip
    paper = [head for head in heads if head.paper is not None]
    said = ", ".join(f"{head.value:.2f} N for {head.paper:.2f}" for head in paper)
    lines.append(
        "The paper's model on test points, beside what the paper printed for a real sensor "
        f"(normal, shear x, y): {said}."
    )
    if paper[0].remark:
        lines.append(f"Its normal force: {paper[0].remark}.")
    lines.append(
        "Simulated by another solver, on two gels that it does not believe in, ten presses "
        "calibrate normal force to 0.05 N of 7 N and shear to 0.3 %; with the design's gel kept, "
        "to 0.05 and 0.11 N, and 1 % (docs/evidence/strangers.md)."
    )
    return tuple(lines)


def _data(result: ForceResult, heads: list[Headline], verdict: tuple[str, ...]) -> dict[str, Any]:
    keys = ("adjusted_r2", "adjusted_r2_about_zero", "rmse_n", "rmse_left_out_position_n",
            "rmse_left_out_indenter_n", "range_n")  # fmt: skip
    whole = result.as_dict()
    kept = ("paper_table", "best", "n_points", "n_train", "n_test", "n_presses", "learning",
            "enough_presses", "runs", "simulated", "left_out")  # fmt: skip
    return {
        **{key: whole[key] for key in kept},
        "verdict": list(verdict),
        "models": {
            label: {name: {key: of[name][key] for key in keys} for name in FORCES}
            for label, of in whole["models"].items()
        },
        "headlines": [head.as_dict() for head in heads],
        "seed": result.seed,
    }


def _compared(result: ForceResult) -> ReportTable:
    """Every feature set and the paper's table."""
    hidden = ["rmse_left_out_run", "condition_raw", "condition_scaled"]
    return ReportTable(
        "force-models",
        "Every model. Ranked by what it makes of a left-out position and indenter; RMSE without "
        "more is of the test points. The last rows are the paper's table, of a real sensor, which "
        "does not say whether its R2 is about the mean or about 0.",
        pd.DataFrame(result.rows()).drop(columns=hidden),
    )


def _left_out(where: pd.DataFrame) -> ReportTable:
    """A row a model and what was left out; columns as in normal_rmse_n."""
    keys = ["model", "left_out", "which", "points"]
    wide = where.pivot(index=keys, columns="force", values=["rmse_n", "mean_error_n", "gain"])
    wide.columns = wide.columns.map(lambda pair: f"{pair[1]}_{pair[0]}")
    order = [f"{name}_{value}" for name in FORCES for value in ("rmse_n", "mean_error_n", "gain")]
    frame = wide[order].reset_index().sort_values(["model", "left_out"], ascending=[True, False])
    shown = (*keys, *(column for column in order if not column.endswith("gain")), "normal_gain")
    return ReportTable(
        "force-left-out",
        "What was left out. Error on each position (its mirror images with it) and each indenter "
        "by a model that never saw it; gain: predicted over measured.",
        frame.reset_index(drop=True),
        shown,
    )


def _learning(result: ForceResult) -> ReportTable:
    rows = [
        {"model": name, **asdict(point)} for name, curve in result.curves.items() for point in curve
    ]
    return ReportTable(
        "force-learning",
        "How many presses. Error on all other presses when a model is fitted to few, drawn at "
        "random; low and high are the 10th and 90th percentile of the draws.",
        pd.DataFrame(rows),
    )


def meshes(gel: Sequence[Mapping[str, Any]]) -> ReportTable:
    """A row a job: its points' presses, mesh, flags, and what interpolation costs."""
    rows = [
        {
            "presses": ", ".join(dict.fromkeys(one["rows"]["press"])),
            "mesh": "; ".join(one["why"]),
            "flags": "; ".join(one["flags"].values()),
            "between_poses_n": one["between_n"] if one["between_samples"] else None,
            "between_poses_mm": one["between_mm"] if one["between_samples"] else None,
        }
        for one in gel
    ]
    return ReportTable(
        "force-gel",
        "The gel. The presses of each job, what the solver flags of their mesh, and the largest "
        "error of linear interpolation between solved poses, where it was tried.",
        pd.DataFrame(rows),
        ("presses", "flags", "between_poses_n", "between_poses_mm"),
    )
