"""A sensor as its calibrations know it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...aliases import Array
from ...errors import InputError
from ...optics import CameraModel
from ...shapes import SkinDimensions
from ..force import ForceModel
from ..force.calibration import ForceCalibration, load_force
from ..health import Health, health
from ..sensor_id import Head, SensorId, read_calibration, require_same
from ..shape import DepthModel
from ..view import SensorView

Calibration = ForceModel | ForceCalibration | DepthModel | Path | str


@dataclass(frozen=True)
class Calibrated:
    """view: with the calibration's skin where only a camera was given. rest: the face untouched."""

    view: SensorView
    force: ForceModel | None = None
    depth: DepthModel | None = None
    rest: Array | None = None

    @classmethod
    def of(
        cls,
        view: SensorView | CameraModel,
        calibrations: Sequence[Calibration],
        rest: Array | None = None,
    ) -> Calibrated:
        """Of a sensor and its calibrations, at most one a kind.

        rest: where no calibration keeps one. Raises InputError for a file that is none, another
        sensor's, and a second one of a kind.
        """
        camera = view.camera if isinstance(view, SensorView) else view
        whole = view if isinstance(view, SensorView) else None
        found: dict[str, Any] = {"rest": rest}
        for given in calibrations:
            name = str(given) if isinstance(given, Path | str) else "calibration"
            held = _read(Path(given)) if isinstance(given, Path | str) else given
            head, model = held if isinstance(held, tuple) else (None, held)
            if isinstance(model, ForceCalibration):
                kept = model.rest_image()
                head, found["rest"] = model.head, rest if kept is None else kept
                whole, model = whole or model.view(camera), model.model
            if head is not None:
                require_same(head, SensorId.of(camera), name)
            kind = "force" if isinstance(model, ForceModel) else "depth"
            if kind in found:
                raise InputError(f"{name}: a second calibration of {kind}; one is needed")
            found[kind] = model
        return cls(whole or SensorView(camera, SkinDimensions()), **found)

    def health(self, unloaded: Array) -> Health | None:
        """Of an unloaded face (h, w[, 3]) as it is tracked; None with no image to compare."""
        return None if self.rest is None else health(self.rest, unloaded, self.view.camera)


def _read(path: Path) -> ForceCalibration | tuple[Head, DepthModel]:
    head, _ = read_calibration(path)
    return load_force(path) if head.kind == "force" else DepthModel.load(path)
