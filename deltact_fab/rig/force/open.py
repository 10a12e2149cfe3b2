"""The force sensor that a rig file declares, opened, and the guard on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...errors import InputError
from ..interface import Clock, ForceSensor, Stage
from .config import ForceConfig, GuardConfig
from .guard import GuardLimits
from .netft import SILENT_S, NetFTSensor

if TYPE_CHECKING:
    from .watchdog import Watchdog


def open_guarded(
    config: ForceConfig, guard: GuardConfig | None, stage: Stage, patience: float = 1.0
) -> Watchdog:
    """The sensor of a rig file, and in one with it the guard that stops the stage.

    patience: times the silence, and the age of its samples, that the sensor is allowed. Raises as
    `open_force`, and InputError for a limit that the sensor cannot measure.
    """
    from .watchdog import Watchdog

    force = Watchdog(config, GuardLimits.of(guard, config), patience)
    stage.share(force.hold)
    return force


def open_force(config: ForceConfig, clock: Clock, timeout_s: float = SILENT_S) -> ForceSensor:
    """The sensor, reached and not streaming yet. timeout_s: silence for so long is an error.

    Raises InputError where the table names no way to it, SensorError where it cannot be reached,
    MissingLibrary.
    """
    if config.netft is not None:
        from .page import fetch
        from .rdt import RdtLink

        return NetFTSensor(RdtLink(config.netft, fetch(config.netft)), clock, timeout_s)
    if config.serial is not None:
        from .scale import SerialScale

        return SerialScale(config, clock)
    raise InputError(
        "force: no way to the sensor; add [force.netft] with its host, or [force.serial] with its "
        "port, to the rig file"
    )
