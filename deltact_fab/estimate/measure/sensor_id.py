"""What is known of a sensor, which one a calibration belongs to, and the head of its file.

A calibration file is TOML: `schema`, `kind`, [sensor], [made], and then its kind's own tables.
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

SCHEMA = 1
Kind = Literal["depth", "force", "acceptance"]
_WRITERS: dict[str, str] = {
    "depth": "calibrate depth",
    "force": "calibrate force",
    "acceptance": "rig accept",
}
_ANEW = {"depth": " RUN", "force": " RUN --transfer {}", "acceptance": " SOURCE RECIPE"}
"""What is typed for another sensor: one to three presses are enough in RUN."""
SHOWN = 3  # so many differences are told; a lens that was fitted again differs in all its numbers
Description = Mapping[str, Any] | str


@dataclass(frozen=True)
class SensorModel:
    """Model of a sensor: all that a measurement may know of it; None where nobody can tell.

    Any of it may be wrong: an estimate is to be judged with that in mind. Young's modulus is not
    here, because a calibration's factors take its place.

    projection: of the images that are tracked; its `maps` make them from those that the camera
    gives. skin: the gel's outer dimensions. flat: how the light falls off over the tracked images.
    rest: the face untouched, as it is tracked. recipe: of the pattern. design, serial: of the
    sensor. simulated: a word and the seed, where no hardware was involved. nominal: the camera is
    the design's, for none was calibrated. in_px: it stands for none, and its millimetre is a pixel.
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
            raise ValueError(f"poisson: between 0 and 0.5: {self.poisson} fails")

    @property
    def camera(self) -> CameraModel:
        """The projection, where a caller made sure that there is one. Raises ValueError."""
        if self.projection is None:
            raise ValueError("nobody knows the camera of this sensor")
        return self.projection

    @property
    def id(self) -> SensorId:
        return SensorId(self.design, self.serial, self.recipe, self.camera.as_dict())

    def with_gel(self, poisson: float, thickness_mm: float) -> SensorModel:
        """The sensor with another gel behind the same face."""
        return replace(self, poisson=poisson, skin=replace(self.skin, thickness_mm=thickness_mm))


@dataclass(frozen=True)
class SensorId:
    """What identifies a sensor; None where a source of images does not know it.

    pattern, camera: the pattern's recipe and the camera, as they are stored; in files up to version
    0.2 short digests of them.
    """

    design: str | None = None
    serial: str | None = None
    pattern: Description | None = None
    camera: Description | None = None

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012 - read by catalog.validate

    def unlike(self, other: SensorId) -> dict[str, tuple[Any, Any]]:
        """What both know and differ in: this one's value and the other's, by key."""
        differences: dict[str, tuple[Any, Any]] = {}
        for name, mine in vars(self).items():
            yours = getattr(other, name)
            if mine is None or yours is None:
                continue
            if isinstance(mine, str) or isinstance(yours, str):
                mine, yours = _digest(mine), _digest(yours)
            ours, theirs = _flat(name, mine), _flat(name, yours)
            for key in {**ours, **theirs}:
                if ours.get(key) != theirs.get(key):
                    differences[key] = ours.get(key), theirs.get(key)
        return differences


@dataclass(frozen=True)
class CalibrationSource:
    """What a calibration was made from. seed: of a simulated run."""

    runs: tuple[str, ...]
    simulated: bool
    version: str
    seed: Annotated[int, Ge(0)] | None = None

    __pydantic_config__ = {"extra": "forbid"}  # noqa: RUF012


@dataclass(frozen=True)
class CalibrationHead:
    kind: Kind
    sensor: SensorId
    made: CalibrationSource

    @property
    def origin(self) -> str:
        """Of its figures, in words."""
        return f"simulated, seed {self.made.seed}" if self.made.simulated else "measured"

    def toml(self, tables: Mapping[str, Any]) -> str:
        """The text of the file: this head, then the tables."""
        head = {
            "schema": SCHEMA,
            "kind": self.kind,
            "sensor": asdict(self.sensor),
            "made": {**asdict(self.made), "runs": list(self.made.runs)},
        }
        about = (f"Calibration of {self.kind} ({self.origin}); made by deltact-fab.",)
        return toml_text({**head, **tables}, about)


def require_same_sensor(calibration: CalibrationHead, present: SensorId, source: str) -> None:
    """Refuse a calibration (of the file `source`) for another sensor than it was made on.

    Raises InputError, one line that says in what the two differ, and what to do.
    """
    if not (unlike := present.unlike(calibration.sensor)):
        return
    words = _WRITERS[calibration.kind] + _ANEW[calibration.kind].format(source)
    made, remedy = "on another sensor", f"`deltact-fab {words}` makes one for this sensor"
    if all(key.startswith("camera") for key in unlike):
        made = "with another camera file"
        remedy = f"measure with that one; or, if the lens was calibrated again since, {remedy}"
    raise InputError(f"{source}: made {made}: {told(unlike, 'in this file')}; {remedy}")


