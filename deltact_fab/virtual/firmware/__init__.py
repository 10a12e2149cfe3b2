"""Simulated boards by firmware: a file each, with BOARDS: names to functions that make one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ...discover import entries, modules_in
from ...errors import InputError, did_you_mean

if TYPE_CHECKING:
    from ...rig.config import StageConfig
    from ..board import SimulatedBoard
    from ..clock import NsClock

BOARDS: dict[str, Callable[[StageConfig, NsClock], SimulatedBoard]] = entries(
    modules_in(__package__), "BOARDS"
)


def board_of(config: StageConfig, clock: NsClock) -> SimulatedBoard:
    """The simulated board of a rig file. Raises InputError where there is none."""
    if config.firmware not in BOARDS:
        raise InputError(
            f"stage.firmware: no board with {config.firmware!r} is simulated; "
            f"{did_you_mean(config.firmware, BOARDS)}"
        )
    return BOARDS[config.firmware](config, clock)
