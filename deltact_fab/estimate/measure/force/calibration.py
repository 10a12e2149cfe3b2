"""A force calibration: a fitted model, its sensor, its errors and an image of the face at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import InputError, validate
from deltact_fab.sensor import SkinDimensions
from deltact_fab.version import PACKAGE_VERSION

from ..sensor_id import (
    CalibrationHead,
    CalibrationSource,
    SensorModel,
    read_calibration,
    read_rest,
    rest_table,
)
from .model import ForceModel

FORMER_FEATURES = {"inverse": "inverse-placed", "paper-mirrored": "paper"}
"""Features of older files, which are not fitted any more, and those that compute the same."""


@dataclass(frozen=True)
class ForceCalibration:
    """Force calibration, as written by `calibrate force` and read by a measurement.

    skin, poisson: gel that the features were computed with. error: of each component in the
    paper's words (`normal`, `shear_x` ...), root mean squares by what was left out. transfer: its
    factors and errors if transferred from another sensor. rest: image of the untouched face, PNG.
    """

    head: CalibrationHead
    model: ForceModel
    skin: SkinDimensions
    poisson: float
    error: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    transfer: Mapping[str, Any] = field(default_factory=dict)
    rest: bytes | None = None

    @classmethod
    def from_simulation(
        cls,
        name: str,
        model: ForceModel,
        sensor: SensorModel,
        seed: int,
        error: Mapping[str, Mapping[str, Any]],
    ) -> ForceCalibration:
        """Build a calibration from simulated presses. name: of the simulation, with this seed."""
        source = CalibrationSource((name,), True, PACKAGE_VERSION, seed)
        head = CalibrationHead("force", sensor.id, source)
        return cls(head, model, sensor.skin, sensor.poisson, error)

    def view(self, view: SensorModel) -> SensorModel:
        """Return the view with this calibration's gel and, if stored, its image of the face."""
        import cv2

        rest = view.rest
        if self.rest is not None:
            coded = np.frombuffer(self.rest, np.uint8)
            rest = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        return replace(view, skin=self.skin, poisson=self.poisson, rest=rest)

    def toml(self, rest_name: str) -> str:
        """Format as TOML; rest_name: file name of the image of the face at rest."""
        rest = None if self.rest is None else rest_table(rest_name, self.rest)
        tables: dict[str, Mapping[str, Any]] = {
            "view": {"poisson": self.poisson, "skin": asdict(self.skin)},
            "model": self.model.as_dict(),
            "error": self.error,
            "transfer": self.transfer,
            "rest": rest or {},
        }
        return self.head.toml({name: table for name, table in tables.items() if table})


def load_force(path: Path) -> ForceCalibration:
    """Load a force calibration. Raises InputError, one line, for any other or damaged file."""
    head, data = read_calibration(path, "force")
    tables: dict[str, Any] = {}
    for key in ("view", "model", "error", "transfer", "rest"):
        tables[key] = data.pop(key, None if key in ("view", "model") else {})
        if not isinstance(tables[key], dict):
            raise InputError(f"{path}: {key}: missing table")
    if data:
        raise InputError(f"{path}: {next(iter(data))}: unknown key; remove it")
    view = tables["view"]
    poisson = view.get("poisson")
    if not isinstance(poisson, float) or not 0 < poisson < 0.5:
        raise InputError(f"{path}: view.poisson must be between 0 and 0.5 (got {poisson!r})")
    skin = validate(SkinDimensions, view.get("skin"), f"{path}: view.skin")
    try:
        model = ForceModel.from_dict(tables["model"])
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    model = replace(model, features=FORMER_FEATURES.get(model.features, model.features))
    rest = read_rest(path, tables["rest"])
    return ForceCalibration(head, model, skin, poisson, tables["error"], tables["transfer"], rest)
