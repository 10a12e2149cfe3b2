"""Files of a run folder: paths, and schemas of its JSON files.

The JSON may have more keys; the types of those listed here are guaranteed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field
from typing_extensions import TypedDict  # pydantic: needed before Python 3.12

from deltact_fab.common import InputError, Note, parse_json, validate
from deltact_fab.sensor import restore_camera

from ..protocols.plan import Step
from ..protocols.tables import PressRole, SettleTimes
from .folder import has_file, read_file

RUN_FORMAT = 6  # format number of run folders written by this version
UNHASHED_FORMAT = 5  # the format of 0.2.0, in which the metadata have no hashes
IMPORTED_MARK, UNKNOWN_SENSOR = "imported", "unknown"
"""Mark of an imported run, in run.json and pattern.json; kind of its frames, and their indenter
if unknown."""
FLAT_FILE = "camera.flat.png"
"""Flat field of a calibrated camera, if it has one."""
NOTES_FILE = "notes.jsonl"
"""Operators' notes, one JSON object per line."""


def frame_id_of(step: Step, k: int) -> str:
    """Id of the k-th frame of a step; k from 1."""
    return f"{step.id}#{k:03d}"


def image_file(frame_id: str, suffix: str = "png") -> str:
    """Path of a frame's image within the run folder; suffix: png or jxl."""
    return f"images/{frame_id.replace('/', '_').replace('#', '_')}.{suffix}"


def truth_file(name: str, suffix: str = "npz") -> str:
    """Path of the truth of a press, an npz, within the run folder of a virtual rig.

    displacement_mm (n, ny, nx, 3): at each solved knot; per frame in order of capture: frame_id,
    knots (m, 2) around it, fraction (m,) between them. Older runs have no more. Per knot:
    contact_area_mm2 and stick_area_mm2 (n,) seen along z in the deformed state, errors of both,
    centroid_mm (n, 2) of the contact in the sensor frame (without contact: the tip's x, y);
    zone_map (n, ny, nx) uint8, 0 apart, 1 slipping, 2 sticking, at the resting nodes x_mm, y_mm of
    the face. Without friction all contact slips.
    """
    return f"truth/{name.replace('/', '_')}.{suffix}"


LATTICE_FILE, LENS_FILE = truth_file("lattice", "json"), truth_file("lens", "json")
"""Lattice of the true displacements, and the camera of the rendering; the recorded one differs."""
SENSOR_FILE = truth_file("sensor", "json")
"""Number and properties of the sensor drawn from `[virtual.population]`, and its drift."""


def metadata_files(folder: Path, at_the_end: bool) -> list[str]:
    """Existing metadata files of a run, as paths in its folder.

    at_the_end: those written at the end of the run, else those written at its start.
    """
    initial, final = (
        ("run.json", "protocol.toml", "pattern.json", FLAT_FILE, SENSOR_FILE),
        ("summary.json", LATTICE_FILE, LENS_FILE),
    )
    return [name for name in (final if at_the_end else initial) if has_file(folder, name)]


def written_files(folder: Path) -> Iterator[Path]:
    """Yield the images, truths and partial files of a run, which a resume may remove."""
    inside = ("images/*.png", "images/*.jxl", "images/.*.part", "truth/*.npz", "truth/.*.part")
    for pattern in (".*.part", *inside):
        yield from folder.glob(pattern)


def json_bytes(data: dict[str, Any]) -> bytes:
    return (json.dumps(data, indent=1, sort_keys=True) + "\n").encode()


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
    rate_hz: Positive | None
    settle_s: SettleTimes | None
    hold: dict[str, Positive] | None
    retract: dict[str, Positive] | None


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
    monitor: list[dict[str, Any]] | None


_Side = Annotated[int, Field(ge=1, le=20_000)]


class _Imported(TypedDict, total=False):
    image_px: tuple[_Side, _Side]


class _PressRow(TypedDict, total=False):
    name: str
    role: PressRole


class _Until(TypedDict):
    component: str
    goal: Positive
    unit: str


class _RunFile(TypedDict, total=False):
    name: str
    protocol: _Protocol
    presses: list[_PressRow]
    rig_name: str
    rig: _Rig
    sensor: dict[str, Any]
    shapes: dict[str, Any]
    camera: dict[str, Any] | None
    simulated: bool
    air: bool
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    versions: dict[str, str]
    imported: _Imported
    until: _Until
    extends: str


class _PatternFile(TypedDict, total=False):
    recipe: dict[str, Any]
    dots_mm: list[tuple[Number, Number]]
    dot_diameter_mm: Annotated[float, Field(ge=0, le=1000)]


class _SummaryFile(TypedDict, total=False):
    protocol: str
    rig: str
    simulated: bool
    air: bool
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    steps: int
    frames: int
    missed_frames: int
    frame_counts: dict[str, int]
    sessions: int
    kept_frames: int
    skipped: list[str]
    until: dict[str, Any]
    redone: dict[str, str]
    rig_seconds: Number
    wall_seconds: Number
    notes: list[str]
    remarks: list[Note]
    left_out: list[str]
    devices: dict[str, Any]


class StrictDict(dict[str, Any]):
    """Table of a run file: a missing key raises InputError instead of KeyError."""

    source = ""
    missing_text = "missing key"

    def __missing__(self, key: str) -> Any:
        raise InputError(f"{self.source}: {key}: {self.missing_text}")


_UNKNOWN_TEXT = "unknown for an imported run; name camera and design in its recording file"
_FILE_SCHEMAS = {"run.json": _RunFile, "pattern.json": _PatternFile, "summary.json": _SummaryFile}


def load_run_file(folder: Path, name: str) -> dict[str, Any]:
    """Read run.json, pattern.json or summary.json of a run.

    Raises InputError naming file and key, also when a missing key is used.
    """
    path = folder / name
    data = read_record(folder, name)
    stored = data.get("format")
    if name == "run.json" and stored not in (UNHASHED_FORMAT, RUN_FORMAT):
        valid = f"this version reads {UNHASHED_FORMAT} and {RUN_FORMAT}"
        raise InputError(f"{path}: format: {stored}, {valid}")
    validate(_FILE_SCHEMAS[name], data, str(path))
    if data.get("camera"):
        restore_camera(data["camera"], f"{path}: camera")
    missing_text = _UNKNOWN_TEXT if IMPORTED_MARK in data else StrictDict.missing_text
    wrapped: dict[str, Any] = _wrap(data, str(path), missing_text)
    return wrapped


def read_record(folder: Path, name: str) -> dict[str, Any]:
    """Read the object of a run's JSON file. Raises InputError; UnsafeFile as `read_file`."""
    path = folder / name
    try:
        data = read_file(folder, name)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    return parse_json(data, str(path))


def _wrap(value: Any, source: str, missing_text: str) -> Any:
    """Convert every table to a `StrictDict`."""
    if isinstance(value, list):
        return [_wrap(item, source, missing_text) for item in value]
    if not isinstance(value, dict):
        return value
    table = StrictDict({key: _wrap(item, source, missing_text) for key, item in value.items()})
    table.source, table.missing_text = source, missing_text
    return table
