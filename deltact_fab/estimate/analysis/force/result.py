"""Result of `calibrate force`: its texts, tables and files."""

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
    FORCE_COMPONENTS,
    FORCE_SPLITS,
    WRENCH_LABELS,
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

    models: best first; the best one is the calibration. curves: by feature set, see
    `learning_curve`. gel: fitted to the presses, None where the design's is kept. unrelaxed:
    correction of early labels, None: not needed.
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

    The paper does not say if its R2 is about the mean or about 0 (see `RegressionFit`).
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
        """Return a force or torque component at all points (n,), with the sign of the figures."""
        return force_component(self.data.wrench, name)

    @property
    def presses_needed(self) -> int | None:
        """The fewest presses whose error is within a tenth of the last one's; None: unknown."""
        return presses_needed(self.curves.get(self.best.name, {}))

    def figures(self) -> dict[str, dict[str, Any]]:
        """Figures by feature set, see `judge.force_figures`."""
        return {model.name: force_figures(model, self.data) for model in self.models}

    def rows(self) -> list[dict[str, Any]]:
        """One row per feature set and component, then the paper's table (of a real sensor).

        Errors in N or N mm: on the training points, and on what was left out.
        """
        rows: list[dict[str, Any]] = []
        for label, components in self.figures().items():
            for name, figures in components.items():
                unit = "N" if "range_n" in figures else "N mm"
                plain = {k.removesuffix("_n").removesuffix("_nmm"): v for k, v in figures.items()}
                rows.append({"model": label, "component": name, "unit": unit, **plain})
        for name, (r2, rmse_n) in self.PAPER_TABLE.items():
            printed = {"adjusted_r2": r2, "rmse_left_out_point": rmse_n}
            rows.append({"model": "as printed", "component": name, "unit": "N", **printed})
        return rows

    @property
    def line(self) -> str:
        """The verdict: the best model and its errors."""
        best, split = self.best, self.best.ranked_by
        text = f"Use {best.name}: {_format_errors(best, self.data)}, {FORCE_SPLITS[split]}"
        if (self.data.points["position"] == Run.UNKNOWN).all():  # of an imported run
            return text.replace("presses", "time segments")
        if self.paper is not best:
            text += f"; the paper's model {_format_errors(self.paper, self.data)}"
        if split in ("press", "point"):
            text += "; only one position and indenter: calibrate on more for a test on unseen ones"
        if (few := self.presses_needed) is not None:
            text += f"; little gain beyond {few} presses"
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
        """One row per point: measured wrench, and that predicted by the best and the paper's model.

        Columns as in normal_n, best_normal_n: by the hardest of FORCE_SPLITS, mean of its repeats.
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
        """RMSE of the normal force, N, by reading of the paper (and best model) and distance.

        The paper prints that the density is "processed" and "non-negative", not how, and no
        constant; nor does it print its nine places, which decide most of the error here.

        alone_n: fitted to points of that distance only, a fifth of them left out at random. The
        other columns: fitted to all, by what was left out.
        """
        data, best = self.data, self.best
        measured = self.wrench_component("normal")
        distance_mm = np.round(np.hypot(*data.points[["x_mm", "y_mm"]].to_numpy(float).T), 2)

        def cv_errors(X: Array, split: str, mask: Array) -> Array:
            """Errors (repeats, m) at the points of a mask, of models of these points."""
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
                mask = np.ones(len(X), bool)
                errors = {c: cv_errors(X, kind, mask) for c, kind in HELD_OUT_COLUMNS.items()}
                readings.append(({"model": f"paper, {density}", "constant": constant}, X, errors))
        errors = {c: best.component("normal", kind) - measured
                for c, kind in HELD_OUT_COLUMNS.items() if kind in best.predicted}  # fmt: skip
        readings.append(({"model": best.name}, None, errors))
        rows = []
        for names, columns, errors in readings:
            for distance in np.unique(distance_mm):
                ring = distance_mm == distance
                row = {**names, "distance_mm": distance, "points": int(ring.sum())}
                if columns is not None:
                    row["alone_n"] = root_mean_square(cv_errors(columns, "point", ring))
                rows.append(row | {c: root_mean_square(e[:, ring]) for c, e in errors.items()})
        return pd.DataFrame(rows)

    def save(self, folder: Path, output: Path) -> list[Path]:
        """Write force.json, force.csv (one row per point) and the calibration with its image."""
        files = write_results(folder, {"force.json": self.as_dict(), "force.csv": self.points()})
        if self.calibration.skin is not None:  # None of an imported run `in_pixels`
            files += write_force_calibration(self.calibration, output)
        return files


def write_force_calibration(calibration: ForceCalibration, path: Path) -> list[Path]:
    """Write a calibration and the image of the face at rest beside it, each file atomically."""
    make_folder(path.parent)
    rest = path.with_name(f"{path.stem}.rest.png")
    # The image first, so that the calibration never names a missing one.
    if calibration.rest is not None:
        write_whole(rest, calibration.rest)
    write_whole(path, calibration.toml(rest.name).encode())
    return [path] if calibration.rest is None else [path, rest]


def _format_errors(evaluated: EvaluatedModel, data: ForceData) -> str:
    """Text like "normal force to 0.17 N (2.0 % of 8.7 N), shear to 0.03 and 0.04 N (...)"."""
    figures, key = force_figures(evaluated, data), f"rmse_left_out_{evaluated.ranked_by}_n"

    def format_component(name: str) -> tuple[str, str]:
        error, share = figures[name][key], figures[name]["percent_of_range"]
        return ("unknown", "?") if error is None else (f"{error:.2f} N", f"{share:.1f} %")

    (normal, part), *shears = (format_component(name) for name in FORCE_COMPONENTS)
    text = f"normal force to {normal} ({part} of {figures['normal']['range_n']:.1f} N), "
    if not any(figures[name]["range_n"] for name in FORCE_COMPONENTS[1:]):
        return f"{text}shear not calibrated (no shear in the data)"
    values, parts = (" and ".join(column) for column in zip(*shears, strict=True))
    return f"{text}shear to {values} ({parts})"
