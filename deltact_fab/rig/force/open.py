"""The force sensor that a rig file declares, opened, and the guard on it."""

from __future__ import annotations

from ...errors import InputError
from ..interface import Clock, ForceSensor, Stage
from .config import ForceConfig, GuardConfig
from .guard import BEHIND_S, ForceGuard, GuardLimits
from .netft import SILENT_S, NetFTSensor


def open_guarded(
    config: ForceConfig,
    guard: GuardConfig | None,
    stage: Stage,
    clock: Clock,
    patience: float = 1.0,
) -> tuple[ForceSensor, ForceGuard]:
    """The sensor of a rig file, and the guard on it that stops the stage.

    patience: times the silence, and the age of its samples, that the sensor is allowed. Raises as
    `open_force`, and InputError for a limit that the sensor cannot measure.
    """
    limits = GuardLimits.of(guard, config)
    force = open_force(config, clock, patience * SILENT_S)
    return force, ForceGuard(stage, limits, clock, patience * BEHIND_S)


def open_force(config: ForceConfig, clock: Clock, timeout_s: float = SILENT_S) -> ForceSensor:
    """The sensor, reached and not streaming yet. timeout_s: silence for so long is an error.

    Raises InputError where the table names no way to it, SensorError where it cannot be reached,
    MissingLibrary.
    """
    if config.netft is not None:
        from .link import PynetftLink
        from .page import fetch

        return NetFTSensor(PynetftLink(config.netft, fetch(config.netft)), clock, timeout_s)
    if config.serial is not None:
        from .scale import SerialScale

        return SerialScale(config, clock)
    raise InputError(
        "force: no way to the sensor; add [force.netft] with its host, or [force.serial] with its "
        "port, to the rig file"
    )
