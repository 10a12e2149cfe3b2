"""What a kept result was made from, as plain data: the values, and the libraries behind them."""

from __future__ import annotations

import importlib.metadata
import platform
import zlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from typing import Any

from .. import __version__

_PACKAGES = ("cadquery", "cadquery-ocp", "ezdxf", "numpy", "scipy")


def plain(value: Any) -> Any:
    """Nested dataclasses as JSON holds them, each with the name of its class."""
    if is_dataclass(value) and not isinstance(value, type):
        inside = {f.name: plain(getattr(value, f.name)) for f in fields(value)}
        return {"class": type(value).__name__, **inside}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    # What it does is in the digest of the sources.
    return value.__qualname__ if callable(value) else value


@lru_cache(maxsize=1)
def libraries() -> dict[str, str]:
    """Versions and machine that decide the bytes as well."""
    return {
        "deltact-fab": __version__,
        "machine": platform.machine(),
        "zlib": zlib.ZLIB_RUNTIME_VERSION,
        **{name: _version(name) for name in _PACKAGES},
    }


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "absent"