def told(unlike: Mapping[str, tuple[Any, Any]], there: str) -> str:
    """Differences in words: "serial 'B2' here, 'A1' in this file"; of many the first ones."""
    words = []
    for key, values in list(unlike.items())[:SHOWN]:
        one, other = (f"{v:.6g}" if isinstance(v, float) else repr(v) for v in values)
        if one == other:  # to the digits that are shown
            one, other = map(repr, values)
        words.append(f"{key} {one} here, {other} {there}")
    more = len(unlike) - SHOWN
    return "; ".join([*words, f"{more} more"] if more > 0 else words)


def read_calibration(
    path: Path, kind: Kind | None = None
) -> tuple[CalibrationHead, dict[str, Any]]:
    """Head and own tables of a calibration file, of one kind or of any (None).

    Raises InputError of one line: no such file, no TOML, another schema or kind, a head that is
    not one, a number that is not finite.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    data = read_toml(path)
    schema, found = data.pop("schema", None), data.pop("kind", None)
    if schema is None and found is None:
        raise InputError(f"{path}: not a calibration: no `schema` and `kind`; {_made_by(kind)}")
    if schema != SCHEMA or isinstance(schema, bool):
        raise InputError(f"{path}: schema: {schema!r}, this version reads {SCHEMA}")
    if found not in get_args(Kind):
        raise InputError(f"{path}: kind: {found!r}; valid: {', '.join(get_args(Kind))}")
    if kind is not None and found != kind:
        raise InputError(f"{path}: kind: a calibration of {found}, not of {kind}; {_made_by(kind)}")
    head = {"kind": found, "sensor": data.pop("sensor", {}), "made": data.pop("made", {})}
    if where := _not_finite(data):
        raise InputError(f"{path}: {where}: not a finite number")
    return validate(CalibrationHead, head, str(path)), data


def rest_table(name: str, data: bytes) -> dict[str, str]:
    """The table [rest] of a file beside which the face at rest lies as `name`."""
    return {"file": name, "sha256": hashlib.sha256(data).hexdigest()}


def read_rest(path: Path, table: Mapping[str, Any]) -> bytes | None:
    """The image that [rest] of a calibration file names; None of an empty table.

    Raises InputError for one that cannot be read or is not the one that was written.
    """
    if not table:
        return None
    name = table.get("file")
    if not isinstance(name, str) or Path(name).name != name:
        raise InputError(f"{path}: rest.file: the name of a file beside it (got {name!r})")
    image = path.with_name(name)
    try:
        data = image.read_bytes()
    except OSError as why:
        raise InputError(f"{image}: cannot be read: {why.strerror}; {path} names it") from why
    if hashlib.sha256(data).hexdigest() != table.get("sha256"):
        raise InputError(f"{image}: differs from the hash in {path}: damaged, or of another one")
    return data


def format_acceptance(
    known: SensorModel,
    source: str,
    seed: int,
    rest: tuple[str, bytes],
    rows: Sequence[Sequence[Any]],
) -> str:
    """Format the file of a sensor that was accepted.

    source: of its images. seed: of simulated ones. rest: name of the image of the face at rest,
    which lies beside the file, and its bytes. rows: what was checked.
    """
    simulated = known.simulated is not None
    made = CalibrationSource((source,), simulated, PACKAGE_VERSION, seed if simulated else None)
    head = CalibrationHead("acceptance", SensorId(known.design, known.serial), made)
    return head.toml({"rest": rest_table(*rest), "accepted": {"rows": rows}})


def read_acceptance(path: Path, known: SensorModel) -> bytes | None:
    """Read the image of the face at rest that an acceptance's file names; None without one.

    Raises InputError for a file that is none or another sensor's, and as `read_rest`.
    """
    head, data = read_calibration(path, "acceptance")
    require_same_sensor(head, SensorId(known.design, known.serial), str(path))
    table = data.get("rest")
    return read_rest(path, table) if isinstance(table, dict) else None


def _made_by(kind: Kind | None) -> str:
    which = [_WRITERS[kind]] if kind else list(_WRITERS.values())
    return f"one is made by {' or '.join(f'`{name}`' for name in which)}"


def _not_finite(value: Any) -> str | None:
    """The key of a number that is none, "a.b.0"; None where all are finite."""
    if isinstance(value, float):
        return None if value - value == 0 else ""
    inner = value.items() if isinstance(value, dict) else ()
    for key, part in enumerate(value) if isinstance(value, list) else inner:
        if (below := _not_finite(part)) is not None:
            return f"{key}.{below}".rstrip(".")
    return None


def _flat(name: str, data: Any) -> dict[str, Any]:
    """Numbers and words by their keys, as in "camera.lens.f_px"; what a file leaves out is not."""
    if not isinstance(data, Mapping):
        return {} if data is None else {name: list(data) if isinstance(data, tuple) else data}
    return {k: v for key, value in data.items() for k, v in _flat(f"{name}.{key}", value).items()}


def _digest(data: Description) -> str:
    """As files up to version 0.2 have it, which is kept as it is."""
    if isinstance(data, str):
        return data
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]
