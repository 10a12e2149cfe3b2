"""Fabrication and experiment-design toolchain for the DelTact tactile sensor.

`import deltact_fab as dt` is enough for most scripts; a name is loaded when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .door import open_door
from .version import VERSION as __version__

if TYPE_CHECKING:
    from .cad.build import build_named as build_part
    from .live.session import LiveMeasurement as Live
    from .live.session import measure_source, track
    from .patterns import make as make_pattern
    from .record import open as load_run
else:
    __getattr__, __dir__ = open_door(__name__)

__all__ = [  # noqa: RUF022
    "__version__", "make_pattern", "build_part", "load_run", "track", "measure_source", "Live",
]  # fmt: skip
