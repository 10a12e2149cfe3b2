"""A board with GRBL 1.1h."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..controller import GrblController
from ..grbl_settings import settings_for

if TYPE_CHECKING:
    from ...rig.config import StageConfig
    from ..board import SimulatedBoard
    from ..clock import NsClock


def _board(config: StageConfig, clock: NsClock) -> SimulatedBoard:
    limits = config.travel_mm, config.max_feed_mm_min, config.acceleration_mm_s2
    return GrblController(settings_for(*limits), clock)


BOARDS = {"grbl": _board}
