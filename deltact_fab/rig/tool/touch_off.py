"""One touch-off, the way the rig file says: by the force sensor or by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...errors import InputError
from ...shapes import Indenter
from ..interface import Clock, ForceSensor, Stage
from .config import TouchConfig
from .feeler import ForceProbe
from .manual_touch import HandTouch
from .operator import Operator
from .touch import FaceTouch, ForceTouch

if TYPE_CHECKING:
    from ..force.guard import ForceGuard


def find_face(
    stage: Stage,
    force: ForceSensor,
    clock: Clock,
    guard: ForceGuard | None,
    config: TouchConfig,
    operator: Operator | None,
    indenter: Indenter,
    at_mm: tuple[float, float],
) -> FaceTouch:
    """Where the face is below a point of it (mm, the stage's frame). operator: None is nobody.

    Raises InputError, RunFailed, SensorError, StageError.
    """
    if config.by == "force":
        return ForceTouch(stage, force, clock, guard, config).find(indenter, at_mm)
    if operator is None:
        raise InputError("touch.by = 'hand' needs somebody there: not with --unattended")
    feeler = ForceProbe(stage, force, clock, guard)
    return HandTouch(stage, feeler, operator, config).find(indenter, at_mm)
