"""What run.json, pattern.json and summary.json of a run hold, of whatever format.

More may stand in them. Who reads a run may count on the types of these keys.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field
from typing_extensions import TypedDict  # pydantic: needed before Python 3.12

from .. import catalog, reading
from ..errors import InputError
from .files import FORMAT

Number = Annotated[float, Field(ge=-1e9, le=1e9)]
Positive = Annotated[float, Field(gt=0, le=1e9)]


class _Specimen(TypedDict, total=False):
    design: str
    pattern: str
    gel_model: str
    modulus_mpa: Positive
    poisson: Annotated[float, Field(ge=0, le=0.5)]
    serial: str | None


class _Capture(TypedDict, total=False):
    mode: str | None
    rate_hz: Positive | None
    settle_s: Annotated[float, Field(ge=0, le=1e9)] | None


class _Motion(TypedDict, total=False):
    press_feed_mm_min: Positive


class _Protocol(TypedDict, total=False):
    name: str
    description: str
    channels: list[str]
    indenters: list[str]
    capture: _Capture
    motion: _Motion
    specimen: _Specimen


class _StageFields(TypedDict, total=False):
    registration: str | None
    origin_machine_mm: tuple[Number, Number, Number]
    angle_deg: Number
    tilt_deg: tuple[Number, Number] | None


class _Rig(TypedDict, total=False):
    kind: str
    stage: _StageFields
    camera: dict[str, Any] | None
    force: dict[str, Any] | None


class _Sensor(TypedDict, total=False):
    skin: dict[str, Any]


class _RunFile(TypedDict, total=False):
    name: str
    protocol: _Protocol
    rig_name: str
    rig: _Rig
    sensor: _Sensor
    camera: dict[str, Any] | None
    simulated: bool
    air: bool
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    versions: dict[str, str]


class _Recipe(TypedDict, total=False):
    law: str


class _PatternFile(TypedDict, total=False):
    recipe: _Recipe
    dots_mm: list[tuple[Number, Number]]
    dot_diameter_mm: Annotated[float, Field(ge=0, le=1000)]


class _SummaryFile(TypedDict, total=False):
    steps: int
    frames: int
    notes: list[str]
    left_out: list[str]
    devices: dict[str, Any]


class Kept(dict[str, Any]):
    """A table of a kept file: a missing key is bad input, not an error of the reader."""

    source = ""

    def __missing__(self, key: str) -> Any:
        raise InputError(f"{self.source}: {key}: missing key")


def run_file(folder: Path) -> dict[str, Any]:
    """What run.json holds. Raises InputError naming file and key, then and for a missing key."""
    path = folder / "run.json"
    data = reading.json_object(path)
    known = data.get("format")
    if known not in (2, 3, 4, FORMAT) or isinstance(known, bool):
        raise InputError(f"{path}: format: {known}, this version reads 2 to {FORMAT}")
    return _kept(_RunFile, data, path)


def pattern_file(folder: Path) -> dict[str, Any]:
    """What pattern.json holds. Raises as `run_file` does."""
    path = folder / "pattern.json"
    return _kept(_PatternFile, reading.json_object(path), path)


def summary_file(folder: Path) -> dict[str, Any]:
    """What summary.json holds. Raises as `run_file` does."""
    path = folder / "summary.json"
    return _kept(_SummaryFile, reading.json_object(path), path)


def _kept(kind: type, data: dict[str, Any], path: Path) -> dict[str, Any]:
    catalog.validate(kind, data, str(path))
    found: dict[str, Any] = _wrapped(data, str(path))
    return found


def _wrapped(value: Any, source: str) -> Any:
    """The same with every table a `Kept`."""
    if isinstance(value, list):
        return [_wrapped(one, source) for one in value]
    if not isinstance(value, dict):
        return value
    table = Kept({key: _wrapped(one, source) for key, one in value.items()})
    table.source = source
    return table
