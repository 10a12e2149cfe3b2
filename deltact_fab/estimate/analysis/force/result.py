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
from .gel import FoundGel, UnrelaxedForces
from .judge import (
    FORCE_COMPONENTS,
    FORCE_SPLITS,
    SHOWN,
    EvaluatedModel,
    cross_validated,
    force_component,
    force_figures,
    presses_needed,
    root_mean_square,
)

PAPER_CONDITIONS = "paper"
DENSITIES = {"clipped": PAPER_CONDITIONS, "signed": f"{PAPER_CONDITIONS}-signed"}
HELD_OUT = {"at_random_n": "point", "by_press_n": "press", "by_place_n": "position"}


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
    judged: list[EvaluatedModel]
    calibration: ForceCalibration
    seed: int
    left_out: list[str]
    curves: dict[str, dict[int, float]] = made_by(default_factory=dict)
    gel: FoundGel | None = None
    early: UnrelaxedForces | None = None

    @property
    def best(self) -> EvaluatedModel:
        return self.judged[0]

    @property
    def paper(self) -> EvaluatedModel:
        """The paper's model, which is always fitted too."""
        return next(one for one in self.judged if one.name == PAPER_CONDITIONS)

    def wrench_component(self, name: str) -> Array:
        """A force's or torque's component at all points (n,), its sign that of the figures."""
        return force_component(self.data.wrench, name)

    @property
    def presses_needed(self) -> int | None:
        """The fewest presses whose error is within a tenth of the last one's; None: not known."""
        return presses_needed(self.curves.get(self.best.name, {}))

    def figures(self) -> dict[str, dict[str, Any]]:
        """Of every feature set, see `judge.figures`."""
        return {one.name: force_figures(one, self.data) for one in self.judged}

    def rows(self) -> list[dict[str, Any]]:
        """A row a feature set and component, at last the paper's table, printed of a real sensor.

        Errors in N or N mm: of the points fitted to, and of what was left out.
        """
        rows: list[dict[str, Any]] = []
        for model, every in self.figures().items():
            for name, of in every.items():
                unit = "N" if "range_n" in of else "N mm"
                plain = {key.removesuffix("_n").removesuffix("_nmm"): v for key, v in of.items()}
                rows.append({"model": model, "component": name, "unit": unit, **plain})
        for name, (r2, rmse_n) in self.PAPER_TABLE.items():
            printed = {"adjusted_r2": r2, "rmse_left_out_point": rmse_n}
            rows.append({"model": "as printed", "component": name, "unit": "N", **printed})
        return rows

    @property
    def line(self) -> str:
        """The verdict: which model is taken, and what it may be trusted to."""
        split = self.best.ranked_by
        text = f"Use {self.best.name}: {_errors(self.best, self.data)}, {FORCE_SPLITS[split]}"
        if (self.data.points["position"] == Run.UNKNOWN).all():  # of an imported run
            return text.replace("presses", "stretches of time")
        if self.paper is not self.best:
            text += f"; the paper's model {_errors(self.paper, self.data)}"
        if split in ("press", "point"):
            text += "; no place or indenter could be left out: calibrate on more"
        if (few := self.presses_needed) is not None:
            text += f"; more than {few} presses improve it little"
        return text

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the points."""
        made = self.calibration.head.made
        return {
            "verdict": self.line,
            "best": self.best.name,
            "models": self.figures(),
            "regressions": {
                one.name: {name: asdict(fit) for name, fit in one.fits.items()}
                for one in self.judged
            },
            "n_points": len(self.data),
            "n_presses": int(self.data.points["press"].nunique()),
            "runs": list(made.runs),
            "simulated": made.simulated,
            "run_seed": made.seed,
            "split_seed": self.seed,
            "learning_n": self.curves,
            "gel": None if self.gel is None else asdict(self.gel),
            "early_labels": None if self.early is None else asdict(self.early),
            "left_out": self.left_out,
        }

    def points(self) -> pd.DataFrame:
        """A row a point: what was measured, and what best and the paper's model predicted of it.

        Columns as in normal_n, best_normal_n: by the hardest of SPLITS, mean of its repeats.
        """
        parts = {"": self.data.wrench} | {
            f"{label}_": one.predicted[one.ranked_by].mean(axis=0)
            for label, one in (("paper", self.paper), ("best", self.best))
        }
        return self.data.points.assign(
            **{
                f"{label}{name}_{'n' if name in FORCE_COMPONENTS else 'nmm'}": force_component(
                    wrench, name
                )
                for label, wrench in parts.items()
                for name in SHOWN
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
        away = np.round(np.hypot(*data.points[["x_mm", "y_mm"]].to_numpy(float).T), 2)

        def off(X: Array, split: str, mine: Array) -> Array:
            """Errors (repeats, m) of the points of a mask, by models of points of it."""
            X, y, points = X[mine], measured[mine], data.points[mine].reset_index(drop=True)
            labels = [str(k) for k in range(X.shape[1])]

            def predict(fitted: Array, judged: Array) -> Array:
                return X[judged] @ least_squares(X[fitted], y[fitted], labels).coefficients

            return cross_validated(points, y, split, self.seed, predict) - y

        models: list[tuple[dict[str, str], Array | None, dict[str, Array]]] = []
        for density, name in DENSITIES.items():
            use = [data.sets[name].names.index(one) for one in data.sets[name].explains["fz"]]
            for constant in ("without", "with"):
                X = data.features[name][:, use]
                X = np.column_stack((X, np.ones(len(X)))) if constant == "with" else X
                held = {column: off(X, of, away >= 0) for column, of in HELD_OUT.items()}
                models.append(({"model": f"paper, {density}", "constant": constant}, X, held))
        held = {c: best.component("normal", of) - measured
                for c, of in HELD_OUT.items() if of in best.predicted}  # fmt: skip
        models.append(({"model": best.name}, None, held))
        rows = []
        for words, columns, held in models:
            for distance in np.unique(away):
                mine = away == distance
                row = {**words, "distance_mm": distance, "points": int(mine.sum())}
                if columns is not None:
                    row["alone_n"] = root_mean_square(off(columns, "point", mine))
                rows.append(row | {c: root_mean_square(each[:, mine]) for c, each in held.items()})
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


def _errors(judged: EvaluatedModel, data: ForceData) -> str:
    """Words like "normal force to 0.17 N (2.0 % of 8.7 N), shear to 0.03 and 0.04 N (...)"."""
    of = force_figures(judged, data)

    def one(name: str) -> tuple[str, str]:
        error, share = of[name][f"rmse_left_out_{judged.ranked_by}_n"], of[name]["percent_of_range"]
        return ("unknown", "?") if error is None else (f"{error:.2f} N", f"{share:.1f} %")

    (normal, part), *shears = (one(name) for name in FORCE_COMPONENTS)
    text = f"normal force to {normal} ({part} of {of['normal']['range_n']:.1f} N), "
    if not any(of[name]["range_n"] for name in FORCE_COMPONENTS[1:]):
        return f"{text}shear not calibrated (there was none)"
    values, parts = (" and ".join(column) for column in zip(*shears, strict=True))
    return f"{text}shear to {values} ({parts})"
