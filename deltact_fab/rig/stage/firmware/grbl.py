"""GRBL 1.1 and grblHAL."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...interface import Clock, Stage
    from ..config import StageSettings


def _stage(config: StageSettings, clock: Clock, url: str) -> Stage:
    from ..grbl import GrblStage

    return GrblStage.of(config, clock, url)


FIRMWARE = {"grbl": _stage}
