"""Reading of user files within limits, so that no file can block or crash the reader."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

from .errors import InputError

MAX_SETTINGS_BYTES = 4 * 2**20
"""Settings file, usually a few kB; by hand: this much is parsed in about a second."""
MAX_SETTINGS_KEYS = 20_000
"""Settings file, usually some hundred; by hand: tomllib takes up to 50 us per key."""
MAX_RECORD_BYTES = 64 * 2**20
"""Table or record written by a program; by hand: bounds the memory."""
MAX_RECORD_VALUES = 1_000_000
"""Values of a JSON file; by hand: an object of one takes up to half a kB when it is read."""
MAX_NESTING_LEVELS = 32
"""Nesting of tables and lists; by hand: settings files have four, the stack allows more."""
_DEEP_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{MAX_NESTING_LEVELS}}}")
_MAX_INTEGER = 2**63  # format TOML 1.0, "Integer": 64 bits, signed


def read_text(path: Path, max_bytes: int = MAX_SETTINGS_BYTES) -> str:
    """Read a UTF-8 text file, with or without BOM.

    Raises InputError if it cannot be read, exceeds max_bytes or is not UTF-8.
    """
    try:
        # One that no shell has opened blocks until another program writes to it.
        if path.is_fifo() and path.resolve().exists():
            raise InputError(f"{path}: is a FIFO; expected a file")
        with path.open("rb") as file:  # a pipe has no size
            data = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from error
    if len(data) > max_bytes:
        raise InputError(f"{path}: larger than {max_bytes / 2**20:g} MiB; is it the right file?")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = f"byte {error.start} is {data[error.start]:#x}"
        raise InputError(f"{path}: not UTF-8 text: {byte}") from error


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises InputError naming the file and the location in it."""
    content = read_text(path)
    if content.count("=") + content.count("\n[") > MAX_SETTINGS_KEYS:
        raise InputError(f"{path}: more than {MAX_SETTINGS_KEYS} keys; is it the right file?")
    try:
        # Before parsing, whose time is quadratic in a key's depth.
        if _DEEP_KEY.search(content):
            raise RecursionError
        data = tomllib.loads(content)
        _check_values(data)
    except RecursionError as error:
        raise InputError(f"{path}: nested too deep; expected a few levels") from error
    except ValueError as error:  # also an integer of thousands of digits
        raise InputError(f"{path}: not valid TOML: {error}") from error
    return data


def read_json(path: Path) -> dict[str, Any]:
    """Read the object of a JSON file. Raises InputError naming the file."""
    return parse_json(read_text(path, MAX_RECORD_BYTES), str(path))


def parse_json(content: str | bytes, source: str) -> dict[str, Any]:
    """Parse the object of a JSON text. Raises InputError naming its source."""
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        if text.count("{") + text.count("[") + text.count(",") > MAX_RECORD_VALUES:
            raise ValueError(f"more than {MAX_RECORD_VALUES} values")
        data = json.loads(text)
        _check_values(data, finite=True)
    except RecursionError as error:
        raise InputError(f"{source}: nested too deep; expected a few levels") from error
    except ValueError as error:
        raise InputError(f"{source}: not valid JSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{source}: an object is needed, as in {{...}}, not {type(data).__name__}")
    return data


def _check_values(data: object, finite: bool = False) -> None:
    """Raise ValueError for integers over 64 bits, RecursionError over MAX_NESTING_LEVELS.

    finite: raise ValueError for infinity and NaN too, which the format JSON does not have.
    """
    waiting: list[tuple[str, Any, int]] = [("value", [data], -1)]
    while waiting:
        key, table, level = waiting.pop()
        if level > MAX_NESTING_LEVELS:
            raise RecursionError
        items = table.items() if isinstance(table, dict) else ((key, item) for item in table)
        for name, value in items:
            if isinstance(value, dict | list):
                waiting.append((name, value, level + 1))
            elif isinstance(value, int) and not -_MAX_INTEGER <= value < _MAX_INTEGER:
                raise ValueError(f"an integer of {value.bit_length()} bits; expected at most 64")
            elif finite and isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name}: must be a finite number (got {value})")
