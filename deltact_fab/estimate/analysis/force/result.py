"""Result of `calibrate force`: its texts, tables and files."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from dataclasses import field as made_by
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from deltact_fab.bench import Run
from deltact_fab.common import Array, make_folder, write_whole

from ...measure.force import FORCE_FEATURES, FORCE_READINGS
from ...measure.force.calibration import ForceCalibration
from ..intervals import MIN_GROUPS, Interval
from ..runs import write_results
from .dataset import ForceData
from .gel import IdentifiedGel, UnrelaxedForces
from .judge import (
    FORCE_COMPONENTS,
    FORCE_SPLITS,
    WRENCH_LABELS,
    EvaluatedModel,
    LearningCurve,
    error_interval,
    force_component,
    force_figures,
)

PAPER_CONDITIONS = "paper"
VARIED_UNITS = {"press": "presses", "position": "places", "indenter": "tips"}


@dataclass
class ForceResult:
    """Feature sets fitted and cross-validated on the points of one sensor.

    models: best first; the best one is the calibration. curves: by feature set, see
    `learning_curve`. gel: fitted to the presses, None where the design's is kept. unrelaxed:
    correction of early labels, None: not needed. validation: errors on presses to validate, by
    component. reference: change of force over the run, %.
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
    notes: list[str]
    curves: dict[str, LearningCurve] = made_by(default_factory=dict)
    gel: IdentifiedGel | None = None
    unrelaxed: UnrelaxedForces | None = None
    validation: dict[str, Interval] = made_by(default_factory=dict)
    reference: Interval | None = None

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
    def curve(self) -> LearningCurve:
        """Learning curve of the best model."""
        return self.curves.get(self.best.name) or LearningCurve({})

    def error_interval(self, model: EvaluatedModel, name: str, split: str) -> Interval | None:
        """Interval of a model's error of a component by a split; None where it is unknown."""
        errors = model.component(name, split) - self.wrench_component(name)
        return error_interval(errors, self.data.points, split)

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
        """The verdict: the best model and its errors, and what they do not cover."""
        points, split = self.data.points, self.best.ranked_by
        varied = [column for column in VARIED_UNITS if points[column].nunique() > 1]
        tested_on = FORCE_SPLITS[split]
        if split == "unseen":  # all points share a sole position or indenter
            tested_on = f"unseen {' and '.join(c for c in varied if c != 'press')}"
        text = f"Use {self.best.name}: {self._format_errors(self.best)}, {tested_on}"
        if (points["position"] == Run.UNKNOWN).all():  # of an imported run
            return text.replace("presses", "time segments")
        interval = self.error_interval(self.best, "normal", split)
        text += "" if interval is None else f" ({interval.over})"
        if self.paper is not self.best:
            text += f"; the paper's model {self._format_errors(self.paper)}"
        if single := [noun for column, noun in VARIED_UNITS.items() if column not in varied]:
            text += f"; says nothing of other {' or '.join(single)}"
        if points["position"].nunique() < MIN_GROUPS:
            text += f"; at least {MIN_GROUPS} places are needed"
        return f"{text}; {self.curve.clause}"

    def _format_errors(self, model: EvaluatedModel) -> str:
        """Text like "normal force to 0.17 N [0.1 to 0.3] (2.0 % of 8.7 N), shear to 0.03 N ...".

        Each share stands beside the range of the presses that it refers to.
        """
        figures, words = force_figures(model, self.data), []
        for name in FORCE_COMPONENTS:
            span, percent = figures[name]["range_n"], figures[name]["percent_of_range"]
            error, share = "unknown", "?"
            if span and (interval := self.error_interval(model, name, model.ranked_by)):
                error = interval.format("N") if model is self.best else f"{interval.value:.2f} N"
                share = f"{percent:.1f} %"
            words.append((error, f"{share} of {span:.1f} N"))
        (normal, part), *shears = words
        text = f"normal force to {normal} ({part}), "
        if not any(figures[name]["range_n"] for name in FORCE_COMPONENTS[1:]):
            return f"{text}shear not calibrated (no shear in the data)"
        values, parts = (" and ".join(column) for column in zip(*shears, strict=True))
        return f"{text}shear to {values} ({parts})"

    @property
    def findings(self) -> list[str]:
        """Further results, one line each."""
        lines = [finding.line for finding in (self.unrelaxed, self.gel) if finding]
        return [*lines, *unfitted_lines(self.validation, self.reference)]

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
            "learning_n": {name: curve.errors_n for name, curve in self.curves.items()},
            "more_presses": {
                "enough": self.curve.enough,
                "last_step": self.curve.last_step and self.curve.last_step._asdict(),
            },
            "intervals": {
                name: interval._asdict()
                for name in WRENCH_LABELS
                if (interval := self.error_interval(self.best, name, self.best.ranked_by))
            },
            "validation": {name: i._asdict() for name, i in self.validation.items()},
            "reference_percent": self.reference and self.reference._asdict(),
            "gel": None if self.gel is None else asdict(self.gel),
            "early_labels": None if self.unrelaxed is None else asdict(self.unrelaxed),
            "left_out": self.notes,
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

    def save(self, folder: Path, output: Path) -> list[Path]:
        """Write force.json, force.csv (one row per point) and the calibration with its image."""
        files = write_results(folder, {"force.json": self.as_dict(), "force.csv": self.points()})
        if self.calibration.skin is not None:  # None of an imported run `in_pixels`
            files += write_force_calibration(self.calibration, output)
        return files


def unfitted_lines(validation: dict[str, Interval], reference: Interval | None) -> list[str]:
    """Results of the presses that are not fitted, one line per role."""
    lines = []
    if error := validation.get("normal"):
        lines.append(f"validation: normal force to {error.format('N')} ({error.over})")
    if reference:
        change = f"normal force changed by {reference.format('%')} over the run"
        lines.append(f"reference: {change} ({reference.over})")
    return lines


def write_force_calibration(calibration: ForceCalibration, path: Path) -> list[Path]:
    """Write a calibration and the image of the face at rest beside it, each file atomically."""
    make_folder(path.parent)
    rest = path.with_name(f"{path.stem}.rest.png")
    # The image first, so that the calibration never names a missing one.
    if calibration.rest is not None:
        write_whole(rest, calibration.rest)
    write_whole(path, calibration.toml(rest.name).encode())
    return [path] if calibration.rest is None else [path, rest]
