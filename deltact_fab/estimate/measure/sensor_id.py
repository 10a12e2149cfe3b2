"""Model and identity of a sensor, and the head of its calibration files.

A calibration file is TOML: `schema`, `kind`, [sensor], [made], and then the tables of its kind.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from annotated_types import Ge

from deltact_fab.common import Array, InputError, read_toml, toml_text, validate
from deltact_fab.sensor import CameraModel, FlatField, SkinDimensions
from deltact_fab.version import PACKAGE_VERSION

CALIBRATION_SCHEMA = 1  # format version of the files
CalibrationKind = Literal["depth", "force", "acceptance"]
_WRITER_COMMANDS: dict[str, str] = {
    "depth": "calibrate depth",
    "force": "calibrate force",
    "acceptance": "rig accept",
}
_WRITER_ARGUMENTS = {"depth": " RUN", "force": " RUN --transfer {}", "acceptance": " SOURCE RECIPE"}
"""Arguments for another sensor; one to three presses suffice in RUN."""
MAX_DIFFERENCES = 3  # named in a message; by hand: a refitted lens differs in all its numbers
Description = Mapping[str, Any] | str


@dataclass(frozen=True)
class SensorModel:
    """Model of a sensor: prior knowledge of a measurement; None where unknown.

    Any value may be wrong, which limits an estimate. Young's modulus is absent, as the factors of
    a calibration replace it.

    projection: camera of the tracked images; its `maps` rectify raw ones. skin: outer dimensions
    of the gel. flat: shading of the tracked images. rest: tracked image of the untouched face.
    recipe: of the pattern. design, serial: of the sensor. simulated: a word and the seed if no
    hardware is involved. nominal: the camera is the design's, not calibrated. in_px: no camera is
    known, and lengths are in pixels.
    """

    projection: CameraModel | None = None
    skin: SkinDimensions = field(default_factory=SkinDimensions)
    poisson: float = 0.49
    flat: FlatField | None = field(default=None, compare=False)
    rest: Array | None = field(default=None, compare=False)
    recipe: Mapping[str, Any] | None = field(default=None, compare=False)
    design: str | None = None
    serial: str | None = None
    simulated: str | None = None
    nominal: bool = False
    in_px: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.poisson < 0.5:
            raise ValueError(f"poisson must be between 0 and 0.5 (got {self.poisson})")

    @property
    def camera(self) -> CameraModel:
        """The projection. Raises ValueError if there is none."""
        if self.projection is None:
            raise ValueError("the camera of this sensor is unknown")
        return self.projection

    @property
    def id(self) -> SensorId:
        return SensorId(self.design, self.serial, self.recipe, self.camera.as_dict())

    def with_gel(self, poisson: float, thickness_mm: float) -> SensorModel:
        """Return a copy with another gel behind the same face."""
        return replace(self, poisson=poisson, skin=replace(self.skin, thickness_mm=thickness_mm))


@dataclass(frozen=True)
class SensorId:
    """Identity of a sensor; None for what the source of images does not state.

    pattern, camera: recipe of the pattern and camera, as stored; in files up to version 0.2 short
    digests of them.
    """

    design: str | None = None
    serial: str | None = None
    pattern: Description | None = None
    camera: Description | None = None

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def differences_from(self, reference: SensorId) -> dict[str, tuple[Any, Any]]:
        """Return differing values by key, own and reference; keys that one lacks are skipped."""
        differences: dict[str, tuple[Any, Any]] = {}
        for name, own_value in vars(self).items():
            reference_value = getattr(reference, name)
            if own_value is None or reference_value is None:
                continue
            if isinstance(own_value, str) or isinstance(reference_value, str):
                own_value, reference_value = _digest(own_value), _digest(reference_value)
            first, second = (_flatten(name, own_value), _flatten(name, reference_value))
            for key in {**first, **second}:
                if first.get(key) != second.get(key):
                    differences[key] = first.get(key), second.get(key)
        return differences


@dataclass(frozen=True)
class CalibrationSource:
    """Source of a calibration. seed: of a simulated run."""

    runs: tuple[str, ...]
    simulated: bool
    version: str
    seed: Annotated[int, Ge(0)] | None = None

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012


@dataclass(frozen=True)
class CalibrationHead:
    kind: CalibrationKind
    sensor: SensorId
    made: CalibrationSource

    @property
    def origin(self) -> str:
        """Origin of the figures: measured, or simulated with its seed."""
        return f"simulated, seed {self.made.seed}" if self.made.simulated else "measured"

    def toml(self, tables: Mapping[str, Any]) -> str:
        """Format the file: this head, then the tables."""
        head = {
            "schema": CALIBRATION_SCHEMA,
            "kind": self.kind,
            "sensor": asdict(self.sensor),
            "made": {**asdict(self.made), "runs": list(self.made.runs)},
        }
        about = (f"Calibration of {self.kind} ({self.origin}); made by deltact-fab.",)
        return toml_text({**head, **tables}, about)


def require_same_sensor(calibration: CalibrationHead, present: SensorId, source: str) -> None:
    """Refuse a calibration (of the file `source`) that was made on another sensor.

    Raises InputError, one line with the differences and the remedy.
    """
    if not (differences := present.differences_from(calibration.sensor)):
        return
    words = _WRITER_COMMANDS[calibration.kind] + _WRITER_ARGUMENTS[calibration.kind].format(source)
    mismatch, remedy = "on another sensor", f"`deltact-fab {words}` makes one for this sensor"
    if all(key.startswith("camera") for key in differences):
        mismatch = "with another camera file"
        remedy = f"measure with that one; or, if the lens was calibrated again since, {remedy}"
    text = format_differences(differences, "in this file")
    raise InputError(f"{source}: made {mismatch}: {text}; {remedy}")


def format_differences(differences: Mapping[str, tuple[Any, Any]], reference_place: str) -> str:
    """Format differences, at most MAX_DIFFERENCES: "serial 'B2' here, 'A1' in this file"."""
    words = []
    for key, values in list(differences.items())[:MAX_DIFFERENCES]:
        value, reference_value = (f"{v:.6g}" if isinstance(v, float) else repr(v) for v in values)
        if value == reference_value:  # in the digits shown
            value, reference_value = map(repr, values)
        words.append(f"{key} {value} here, {reference_value} {reference_place}")
    n_hidden = len(differences) - MAX_DIFFERENCES
    return "; ".join([*words, f"{n_hidden} more"] if n_hidden > 0 else words)


def read_calibration(
    path: Path, kind: CalibrationKind | None = None
) -> tuple[CalibrationHead, dict[str, Any]]:
    """Read head and other tables of a calibration file, of one kind or of any (None).

    Raises InputError of one line: no such file, no TOML, another schema or kind, an invalid head,
    a number that is not finite.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    data = read_toml(path)
    schema, stated = data.pop("schema", None), data.pop("kind", None)
    if schema is None and stated is None:
        raise InputError(f"{path}: not a calibration: no `schema` and `kind`; {_hint(kind)}")
    if schema != CALIBRATION_SCHEMA or isinstance(schema, bool):
        raise InputError(f"{path}: schema: {schema!r}, this version reads {CALIBRATION_SCHEMA}")
    if stated not in get_args(CalibrationKind):
        raise InputError(f"{path}: kind: {stated!r}; valid: {', '.join(get_args(CalibrationKind))}")
    if kind is not None and stated != kind:
        raise InputError(f"{path}: kind: a calibration of {stated}, not of {kind}; {_hint(kind)}")
    head = {"kind": stated, "sensor": data.pop("sensor", {}), "made": data.pop("made", {})}
    if bad_key := _not_finite(data):
        raise InputError(f"{path}: {bad_key}: not a finite number")
    return validate(CalibrationHead, head, str(path)), data


