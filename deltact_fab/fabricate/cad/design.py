"""Files that a lab edits under cad/: designs, the lists of indenters and of cameras."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from deltact_fab.common import InputError, did_you_mean, find_file, read_toml, validate
from deltact_fab.sensor import Bounded, Indenter, OwnShape, bounded_number, parse_indenter

from .dimensions import Design
from .sensor_sections import CameraDimensions


@dataclass(frozen=True)
class IndenterBody(Bounded):
    """Body of an indenter behind its tips and shanks: one back plate."""

    plate_mm: float = bounded_number(4.0, "back plate", 1.0, 50.0)


@dataclass(frozen=True)
class ListedIndenter:
    """One indenter of the list."""

    name: str
    """As in a protocol: sphere:DIAMETER_MM; 4dots, 2dots, edges, ellipsoid, hexprism, star,
    cylinder, ring or hat, with or without :SIZE_MM; or the name of a shape of this file."""
    quantity: int = 1
    """How many of it are made; at least 1."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012

    def __post_init__(self) -> None:
        if self.quantity < 1:
            raise ValueError(f"quantity must be 1 or more (got {self.quantity})")


@dataclass(frozen=True)
class IndenterList:
    """cad/indenters.toml."""

    body: IndenterBody = field(default_factory=IndenterBody)
    indenter: tuple[ListedIndenter, ...] = ()
    """One `[[indenter]]` table each."""
    shape: dict[str, OwnShape] = field(default_factory=dict)
    """One `[shape.NAME]` table each: indenters of the lab's own, by the names of protocols."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012


@dataclass(frozen=True)
class IndenterDimensions:
    """All inputs of an indenter's solid."""

    indenter: Indenter
    body: IndenterBody


def load_design(name: str = "deltact", changes: Iterable[str] = ()) -> Design:
    """Load a design of the `cad` catalogue (a name or a path to a TOML file).

    changes: `section.key=value`, as after `--set`; they override the file. A design with a `base`
    inherits every key that it does not set. Raises InputError naming file and key; inequalities
    between dimensions are checked by feasibility.check_feasible.
    """
    path = find_file("cad", name)
    data = _with_base(path, ())
    for change in changes:
        _change(data, change)
    return validate(Design, data, str(path))


def reference_designs(name: str, design: Design) -> tuple[Design, ...]:
    """Return the designs that a design was changed from, nearest first.

    These are its file without further changes, the file's bases, and the defaults; only the
    defaults if no file has that name.
    """
    bases = []
    base: str | None = name
    with suppress(InputError):
        while base is not None:
            bases.append(load_design(base))
            base = read_toml(find_file("cad", base)).get("base")
    return tuple(dict.fromkeys(b for b in (*bases, Design()) if b != design)) or (Design(),)


def _with_base(path: Path, ancestors: tuple[Path, ...]) -> dict[str, Any]:
    """Return the file's tables merged over those of its base."""
    if path.resolve() in ancestors:
        raise InputError(f"{path}: base: a design cannot be its own base")
    tables = read_toml(path)
    base = tables.pop("base", None)
    if base is None:
        return tables
    if not isinstance(base, str):
        raise InputError(f"{path}: base: expected the name of a design (got {base!r})")
    data = _with_base(find_file("cad", base), (*ancestors, path.resolve()))
    for section, table in tables.items():
        inherited = data.get(section)
        if isinstance(table, dict) and isinstance(inherited, dict):
            data[section] = {**inherited, **table}
        else:
            data[section] = table
    return data


def _change(data: dict[str, Any], change: str) -> None:
    """Set one key; the value is parsed as TOML, a bare word is a string."""
    key, equals, text = change.partition("=")
    section, dot, name = key.strip().partition(".")
    if not (equals and dot and section and name and text.strip()):
        raise InputError(f"--set {change!r}: expected section.key=value, as in skin.width_mm=44")
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table = data.setdefault(section, {})
    if not isinstance(table, dict):
        raise InputError(f"--set {change!r}: {section} is not a table")
    table[name] = value


def load_indenters(name: str = "indenters") -> IndenterList:
    """Load the lab's indenters and their body. Raises InputError naming file and key."""
    path = find_file("cad", name)
    indenters = validate(IndenterList, read_toml(path), str(path))
    names: set[str] = set()
    for entry in indenters.indenter:
        try:
            name = parse_indenter(entry.name).name
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        if name in names:
            raise InputError(f"{path}: indenter {name!r}: listed twice; expected once")
        names.add(name)
    return indenters


@dataclass(frozen=True)
class CameraList:
    """cad/cameras.toml."""

    module: dict[str, CameraDimensions] = field(default_factory=dict)
    """One `[module.NAME]` table each."""

    __pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # noqa: RUF012


def load_cameras() -> dict[str, CameraDimensions]:
    """Load the cameras by name. Raises InputError naming file and key."""
    path = find_file("cad", "cameras")
    return validate(CameraList, read_toml(path), str(path)).module


def load_camera(name: str) -> CameraDimensions:
    """Load one camera. Raises InputError with the nearest name, and as `load_cameras`."""
    cameras = load_cameras()
    if name not in cameras:
        raise InputError(f"--camera {name!r}: no such camera; {did_you_mean(name, cameras)}")
    return cameras[name]
