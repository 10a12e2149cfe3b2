"""Everything that `analyze force` prints and draws, and its files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from dataclasses import field as made_by
from pathlib import Path
from typing import Any

import pandas as pd

from ...files import write_whole
from ...measure.force.calibration import ForceCalibration
from ..frames import make_folder
from .dataset import ForceData
from .field import FieldError
from .gel import EarlyLabels, ToldGel
from .judge import (
    FORCES,
    LEFT_OUT,
    SHOWN,
    EvaluatedModel,
    LearningPoint,
    component,
    enough,
    figures,
    score,
)

PAPER = "paper"
PAPER_TABLE = {"normal": (0.99, 0.30), "shear_x": (0.98, 0.14), "shear_y": (0.98, 0.17)}
"""Adjusted R2 and RMSE in N (Contact Force Distribution, Linear Regression Analysis).

Whether its R2 is about the mean or about 0 (see `RegressionFit`) the paper does not say.
"""


@dataclass
class ForceResult:
    """Feature sets fitted and cross-validated on the points of one sensor.

    judged: best first; best is the one whose calibration is kept. curves: by feature set. field:
    the best one's force field against truth, where there is one. gel: that the presses tell, None
    where the design's is kept. early: what labels had too much that were taken
    early, None: nothing.
    """

    data: ForceData
    judged: list[EvaluatedModel]
    calibration: ForceCalibration
    seed: int
    left_out: list[str]
    curves: dict[str, list[LearningPoint]] = made_by(default_factory=dict)
    field: FieldError | None = None
    gel: ToldGel | None = None
    early: EarlyLabels | None = None

    @property
    def best(self) -> EvaluatedModel:
        """The winner of the cross-validation."""
        return self.judged[0]

    @property
    def paper(self) -> EvaluatedModel:
        """The paper's model, which is always fitted too."""
        return next(one for one in self.judged if one.name == PAPER)

    def figures(self) -> dict[str, dict[str, Any]]:
        """Of every feature set, see `judge.figures`."""
        return {one.name: figures(one, self.data) for one in self.judged}

    def rows(self) -> list[dict[str, Any]]:
        """A row a feature set and component, at last the paper's table, printed of a real sensor.

        Errors in N or N mm: of training, of test points, and of what was left out.
        """
        rows = []
        for model, every in self.figures().items():
            for name, of in every.items():
                unit = "n" if "range_n" in of else "nmm"
                errors = ("rmse_train", "rmse", *(f"rmse_left_out_{g}" for g in LEFT_OUT), "range")
                rows.append(
                    {
                        "model": model, "component": name, "unit": "N" if unit == "n" else "N mm",
                        "adjusted_r2": of["adjusted_r2"],
                        "adjusted_r2_about_zero": of["adjusted_r2_about_zero"],
                        **{key: of[f"{key}_{unit}"] for key in errors},
                        "percent_of_range": of["percent_of_range"],
                        "condition_raw": of["condition_raw"],
                        "condition_scaled": of["condition_scaled"],
                    }
                )  # fmt: skip
        printed = {"model": "as printed", "unit": "N"}
        return [
            *rows,
            *(
                {**printed, "component": name, "adjusted_r2": r2, "rmse": rmse_n}
                for name, (r2, rmse_n) in PAPER_TABLE.items()
            ),
        ]

    @property
    def line(self) -> str:
        """The verdict: which model is taken, and what it may be trusted to."""
        of = figures(self.best, self.data)
        told = [g for g in ("position", "indenter") if g in self.best.predicted]
        where = f"left-out {' and '.join(f'{g}s' for g in told)}" if told else "test points only"
        text = f"{self.best.name} is taken: {_errors(of)} on {where}"
        if self.paper is not self.best:
            text += f"; the paper's model {_errors(figures(self.paper, self.data))}"
        if not told:
            text += "; no place or indenter could be left out: calibrate on more"
        if (few := enough(self.curves.get(self.best.name, []))) is not None:
            text += f"; more than {few} presses bring little"
        return text

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the points."""
        every = self.figures()
        made = self.calibration.head.made
        return {
            "verdict": self.line,
            "best": self.best.name,
            "models": {"best": every[self.best.name], PAPER: every[PAPER]},
            "compared": {
                one.name: {"left_out_force_error_n": score(one, self.data), **every[one.name]}
                for one in self.judged
            },
            "n_points": len(self.data),
            "n_train": len(self.best.train),
            "n_test": len(self.best.test),
            "n_presses": int(self.data.points["press"].nunique()),
            "runs": list(made.runs),
            "simulated": made.simulated,
            "run_seed": made.seed,
            "split_seed": self.seed,
            "learning": {
                name: [asdict(point) for point in curve] for name, curve in self.curves.items()
            },
            "enough_presses": {name: enough(curve) for name, curve in self.curves.items()},
            "paper_table": {
                name: {"adjusted_r2": r2, "rmse_n": rmse_n}
                for name, (r2, rmse_n) in PAPER_TABLE.items()
            },
            "field": None if self.field is None else asdict(self.field),
            "gel": None if self.gel is None else asdict(self.gel),
            "early_labels": None if self.early is None else asdict(self.early),
            "left_out": self.left_out,
        }

    def points(self) -> pd.DataFrame:
        """A row a point: what was measured, and what best and the paper's model said of it.

        Columns as in normal_n, best_left_out_position_normal_n; test: 1 for the points held back.
        """
        table = self.data.points.copy()
        table["test"] = 0
        table.loc[self.best.test, "test"] = 1
        for name, of in SHOWN.items():
            unit = "n" if of.startswith("f") else "nmm"
            table[f"{name}_{unit}"] = component(self.data.wrench, name)
            for label, one in (("best", self.best), ("paper", self.paper)):
                for group, predicted in one.predicted.items():
                    how = "" if group == "test" else f"left_out_{group}_"
                    table[f"{label}_{how}{name}_{unit}"] = component(predicted, name)
        return table

    def save(self, folder: Path, output: Path) -> list[Path]:
        """Write force.json, force.csv (a row a point) and the calibration with its resting face."""
        files = {
            folder / "force.json": json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n",
            folder / "force.csv": self.points().to_csv(index=False),
        }
        make_folder(folder)
        for path, text in files.items():
            write_whole(path, text.encode())
        return [*files, *write_calibration(self.calibration, output)]


def write_calibration(calibration: ForceCalibration, path: Path) -> list[Path]:
    """Write a calibration and the face at rest beside it, each whole or not at all."""
    make_folder(path.parent)
    rest = path.with_name(f"{path.stem}.rest.png")
    written = []
    # The image first: a file that names one never stands without it.
    if calibration.rest is not None:
        write_whole(rest, calibration.rest)
        written.append(rest)
    write_whole(path, calibration.toml(rest.name).encode())
    return [path, *written]


def errors_kept(of: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """What a calibration file keeps of `judge.figures`: what a reader of forces wants to know."""
    return {
        name: {k: v for k, v in one.items() if k != "regression" and not k.startswith("condition")}
        for name, one in of.items()
        if one.get("range_n", one.get("range_nmm"))
    }


def _errors(of: Mapping[str, Mapping[str, Any]]) -> str:
    """Words like "normal force to 0.17 N (2.0 % of 8.7 N), shear to 0.03 and 0.04 N (...)"."""

    def one(name: str) -> tuple[str, str]:
        held = [of[name].get(f"rmse_left_out_{g}_n") for g in ("position", "indenter")]
        span = of[name]["range_n"]
        if not span:
            return "-", "not calibrated"
        known = [v for v in held if v is not None] or [of[name]["rmse_n"]]
        return f"{max(known):.2f}", f"{100 * max(known) / span:.1f} %"

    (normal, part), *shears = (one(name) for name in FORCES)
    text = f"normal force to {normal} N ({part} of {of['normal']['range_n']:.1f} N), "
    if not any(of[name]["range_n"] for name in FORCES[1:]):
        return f"{text}shear not calibrated (there was none)"
    values, parts = (" and ".join(column) for column in zip(*shears, strict=True))
    return f"{text}shear to {values} N ({parts})"
