"""A force calibration: a fitted model, whose it is, what it may be trusted to, the face at rest."""

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

FORMER = {"inverse": "inverse-placed", "paper-mirrored": "paper"}
"""Features of older files by those that have their numbers; they are not fitted any more."""


@dataclass(frozen=True)
class ForceCalibration:
    """Calibration of force, as `calibrate force` writes and a measurement reads it.

    skin, poisson: what the features were made with. error: of each component in the paper's words
    (`normal`, `shear_x` ...), root mean squares by what was left out, for a display of forces.
    transfer: how it was carried over from another sensor, if it was. rest: the face untouched,
    PNG, as the camera's images are tracked.
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
        """Calibration by simulated presses. name: of what was simulated, with this seed."""
        source = CalibrationSource((name,), True, PACKAGE_VERSION, seed)
        head = CalibrationHead("force", sensor.id, source)
        return cls(head, model, sensor.skin, sensor.poisson, error)

    def view(self, view: SensorModel) -> SensorModel:
        """With the gel that the features were made with, and the face at rest if it is kept."""
        import cv2

        rest = view.rest
        if self.rest is not None:
            coded = np.frombuffer(self.rest, np.uint8)
            rest = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        return replace(view, skin=self.skin, poisson=self.poisson, rest=rest)

    def toml(self, rest_name: str) -> str:
        """The text of the file beside which the face at rest lies as `rest_name`."""
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
    """A calibration of force. Raises InputError of one line for anything that is none."""
    head, data = read_calibration(path, "force")
    held: dict[str, Any] = {}
    for key in ("view", "model", "error", "transfer", "rest"):
        held[key] = data.pop(key, None if key in ("view", "model") else {})
        if not isinstance(held[key], dict):
            raise InputError(f"{path}: {key}: missing table")
    if data:
        raise InputError(f"{path}: {next(iter(data))}: unknown key; remove it")
    view = held["view"]
    poisson = view.get("poisson")
    if not isinstance(poisson, float) or not 0 < poisson < 0.5:
        raise InputError(f"{path}: view.poisson: a number between 0 and 0.5 (got {poisson!r})")
    skin = validate(SkinDimensions, view.get("skin"), f"{path}: view.skin")
    try:
        model = ForceModel.from_dict(held["model"])
    except InputError as why:
        raise InputError(f"{path}: {why}") from why
    model = replace(model, features=FORMER.get(model.features, model.features))
    rest = read_rest(path, held["rest"])
    return ForceCalibration(head, model, skin, poisson, held["error"], held["transfer"], rest)
