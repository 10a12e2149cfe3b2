"""Shape, depth and contacts of a run's settled frames, against truth where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deltact_fab.bench import open_run
from deltact_fab.common import Progress, run_each

from ...measure.force.calibration import load_force
from ...measure.sensor_id import require_same_sensor
from ...measure.shape.depth import DepthModel
from ..runs import read_frames, sensor_of, write_results
from .press import PressShape, ShapeMaps, measure_press

GOAL_LABELS = ("depth over the contact", "over the face", "position of a ball")
SHAPE_FIGURES = (
    "depth_error_contact_mm", "depth_error_face_mm", "zero_error_contact_mm", "depth_correlation",
    "relative_correlation", "contact_iou", "centroid_error_mm", "place_error_mm", "area_mm2",
    "true_area_mm2", "cover",
)  # fmt: skip


@dataclass(frozen=True)
class ShapeResult:
    """Shape measured in the settled frames of a run.

    rows: figures of each frame by name, without unknown ones. calibration: file of the depth
    calibration, None: uncalibrated. contact_by: criterion of the true contact. pictures: the
    deepest of each indenter. field: maps with tractions by a force calibration: the most twisted
    frame, else the first.
    """

    GOALS: ClassVar = {
        "depth_error_contact_mm": 0.25,
        "depth_error_face_mm": 0.03,
        "place_error_mm": 0.5,
    }
    """Upper limits of the means over the frames that press (docs/evidence/shape.md)."""

    rows: list[dict[str, Any]]
    pictures: list[ShapeMaps]
    calibration: str | None
    contact_by: str | None
    simulated: bool
    seed: int
    field: ShapeMaps | None = None

    def means(self, indenter: str | None = None) -> dict[str, Any]:
        """Means of SHAPE_FIGURES over the frames that press (of one indenter), and their number."""
        rows = [
            row
            for row in self.rows
            if row["tip_depth_mm"] > 0 and indenter in (None, row["indenter"])
        ]
        means: dict[str, Any] = {"frames": len(rows)}
        for name in SHAPE_FIGURES:
            values = [row[name] for row in rows if row.get(name) is not None]
            means[name] = float(np.mean(values)) if values else None
        return means

    @property
    def indenters(self) -> list[str]:
        return list(dict.fromkeys(row["indenter"] for row in self.rows))

    @property
    def missed(self) -> list[str]:
        """Names of the GOALS that the means exceed."""
        means = self.means()
        return [name for name, goal in self.GOALS.items() if (means[name] or 0.0) > goal]

    @property
    def line(self) -> str:
        """The verdict: mean errors of depth and place."""
        means = self.means()
        how = "uncalibrated" if self.calibration is None else f"by {Path(self.calibration).name}"
        if means["depth_error_contact_mm"] is None:
            return f"Shape of {means['frames']} frames, depth {how}; error unknown without truth."
        parts = [
            f"{label} {means[name]:.3f} mm{f' (goal: {goal:g})' if name in self.missed else ''}"
            for (name, goal), label in zip(self.GOALS.items(), GOAL_LABELS, strict=True)
            if means[name] is not None
        ]
        # An unpressed face has no depth either, so the error over the face alone flatters.
        return (
            f"Mean error of {means['frames']} frames, depth {how}: {', '.join(parts)}; "
            f"baseline (zero depth): {means['zero_error_contact_mm']:.3f} mm over the contact."
        )

    @property
    def note(self) -> str:
        """Source of the figures: simulated or measured, and the criterion of the true contact."""
        source = f"; true contact by {self.contact_by}" if self.contact_by else ""
        if self.contact_by == "geometry":
            source += " (too small on a coarse gel mesh; record the channel 'traction' instead)"
        return (f"simulated, seed {self.seed}" if self.simulated else "measured") + source

    def as_dict(self) -> dict[str, Any]:
        return {
            "verdict": self.line,
            "goals": self.GOALS,
            "simulated": self.simulated,
            "seed": self.seed,
            "calibration": self.calibration,
            "contact_by": self.contact_by,
            "mean": self.means(),
            "by_indenter": {name: self.means(name) for name in self.indenters},
            "frames": self.rows,
        }

    def save(self, folder: Path) -> list[Path]:
        """Write shape.json. Raises RunFailed where it cannot be written."""
        return write_results(folder, {"shape.json": self.as_dict()})


UNCALIBRATED_DEPTH = DepthModel(gain=1.0, deepest_mm=20.0)  # by hand: never extrapolated


def analyse_shape(
    folder: str | Path,
    depth: Path | None = None,
    force: Path | None = None,
    progress: Progress | None = None,
) -> ShapeResult:
    """Analyse every settled frame of a run.

    depth: a depth calibration, None: uncalibrated. force: a force calibration, to compare force
    and pressure with the force sensor. Raises InputError for a run that is not finished or has no
    images, and for a calibration that is invalid or another sensor's.
    """
    run = open_run(folder)
    frames = read_frames(run, "shape")
    _ = run.camera  # raises first where there is none
    model = UNCALIBRATED_DEPTH
    if depth is not None:
        head, model = DepthModel.load(depth)
        require_same_sensor(head, sensor_of(run), str(depth))
    calibration = None if force is None else load_force(force)
    if calibration is not None:
        require_same_sensor(calibration.head, sensor_of(run), str(force))
    presses = list(dict.fromkeys(frames["press"]))
    work = partial(measure_press, str(folder), depth=model, force=calibration)
    parts = run_each(work, presses, presses, progress=progress)
    criteria = {part.contact_by for part in parts} - {None}
    pictures = PressShape.deepest_maps(parts)
    twisted = [part.twisted for part in parts if part.twisted is not None]
    twisted.sort(key=lambda p: -abs(p.torque_z_nmm or 0.0))
    return ShapeResult(
        rows=[row for part in parts for row in part.rows],
        pictures=pictures,
        calibration=None if depth is None else str(depth),
        contact_by=", ".join(sorted(map(str, criteria))) or None,
        simulated=run.simulated,
        seed=int(run.meta.get("seed", 0)),
        field=next((p for p in (*twisted, *pictures) if p.tractions), None),
    )
