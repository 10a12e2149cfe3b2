"""Everything that `calibrate force` prints and draws, and its files."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from dataclasses import field as made_by
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import Array, make_folder, write_whole

from ...measure.force import FORCE_FEATURES, FORCE_READINGS
from ...measure.force.calibration import ForceCalibration
from ...measure.regression import least_squares
from ..runs import write_results
from .dataset import ForceData
from .gel import IdentifiedGel, UnrelaxedForces
from .judge import (
    WRENCH_LABELS,
    FORCE_COMPONENTS,
    FORCE_SPLITS,
    EvaluatedModel,
    cross_validate,
    force_component,
    force_figures,
    presses_needed,
    root_mean_square,
)

PAPER_CONDITIONS = "paper"
DENSITY_FEATURES = {"clipped": PAPER_CONDITIONS, "signed": f"{PAPER_CONDITIONS}-signed"}
HELD_OUT_COLUMNS = {"at_random_n": "point", "by_press_n": "press", "by_place_n": "position"}


@dataclass
class ForceResult:
    """Feature sets fitted and cross-validated on the points of one sensor.

    judged: best first; best is the one whose calibration is kept. curves: by feature set, see
    `learning_curve`. gel: that the presses tell, None where the design's is kept. early: what
    labels had too much that were taken early, None: nothing.
    """

    COMPONENTS: ClassVar = FORCE_COMPONENTS
    SPLITS: ClassVar = FORCE_SPLITS
    FEATURES: ClassVar = (*FORCE_FEATURES, *FORCE_READINGS)
    PAPER_TABLE: ClassVar = {
        "normal": (0.99, 0.30),
        "shear_x": (0.98, 0.14),
        "shear_y": (0.98, 0.17),
    }
    """Adjusted R2 and RMSE in N (Contact Force Distribution, Linear Regression Analysis).

    Whether its R2 is about the mean or about 0 (see `RegressionFit`) the paper does not say.
    """

    data: ForceData
    models: list[EvaluatedModel]
    calibration: ForceCalibration
    seed: int
    left_out: list[str]
    curves: dict[str, dict[int, float]] = made_by(default_factory=dict)
    gel: IdentifiedGel | None = None
    unrelaxed: UnrelaxedForces | None = None

    @property
    def best(self) -> EvaluatedModel:
        return self.models[0]

    @property
    def paper(self) -> EvaluatedModel:
        """The paper's model, which is always fitted too."""
        return next(model for model in self.models if model.name == PAPER_CONDITIONS)

    def wrench_component(self, name: str) -> Array:
        """A force's or torque's component at all points (n,), its sign that of the figures."""
        return force_component(self.data.wrench, name)

    @property
    def presses_needed(self) -> int | None:
        """The fewest presses whose error is within a tenth of the last one's; None: not known."""
        return presses_needed(self.curves.get(self.best.name, {}))

    def figures(self) -> dict[str, dict[str, Any]]:
        """Of every feature set, see `judge.figures`."""
        return {model.name: force_figures(model, self.data) for model in self.models}

    def rows(self) -> list[dict[str, Any]]:
        """A row a feature set and component, at last the paper's table, printed of a real sensor.

        Errors in N or N mm: of the points fitted to, and of what was left out.
        """
        rows: list[dict[str, Any]] = []
        for label, components in self.figures().items():
            for name, figures in components.items():
                unit = "N" if "range_n" in figures else "N mm"
                plain = {
                    key.removesuffix("_n").removesuffix("_nmm"): v for key, v in figures.items()
                }
                rows.append({"model": label, "component": name, "unit": unit, **plain})
        for name, (r2, rmse_n) in self.PAPER_TABLE.items():
            printed = {"adjusted_r2": r2, "rmse_left_out_point": rmse_n}
            rows.append({"model": "as printed", "component": name, "unit": "N", **printed})
        return rows

    @property
    def line(self) -> str:
        """The verdict: which model is taken, and what it may be trusted to."""
        split = self.best.ranked_by
        text = (
            f"Use {self.best.name}: {_format_errors(self.best, self.data)}, {FORCE_SPLITS[split]}"
        )
        if (self.data.points["position"] == Run.UNKNOWN).all():  # of an imported run
            return text.replace("presses", "stretches of time")
        if self.paper is not self.best:
            text += f"; the paper's model {_format_errors(self.paper, self.data)}"
        if split in ("press", "point"):
            text += "; no place or indenter could be left out: calibrate on more"
        if (few := self.presses_needed) is not None:
            text += f"; more than {few} presses improve it little"
        return text

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the points."""
        source = self.calibration.head.made
        return {
            "verdict": self.line,
            "best": self.best.name,
            "models": self.figures(),
            "regressions": {
                model.name: {name: asdict(fit) for name, fit in model.fits.items()}
                for model in self.models
            },
            "n_points": len(self.data),
            "n_presses": int(self.data.points["press"].nunique()),
            "runs": list(source.runs),
            "simulated": source.simulated,
            "run_seed": source.seed,
            "split_seed": self.seed,
            "learning_n": self.curves,
            "gel": None if self.gel is None else asdict(self.gel),
            "early_labels": None if self.unrelaxed is None else asdict(self.unrelaxed),
            "left_out": self.left_out,
        }

    def points(self) -> pd.DataFrame:
        """A row a point: what was measured, and what best and the paper's model predicted of it.

        Columns as in normal_n, best_normal_n: by the hardest of SPLITS, mean of its repeats.
        """
        parts = {"": self.data.wrench} | {
            f"{label}_": model.predicted[model.ranked_by].mean(axis=0)
            for label, model in (("paper", self.paper), ("best", self.best))
        }
        return self.data.points.assign(
            **{
                f"{label}{name}_{'n' if name in FORCE_COMPONENTS else 'nmm'}": force_component(
                    wrench, name
                )
                for label, wrench in parts.items()
                for name in WRENCH_LABELS
            }
        )

    def errors_by_distance(self) -> pd.DataFrame:
        """A row a reading and distance, and of the best model: RMSE of the normal force there, N.

        The paper prints that the density is "processed" and "non-negative", not how, and no
        constant; nor does it print its nine places, which decide most of the error here.

        alone_n: fitted to points of that distance only, a fifth of them left out at random. The
        others: fitted to all, by what was left out.
        """
        data, best = self.data, self.best
        measured = self.wrench_component("normal")
        distance_mm = np.round(np.hypot(*data.points[["x_mm", "y_mm"]].to_numpy(float).T), 2)

        def prediction_errors(X: Array, split: str, mask: Array) -> Array:
            """Errors (repeats, m) of the points of a mask, by models of points of it."""
            X, y, points = X[mask], measured[mask], data.points[mask].reset_index(drop=True)
            labels = [str(k) for k in range(X.shape[1])]

            def predict(train: Array, test: Array) -> Array:
                return X[test] @ least_squares(X[train], y[train], labels).coefficients

            return cross_validate(points, y, split, self.seed, predict) - y

        readings: list[tuple[dict[str, str], Array | None, dict[str, Array]]] = []
        for density, name in DENSITY_FEATURES.items():
            use = [data.sets[name].names.index(label) for label in data.sets[name].explains["fz"]]
            for constant in ("without", "with"):
                X = data.features[name][:, use]
                X = np.column_stack((X, np.ones(len(X)))) if constant == "with" else X
                errors = {
                    column: prediction_errors(X, kind, distance_mm >= 0)
                    for column, kind in HELD_OUT_COLUMNS.items()
                }
                readings.append(({"model": f"paper, {density}", "constant": constant}, X, errors))
        errors = {c: best.component("normal", kind) - measured
                for c, kind in HELD_OUT_COLUMNS.items() if kind in best.predicted}  # fmt: skip
        readings.append(({"model": best.name}, None, errors))
        rows = []
        for names, columns, errors in readings:
            for distance in np.unique(distance_mm):
                rows_there = distance_mm == distance
                row = {**names, "distance_mm": distance, "points": int(rows_there.sum())}
                if columns is not None:
                    row["alone_n"] = root_mean_square(
                        prediction_errors(columns, "point", rows_there)
                    )
                rows.append(
                    row
                    | {c: root_mean_square(values[:, rows_there]) for c, values in errors.items()}
                )
        return pd.DataFrame(rows)

    def save(self, folder: Path, output: Path) -> list[Path]:
        """Write force.json, force.csv (a row a point) and the calibration with its resting face."""
        files = write_results(folder, {"force.json": self.as_dict(), "force.csv": self.points()})
        if self.calibration.skin is not None:  # None of an imported run `in_pixels`
            files += write_force_calibration(self.calibration, output)
        return files


def write_force_calibration(calibration: ForceCalibration, path: Path) -> list[Path]:
    """Write a calibration and the face at rest beside it, each whole or not at all."""
    make_folder(path.parent)
    rest = path.with_name(f"{path.stem}.rest.png")
    # The image first: a file that names one never stands without it.
    if calibration.rest is not None:
        write_whole(rest, calibration.rest)
    write_whole(path, calibration.toml(rest.name).encode())
    return [path] if calibration.rest is None else [path, rest]


def _format_errors(evaluated: EvaluatedModel, data: ForceData) -> str:
    """Words like "normal force to 0.17 N (2.0 % of 8.7 N), shear to 0.03 and 0.04 N (...)"."""
    figures = force_figures(evaluated, data)

    def format_component(name: str) -> tuple[str, str]:
        error, share = (
            figures[name][f"rmse_left_out_{evaluated.ranked_by}_n"],
            figures[name]["percent_of_range"],
        )
        return ("unknown", "?") if error is None else (f"{error:.2f} N", f"{share:.1f} %")

    (normal, part), *shears = (format_component(name) for name in FORCE_COMPONENTS)
    text = f"normal force to {normal} ({part} of {figures['normal']['range_n']:.1f} N), "
    if not any(figures[name]["range_n"] for name in FORCE_COMPONENTS[1:]):
        return f"{text}shear not calibrated (there was none)"
    values, parts = (" and ".join(column) for column in zip(*shears, strict=True))
    return f"{text}shear to {values} ({parts})"
