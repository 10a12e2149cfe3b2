"""Lookup of TOML files by name: a path, a local file, else the shipped one.

NAME of a kind is the first of ./KIND/NAME.toml, ./NAME.toml if its keys match the kind, and the
shipped KIND/NAME.toml. KIND is cad, patterns, protocols or protocols/rigs.

Files are validated strictly: an unknown key, a wrong type or a value out of range is one line
naming file and key.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from os.path import isdir, isfile
from pathlib import Path
from typing import Any, TypeVar, cast

from deltact_fab.paths import shipped_folder

from .errors import InputError, did_you_mean
from .files import disk_errors, write_whole
from .reading import read_toml

KIND_KEYS: dict[str, frozenset[str]] = {
    "cad": frozenset(
        {"base", "skin", "frame", "optics", "body", "indenter", "shape", "module", "bought"}
    ),
    "patterns": frozenset({"law"}),
    "protocols": frozenset(
        {"indenters", "positions_mm", "depths_mm", "capture", "press", "presses"}
    ),
    "protocols/rigs": frozenset({"stage"}),
}
"""Top-level keys that identify the kind of a file: one is enough."""
MAX_FAULTS = 20
"""Reported faults per file; by hand: each hint takes a millisecond."""
Model = TypeVar("Model")


def catalogue_names(kind: str) -> list[str]:
    """List the names that `find_file` resolves for a kind."""
    names = {p.stem for folder in (Path(kind), shipped_folder(kind)) for p in folder.glob("*.toml")}
    for path in Path().glob("*.toml"):
        with suppress(InputError):
            if not KIND_KEYS[kind].isdisjoint(read_toml(path)):
                names.add(path.stem)
    return sorted(names)


def find_file(kind: str, name: str) -> Path:
    """Resolve a catalogue name or a path to an existing TOML file.

    Raises InputError naming the nearest catalogue entry if nothing matches.
    """
    if kind not in KIND_KEYS:
        raise ValueError(f"unknown catalogue {kind!r}")
    path = Path(name)
    if path.suffix == ".toml" or path.parent != Path("."):
        if isfile(path):
            return path
        raise InputError(f"{name}: {'is a folder' if isdir(path) else 'no such file'}")
    lab_file, cwd_file, shipped = (
        folder / f"{name}.toml" for folder in (Path(kind), Path(), shipped_folder(kind))
    )
    if isfile(lab_file):
        return lab_file
    # Invalid TOML raises: the shipped file must not hide the user's mistake.
    another = isfile(cwd_file) and KIND_KEYS[kind].isdisjoint(read_toml(cwd_file))
    if isfile(cwd_file) and not another:
        return cwd_file
    if isfile(shipped):
        return shipped
    remark = f"; {cwd_file} has none of {', '.join(sorted(KIND_KEYS[kind]))}" if another else ""
    hint = did_you_mean(name, catalogue_names(kind))
    noun = {"cad": "design"}.get(kind, kind.rpartition("/")[2].removesuffix("s"))
    raise InputError(f"no {noun} {name!r}{remark}; {hint}")


def write_new_file(path: Path, text: str) -> None:
    """Write a new TOML file atomically.

    Raises InputError if it exists, has no folder or does not end in .toml, RunFailed for a disk
    error.
    """
    if path.suffix != ".toml":
        raise InputError(f"{path}: expected a file name ending in .toml")
    with disk_errors(path):
        if path.exists():
            raise InputError(f"{path}: already exists; name a new file")
        if not path.parent.is_dir():
            raise InputError(f"{path.parent}: no such folder")
    write_whole(path, text.encode())


def toml_text(data: Mapping[str, Any], about: Sequence[str] = ()) -> str:
    """Format tables as a TOML file that `read_toml` reads.

    data: numbers, strings, booleans, lists and tables of them; about: comment lines above.
    Keys with None are omitted. Raises ValueError for NaN and infinity.
    """
    lines = [f"# {line}" for line in about] + _table("", data)
    return "\n".join(lines).lstrip("\n") + "\n"


def _table(name: str, values: Mapping[str, Any]) -> list[str]:
    inner = {k: v for k, v in values.items() if isinstance(v, Mapping)}
    lines = [
        f"{k} = {toml_literal(v)}" for k, v in values.items() if k not in inner and v is not None
    ]
    if name and (lines or not inner):
        lines = ["", f"[{name}]", *lines]
    for key, table in inner.items():
        lines += _table(f"{name}.{key}" if name else key, table)
    return lines


def toml_literal(value: Any) -> str:
    """Format a value as a TOML literal on one line. Raises ValueError for NaN and infinity."""
    if isinstance(value, Mapping):
        inner = ", ".join(f"{k} = {toml_literal(v)}" for k, v in value.items() if v is not None)
        return f"{{{inner}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml_literal, value))}]"
    # JSON values are valid TOML, except null and a bare DEL.
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    return text.replace("\x7f", "\\u007f")


def validate(kind: type[Model], data: object, source: str) -> Model:
    """Build a pydantic model or dataclass from plain data, strictly.

    Raises InputError of one line: `source: key: fault (got value)`, without a key for faults of
    several values; further faults follow on the same line, separated by ' | '.
    """
    from pydantic import ValidationError

    from .configuration import adapter

    try:
        # Via JSON: strict on strings and booleans, while a list may still fill a tuple.
        text = json.dumps(data, default=str)
    except RecursionError as error:
        raise InputError(f"{source}: nested too deep; expected a few levels") from error
    try:
        return cast(Model, adapter(cast(Any, kind)).validate_json(text, strict=True))
    except ValidationError as error:
        if error.error_count() > 1000 * MAX_FAULTS:  # a list of them takes memory
            text = f"{error.error_count()} faults; is it the right file?"
            raise InputError(f"{source}: {text}") from error
        faults = error.errors()
        lines = [_fault_text(source, kind, fault) for fault in faults[:MAX_FAULTS]]
        raise InputError(*lines, untold=max(0, len(faults) - MAX_FAULTS)) from error


OUT_OF_LIMITS_TYPES = {
    "greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number"
}  # fmt: skip


def _fault_text(source: str, kind: type, fault: Any) -> str:
    from .configuration import TAG_NAMES, schema_at

    path = tuple(part for part in fault["loc"] if part not in (*TAG_NAMES, "[key]"))
    key = ".".join(str(part) for part in path)
    location = f"{source}: {key}" if key else source
    if fault["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        keys = list(schema_at(kind, path[:-1]).get("properties", ()))
        hint = did_you_mean(str(path[-1]), keys) if keys else "remove it"
        return f"{location}: unknown key; {hint}"
    if fault["type"] in ("missing", "missing_argument"):
        return f"{location}: missing key"
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
    message = message.replace("Input should be", "must be").replace("a valid array", "a list")
    message = message.replace("a valid number", "a number without a unit")
    value = fault.get("input")
    if fault["type"] in OUT_OF_LIMITS_TYPES:
        name = next((part for part in reversed(path) if isinstance(part, str)), "value")
        if limits := _limits(name, schema_at(kind, path)):
            return f"{location}: {value!r}; expected {limits}"
    received = "" if value is None or isinstance(value, dict) else f" (got {value!r})"
    return f"{location}: {message}{received}"


def _limits(name: str, schema: dict[str, Any]) -> str:
    """Format the limits of a number; empty without a lower and an upper one."""
    for low, above in (("minimum", "<="), ("exclusiveMinimum", "<")):
        for high, below in (("maximum", "<="), ("exclusiveMaximum", "<")):
            if low in schema and high in schema:
                return f"{schema[low]:g} {above} {name} {below} {schema[high]:g}"
    return ""
