"""GRBL 1.1 and grblHAL."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...config import StageConfig
    from ...interface import Clock, Stage


def _stage(config: StageConfig, clock: Clock, url: str) -> Stage:
    from ..grbl import GrblStage

    return GrblStage.of(config, clock, url)


FIRMWARE = {"grbl": _stage}
