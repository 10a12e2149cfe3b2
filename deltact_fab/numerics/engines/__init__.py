"""The registered engines. One name here and a module with `ENGINE` is all that a new one needs."""

from __future__ import annotations

import importlib
import os

from ...errors import InputError, did_you_mean
from ...jobs import Local
from ..engine import Engine

# Modules, imported only when asked for: an engine needs libraries that another does not.
REGISTRY = {name: f"{__name__}.{name}" for name in ("pattern", "flow", "gel", "measure")}


def check_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """The engines asked for, all when none is named. Raises InputError for an unknown one."""
    for name in names:
        if name not in REGISTRY:
            raise InputError(f"engine {name!r}: unknown; {did_you_mean(name, REGISTRY)}")
    return tuple(dict.fromkeys(names)) or tuple(REGISTRY)


def load(module: str) -> Engine:
    """The engine of a module. Raises TypeError when the module has none."""
    engine = importlib.import_module(module).ENGINE
    if not isinstance(engine, Engine):
        raise TypeError(f"{module}.ENGINE is no Engine")
    return engine


def alone() -> Local:
    """A process of one thread, for `on_one_core`."""
    process = Local(1)
    process.threads = 1
    return process


def on_one_core() -> None:
    """In such a process: kept on one core where the system can, and silent on standard output."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, [max(os.sched_getaffinity(0))])
    os.dup2(2, 1)
