"""The force sensor that a rig file declares, opened."""

from __future__ import annotations

from ...errors import InputError
from ..interface import Clock, ForceSensor
from .config import ForceConfig
from .netft import NetFTSensor


def open_force(config: ForceConfig, clock: Clock) -> ForceSensor:
    """The sensor, reached and not streaming yet.

    Raises InputError where the table names no way to it, SensorError where it cannot be reached,
    MissingLibrary.
    """
    if config.netft is not None:
        from .page import fetch
        from .rdt import RdtLink

        return NetFTSensor(RdtLink(config.netft, fetch(config.netft)), clock, config.netft.silent_s)
    if config.serial is not None:
        from .scale import SerialScale

        return SerialScale(config, clock)
    raise InputError(
        "force: no way to the sensor; add [force.netft] with its host, or [force.serial] with its "
        "port, to the rig file"
    )
