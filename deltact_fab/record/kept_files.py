"""What run.json, pattern.json and summary.json of a run hold at least, of whatever format.

More may stand in them. Who reads a run may count on these keys and their types.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from .. import catalog, reading
from ..errors import InputError
from .files import FORMAT

Number = Annotated[float, Field(ge=-1e9, le=1e9)]
Positive = Annotated[float, Field(gt=0, le=1e9)]


class _Kept(BaseModel):
    model_config = ConfigDict(extra="allow")


class _Specimen(_Kept):
    design: str
    pattern: str
    gel_model: str
    modulus_mpa: Positive
    poisson: float = Field(ge=0, le=0.5)
    serial: str | None = None


class _Capture(_Kept):
    mode: str | None = None  # up to format 3
    rate_hz: Positive | None = None
    settle_s: Annotated[float, Field(ge=0, le=1e9)] | None = None


class _Motion(_Kept):
    press_feed_mm_min: Positive


class _Protocol(_Kept):
    name: str
    description: str = ""
    channels: list[str]
    indenters: list[str]
    capture: _Capture
    motion: _Motion
    specimen: _Specimen


class _Stage(_Kept):
    registration: str | None = None
    origin_machine_mm: tuple[Number, Number, Number]
    angle_deg: Number
    tilt_deg: tuple[Number, Number] | None = None


class _Rig(_Kept):
    kind: str
    stage: _Stage
    camera: dict[str, Any] | None = None
    force: dict[str, Any] | None = None


class _Sensor(_Kept):
    skin: dict[str, Any]


class _RunFile(_Kept):
    name: str
    protocol: _Protocol
    rig_name: str
    rig: _Rig
    sensor: _Sensor
    camera: dict[str, Any] | None
    simulated: bool
    air: bool = False
    seed: int = Field(ge=0, lt=2**63)
    versions: dict[str, str]


class _Recipe(_Kept):
    law: str


class _PatternFile(_Kept):
    recipe: _Recipe
    dots_mm: list[tuple[Number, Number]] = []  # noqa: RUF012 - pydantic copies it
    dot_diameter_mm: float = Field(ge=0, le=1000)


class _SummaryFile(_Kept):
    steps: int | None = None
    frames: int | None = None
    notes: list[str] = []  # noqa: RUF012
    left_out: list[str] = []  # noqa: RUF012
    devices: dict[str, Any] = {}  # noqa: RUF012


def run_file(folder: Path) -> dict[str, Any]:
    """What run.json holds. Raises InputError naming file and key."""
    path = folder / "run.json"
    data = reading.json_object(path)
    known = data.get("format")
    if known not in (2, 3, 4, FORMAT) or isinstance(known, bool):
        raise InputError(f"{path}: format: {known}, this version reads 2 to {FORMAT}")
    catalog.validate(_RunFile, data, str(path))
    return data


def pattern_file(folder: Path) -> dict[str, Any]:
    """What pattern.json holds. Raises InputError naming file and key."""
    path = folder / "pattern.json"
    data = reading.json_object(path)
    catalog.validate(_PatternFile, data, str(path))
    return data


def summary_file(folder: Path) -> dict[str, Any]:
    """What summary.json holds. Raises InputError naming file and key."""
    path = folder / "summary.json"
    data = reading.json_object(path)
    catalog.validate(_SummaryFile, data, str(path))
    return data