def rest_table(name: str, data: bytes) -> dict[str, str]:
    """Make the table [rest] that names the image of the face at rest, beside the file."""
    return {"file": name, "sha256": hashlib.sha256(data).hexdigest()}


def read_rest(path: Path, table: Mapping[str, Any]) -> bytes | None:
    """Read the image that [rest] of a calibration file names; None for an empty table.

    Raises InputError if it cannot be read or does not match the hash.
    """
    if not table:
        return None
    name = table.get("file")
    if not isinstance(name, str) or Path(name).name != name:
        raise InputError(f"{path}: rest.file: expected a file in its folder (got {name!r})")
    image = path.with_name(name)
    try:
        data = image.read_bytes()
    except OSError as error:
        raise InputError(f"{image}: cannot be read: {error.strerror}; {path} names it") from error
    if hashlib.sha256(data).hexdigest() != table.get("sha256"):
        raise InputError(f"{image}: differs from the hash in {path}: damaged, or from another file")
    return data


def format_acceptance(
    model: SensorModel,
    source: str,
    seed: int,
    rest: tuple[str, bytes],
    rows: Sequence[Sequence[Any]],
) -> str:
    """Format the file of an accepted sensor.

    source: of its images. seed: of simulated ones. rest: name of the image of the face at rest,
    beside the file, and its bytes. rows: the checks.
    """
    simulated = model.simulated is not None
    provenance = CalibrationSource(
        (source,), simulated, PACKAGE_VERSION, seed if simulated else None
    )
    head = CalibrationHead("acceptance", SensorId(model.design, model.serial), provenance)
    return head.toml({"rest": rest_table(*rest), "accepted": {"rows": rows}})


def read_acceptance(path: Path, model: SensorModel) -> bytes | None:
    """Read the image of the face at rest that an acceptance file names; None without one.

    Raises InputError for an invalid file or another sensor's, and as `read_rest`.
    """
    head, data = read_calibration(path, "acceptance")
    require_same_sensor(head, SensorId(model.design, model.serial), str(path))
    table = data.get("rest")
    return read_rest(path, table) if isinstance(table, dict) else None


def _hint(kind: CalibrationKind | None) -> str:
    commands = [_WRITER_COMMANDS[kind]] if kind else list(_WRITER_COMMANDS.values())
    return f"make one with {' or '.join(f'`{name}`' for name in commands)}"


def _not_finite(value: Any) -> str | None:
    """Return the key of a non-finite number, "a.b.0"; None if all are finite."""
    if isinstance(value, float):
        return None if value - value == 0 else ""
    inner = value.items() if isinstance(value, dict) else ()
    for key, part in enumerate(value) if isinstance(value, list) else inner:
        if (below := _not_finite(part)) is not None:
            return f"{key}.{below}".rstrip(".")
    return None


def _flatten(name: str, data: Any) -> dict[str, Any]:
    """Flatten nested tables to dotted keys, as in "camera.lens.f_px", without None."""
    if not isinstance(data, Mapping):
        return {} if data is None else {name: list(data) if isinstance(data, tuple) else data}
    return {k: v for key, x in data.items() for k, v in _flatten(f"{name}.{key}", x).items()}


def _digest(data: Description) -> str:
    """Return the digest that files up to version 0.2 hold; strings unchanged."""
    if isinstance(data, str):
        return data
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]
