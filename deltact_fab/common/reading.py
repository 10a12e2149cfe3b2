"""Text files that a user gives, read within limits: no file can make the reader wait or fail."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from .errors import InputError

MAX_SETTINGS_BYTES = 4 * 2**20
"""Of a file of settings, a few kB long as a rule: so much is parsed in about a second."""
MAX_SETTINGS_KEYS = 20_000
"""Of a file of settings, which has some hundred: tomllib needs up to 50 us for one."""
MAX_RECORD_BYTES = 64 * 2**20
"""Of a table or a record that a program wrote."""
MAX_NESTING_LEVELS = 32
"""Of tables and lists in each other; a file of settings has four."""
_DEEP_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]+[ \t]*\.[ \t]*){{{MAX_NESTING_LEVELS}}}")
_MAX_INTEGER = 2**63  # TOML 1.0, "Integer": 64 bits, signed


def read_text(path: Path, max_bytes: int = MAX_SETTINGS_BYTES) -> str:
    """Read the text of a file, UTF-8 with or without its mark.

    Raises InputError of one line: it cannot be read, is longer than most_bytes, or is no UTF-8.
    """
    try:
        with path.open("rb") as file:  # a pipe has no size to ask for
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
    """Read the tables of a TOML file. Raises InputError naming the file and the place in it."""
    content = read_text(path)
    if content.count("=") + content.count("\n[") > MAX_SETTINGS_KEYS:
        raise InputError(f"{path}: more than {MAX_SETTINGS_KEYS} keys; is it the right file?")
    try:
        # Before parsing, whose time grows with the square of a key's depth.
        if _DEEP_KEY.search(content):
            raise RecursionError
        data = tomllib.loads(content)
        _check_values(data)
    except RecursionError as error:
        raise InputError(f"{path}: nested too deep; expected a few levels") from error
    except ValueError as error:  # also a whole number of thousands of digits
        raise InputError(f"{path}: not valid TOML: {error}") from error
    return data


def read_json(path: Path) -> dict[str, Any]:
    """Read the object of a JSON file. Raises InputError naming the file."""
    return parse_json(read_text(path, MAX_RECORD_BYTES), str(path))


def parse_json(content: str, source: str) -> dict[str, Any]:
    """Parse the object of a JSON text. Raises InputError naming its source."""
    try:
        data = json.loads(content)
        _check_values(data)
    except RecursionError as error:
        raise InputError(f"{source}: nested too deep; expected a few levels") from error
    except ValueError as error:
        raise InputError(f"{source}: not valid JSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{source}: an object is needed, as in {{...}}, not {type(data).__name__}")
    return data


def _check_values(data: object) -> None:
    """Raise ValueError for a whole number beyond 64 bits, RecursionError beyond MAX_LEVELS."""
    waiting = [(data, 0)]
    while waiting:
        value, level = waiting.pop()
        if level > MAX_NESTING_LEVELS:
            raise RecursionError
        if isinstance(value, int) and not -_MAX_INTEGER <= value < _MAX_INTEGER:
            raise ValueError(f"a whole number of {value.bit_length()} bits; expected at most 64")
        if isinstance(value, dict):
            waiting += [(item, level + 1) for item in value.values()]
        elif isinstance(value, list):
            waiting += [(item, level + 1) for item in value]
