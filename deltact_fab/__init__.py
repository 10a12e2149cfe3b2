"""Fabrication and experiment-design toolchain for the DelTact tactile sensor.

`import deltact_fab as dt` is enough for most scripts; a name is loaded when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .version import VERSION as __version__

if TYPE_CHECKING:
    from .cad.build import build_named as build_part
    from .live.session import LiveMeasurement as Live
    from .live.session import measure_source, track
    from .patterns import make as make_pattern
    from .record import open as load_run
else:
    _HOMES = {
        "Live": ("live.session", "LiveMeasurement"),
        "build_part": ("cad.build", "build_named"),
        "load_run": ("record", "open"),
        "make_pattern": ("patterns", "make"),
        "measure_source": ("live.session", "measure_source"),
        "track": ("live.session", "track"),
    }

    def __getattr__(name: str) -> object:
        from importlib import import_module

        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, there = _HOMES[name]
        return globals().setdefault(name, getattr(import_module(f".{module}", __name__), there))

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})


__all__ = [  # noqa: RUF022
    "__version__", "make_pattern", "build_part", "load_run", "track", "measure_source", "Live",
]  # fmt: skip
