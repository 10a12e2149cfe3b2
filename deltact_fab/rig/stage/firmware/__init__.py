"""What a stage's controller speaks: a file each firmware, with FIRMWARE: names to stages.

A function takes `[stage]` of a rig file, the clock and the port's URL, and returns a `Stage` whose
port is not yet open. `virtual.firmware` has the simulated boards. Imports no driver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ....discover import entries, modules_in

if TYPE_CHECKING:
    from ...interface import Clock, Stage
    from ..config import StageSettings

FIRMWARE: dict[str, Callable[[StageSettings, Clock, str], Stage]] = entries(
    modules_in(__package__), "FIRMWARE"
)


def open_stage(config: StageSettings, clock: Clock, url: str | None = None) -> Stage:
    """The stage of a rig file, its port not yet open; url: in place of the file's port."""
    where = url if url is not None else config.port
    assert where is not None, "the configuration has a port"
    return FIRMWARE[config.firmware](config, clock, where)
