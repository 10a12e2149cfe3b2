"""Tables of a protocol: shear, capture, grid, heights and feeds, specimen, weights, presses."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from deltact_fab.common import InputError, OneOrEach, Point2, Table, read_text, validate
from deltact_fab.sensor import GEL_LEVELS, GelMaterial, find_level, parse_indenter

from .motion import PosMm

StepKind = Literal["change", "travel", "approach", "press", "hold", "shear", "retract"]
StopKind = Literal["rest", "press", "shear", "after"]
PlanLength = Annotated[float, Field(ge=0.001, le=1000)]  # mm
PlanFeed = Annotated[float, Field(ge=0.001, le=100_000)]  # mm/min
FrameRate = Annotated[float, Field(ge=0.0001, le=1000)]  # frames per second
DepthShare = Annotated[float, Field(ge=0.001, le=100)]
WeightMass = Annotated[float, Field(ge=0.1, le=100_000)]  # g
GridCount = Annotated[int, Field(ge=1, le=1000)]
FaceTilt = Annotated[float, Field(ge=-40, le=40)]  # both at once still press on the face
Seconds = Annotated[float, Field(ge=0.001, le=1e6)]
SettleTime = Annotated[float, Field(ge=0, le=600)]
PromisedError = Annotated[float, Field(ge=0, le=1e6)]
PressRole = Literal["fit", "validate", "reference"]
PressCount = Annotated[int, Field(ge=1, le=10_000)]
SettleTimes = OneOrEach[SettleTime, StopKind]
"""One value for all stops, or one per kind of stop."""


def canonical_indenter(name: str) -> str:
    """Return an indenter's canonical name. Raises ValueError for an unknown one."""
    try:
        return parse_indenter(name).name
    except InputError as error:
        raise ValueError(str(error)) from error


IndenterName = Annotated[str, AfterValidator(canonical_indenter)]


class Shear(Table):
    """Sideways motion at each depth: to one side, through to the other, back to the centre."""

    amplitude_mm: PlanLength | None = Field(default=None, examples=[3.0])
    """Drag to each side of the press. Either this or amplitude_of_depth."""
    amplitude_of_depth: DepthShare | None = Field(
        default=None, examples=[0.7], json_schema_extra={"instead_of": "amplitude_mm"}
    )
    """Instead of amplitude_mm: as a share of the depth. A ball of any size slips fully once dragged
    by about 1.5 x friction x depth (Mindlin); before that it sticks."""
    axes: tuple[Literal["x", "y"], ...] = ("x", "y")
    """Axes of the face along which the tip is dragged, one after the other."""
    points_per_side: int = Field(default=1, ge=1, le=100)
    """Stops on each side of the centre."""
    grid: bool = False
    """Stops on the full square of (2 points_per_side + 1)^2 points, in a spiral outwards from the
    centre, instead of one axis after the other."""
    first: Literal["positive", "outward"] = "positive"
    """First side of a drag: always +, or away from the centre of the face (+ on the centre line).
    With "outward", mirrored positions have mirrored paths."""

    @model_validator(mode="after")
    def _check_amplitude(self) -> Self:
        if (self.amplitude_mm is None) == (self.amplitude_of_depth is None):
            raise ValueError("either amplitude_mm or amplitude_of_depth is needed")
        if self.grid and set(self.axes) != {"x", "y"}:
            raise ValueError(f"axes: a grid needs both x and y, not {list(self.axes)}")
        return self

    def at_depth_mm(self, depth_mm: float) -> float:
        """Amplitude for a press of this depth."""
        return self.amplitude_mm or (self.amplitude_of_depth or 0.0) * depth_mm


class Hold(Table):
    """Hold after each press, before any drag, to record creep of the gel."""

    s: Annotated[float, Field(ge=0.1, le=86_400)] = Field(examples=[60.0])
    """Duration of the hold in seconds."""
    rate_hz: FrameRate = Field(examples=[1.0])
    """Frames per second during the hold, the last one at its end; none counts as settled."""


class Retract(Table):
    """Retraction with frames and force samples, to record unloading."""

    rate_hz: FrameRate = Field(examples=[2.0])
    """Frames per second of planned motion, evenly, from the last stop up to approach_gap_mm."""


class Capture(Table):
    """Frames during motion and settled frames at stops; at least one of both."""

    rate_hz: FrameRate | None = Field(default=None, examples=[1.0])
    """Frames per second during each press and drag; omit for none."""
    settle_s: SettleTimes | None = Field(default=None, examples=[1.0])
    """Wait before a stop's frame, which then counts as settled. Without it stops do not wait, and
    only the frame before a press is settled. By kind of stop, as {press = 5.0, shear = 1.0}: before
    the press (rest), at a depth (press), at the end of a drag (shear), after the press (after,
    never settled); omitted kinds do not wait."""
    hold: Hold | None = None
    retract: Retract | None = None

    @model_validator(mode="after")
    def _check_not_empty(self) -> Self:
        if self.rate_hz is None and self.settle_s is None:
            raise ValueError(
                "rate_hz (frames during motion) or settle_s (a settled frame per stop) is needed"
            )
        return self

    def wait_s(self, stop: StopKind) -> float | None:
        """Settling time of a kind of stop in s; None: no wait."""
        return self.settle_s.get(stop) if isinstance(self.settle_s, dict) else self.settle_s

    def rates_hz(self) -> dict[StepKind, float]:
        """Frame rates of the kinds of steps that have frames."""
        rates: dict[StepKind, float | None] = {
            "press": self.rate_hz,
            "shear": self.rate_hz,
            "hold": self.hold.rate_hz if self.hold else None,
            "retract": self.retract.rate_hz if self.retract else None,
        }
        return {kind: rate_hz for kind, rate_hz in rates.items() if rate_hz is not None}


class PlaceGrid(Table):
    """Positions on a grid, instead of a list: row by row from the lowest x and y."""

    x: tuple[PosMm, PosMm] = Field(examples=[[-6.0, 6.0]])
    """Lowest and highest x, mm from the centre of the face."""
    y: tuple[PosMm, PosMm] = Field(examples=[[-5.0, 5.0]])
    """Lowest and highest y."""
    n: tuple[GridCount, GridCount] = Field(examples=[[3, 3]])
    """Number of positions along x and y, evenly from lowest to highest; 1: in the middle."""

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        for name, (low, high), n in (("x", self.x, self.n[0]), ("y", self.y, self.n[1])):
            if low > high or (low == high and n > 1):
                raise ValueError(f"{name}: [{low:g}, {high:g}] for {n}; expected [lowest, highest]")
        return self

    def places_mm(self) -> tuple[Point2, ...]:
        """Positions (x, y), rounded to a nanometre."""
        xs, ys = (
            [round(low + (high - low) * (k / (n - 1) if n > 1 else 0.5), 6) for k in range(n)]
            for (low, high), n in ((self.x, self.n[0]), (self.y, self.n[1]))
        )
        return tuple((x, y) for y in ys for x in xs)


class MotionPlan(Table):
    """Feeds and heights of the stage, in the sensor frame."""

    clearance_mm: PlanLength = 5.0
    """Height above the resting face from which sideways travel is allowed."""
    approach_gap_mm: PlanLength = 0.5
    """Height at which the travel feed gives way to the press feed."""
    park_mm: PlanLength = 20.0
    """Height at which the indenter is changed."""
    travel_feed_mm_min: PlanFeed = 600.0
    """Feed of the moves above the face."""
    press_feed_mm_min: PlanFeed = 30.0
    """Feed from approach_gap_mm down into the gel, and back out of it."""
    shear_feed_mm_min: PlanFeed = 30.0
    """Feed of the drags in contact."""

    @model_validator(mode="after")
    def _check_heights(self) -> Self:
        if not self.approach_gap_mm <= self.clearance_mm <= self.park_mm:
            raise ValueError(
                "approach_gap_mm <= clearance_mm <= park_mm: "
                f"{self.approach_gap_mm} <= {self.clearance_mm} <= {self.park_mm} fails"
            )
        return self


def _gel_field(key: str) -> Any:
    """A field with the default, limits and meaning of `GelMaterial`'s."""
    field = GelMaterial.__dataclass_fields__[key]
    return Field(default=field.default, **field.metadata)


class Specimen(Table):
    """Sensor under test: design, pattern and assumed gel properties."""

    serial: str | None = Field(default=None, min_length=1, max_length=64, examples=["A-07"])
    """Serial number of the sensor; each sensor of a design has its own."""
    design: str = "deltact"
    """Name or path of the sensor's design."""
    pattern: str = "dense-with-dots"
    """Name or path of its pattern recipe."""
    gel_model: Annotated[str, Field(json_schema_extra={"enum": list(GEL_LEVELS)})] = "linear"
    """Model for predicted forces and the virtual gel: "linear" for presses up to a tenth of the
    thickness; "hyperelastic" (finite strain) for deep ones, takes minutes; "tabulated" (finite
    strain of a few places, moved to others) for many presses without drags."""
    modulus_mpa: float = _gel_field("modulus_mpa")
    poisson: float = _gel_field("poisson")
    friction: float = _gel_field("friction")
    prony: tuple[tuple[Annotated[float, Field(ge=0, le=100)], Seconds], ...] = ()
    """Pairs (g, tau_s) of a viscoelastic gel, as in GelMaterial; modulus_mpa is then the long-term
    modulus."""
    depth_margin_mm: PlanLength = 1.0
    """Gel that must remain below the deepest press."""

    @field_validator("gel_model")
    @classmethod
    def _check_level(cls, value: str) -> str:
        return find_level(value)

    @field_validator("serial")
    @classmethod
    def _check_serial(cls, value: str | None) -> str | None:
        if value is not None and not (value.isprintable() and value == value.strip()):
            raise ValueError("must be printable, without blanks at the ends")
        return value


class DeadWeights(Table):
    """Known masses laid on the face by hand, instead of a stage and a force sensor."""

    masses_g: tuple[WeightMass, ...] = Field(min_length=1, max_length=100, examples=[[50.0, 100.0]])
    """Masses, each including the indenter and its holder, in order of loading."""
    error_g: Annotated[float, Field(ge=0, le=1000)] = 0.1
    """Error of a mass, from its class or the balance."""
    tilt_deg: tuple[FaceTilt, FaceTilt] = (0.0, 0.0)
    """Tilt of the face along x and y, positive if that direction leads down. A tilted face is
    sheared; a level one gives no shear data."""
    tilt_error_deg: Annotated[float, Field(ge=0, le=10)] = 0.2
    """Error of the tilt."""
    height_mm: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    """Height of the centre of mass above the face; 0 or less if the mass hangs from a yoke. On a
    tilted face it causes a moment."""
    gravity_m_s2: float = Field(default=9.80665, ge=9.7, le=9.9)
    """Local gravity; 9.780 at the equator to 9.832 at the poles."""

    def wrench(self, mass_g: float, at_mm: Point2) -> tuple[float, ...]:
        """Force (N) on the sensor and moment (N mm) about the centre of the resting face."""
        fx, fy = (self._weight_n(mass_g) * math.sin(math.radians(t)) for t in self.tilt_deg)
        fz = -math.sqrt(self._weight_n(mass_g) ** 2 - fx**2 - fy**2)
        (x, y), z = at_mm, self.height_mm
        return fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx

    def error_n(self) -> tuple[float, float]:
        """Errors of normal force and shear force in N at the largest mass."""
        weight_n, tilt = self._weight_n(max(self.masses_g)), math.radians(self.tilt_error_deg)
        steepest = max(abs(math.sin(math.radians(t))) for t in self.tilt_deg)
        mass_n = self._weight_n(self.error_g)
        return mass_n + weight_n * tilt * (steepest + tilt), mass_n * steepest + weight_n * tilt

    def _weight_n(self, mass_g: float) -> float:
        return mass_g / 1000 * self.gravity_m_s2


class PressEntry(Table):
    """One press of a list, with repeats."""

    indenter: IndenterName = Field(examples=["sphere:10"])
    """Its indenter, as in indenters; entries in a row with the same one share a mounting."""
    x_mm: PosMm = 0.0
    """Position from the centre of the face, along x."""
    y_mm: PosMm = 0.0
    """Position along y."""
    depth_mm: PlanLength = Field(examples=[1.0])
    """Depth below the resting face."""
    shear_x_mm: PosMm = 0.0
    """Drag at this depth along x, in one line with that along y; 0 and 0 for none."""
    shear_y_mm: PosMm = 0.0
    """Drag along y."""
    repeats: PressCount | None = Field(default=None, examples=[2])
    """Number of times that it is made; by default that of the protocol."""
    role: PressRole = "fit"
    """Use of its data: "fit" for calibrations, "validate" only to judge them, "reference" to show
    drift. A random order leaves those for reference in their places."""


class ReferencePress(Table):
    """The same press again and again, with the mounted indenter, to show drift.

    At the beginning and at the end of each mounting, and in between."""

    every: PressCount = Field(examples=[8])
    """Number of other presses between two of them."""
    at_mm: tuple[PosMm, PosMm] = (0.0, 0.0)
    """Position (x, y) from the centre of the face."""
    depth_mm: PlanLength = Field(examples=[1.0])
    """Depth below the resting face."""


class Promise(Table):
    """Prediction of a plan, written by `protocol plan`: what a run of it is compared with."""

    measure: str = Field(examples=["normal force"], max_length=100)
    """Quantity that is predicted."""
    unit: str = Field(examples=["N"], max_length=16)
    """Unit of the figures."""
    goal: PromisedError = Field(examples=[0.1])
    """Largest figure that is wanted; of a comparison the difference to find."""
    error: PromisedError = Field(examples=[0.07])
    """Predicted figure: rms error of the presses to validate, half width of a mean's interval, or
    difference that is found with chance 0.8."""
    interval: tuple[PromisedError, PromisedError] = Field(examples=[[0.05, 0.11]])
    """Interval of the predicted figure, 95 %."""
    chance: Annotated[float, Field(ge=0, le=1)] = Field(examples=[0.86])
    """Predicted chance to meet the goal."""
    sensors: Annotated[int, Field(ge=0, le=1000)] = 0
    """Sensors on each side of a comparison; 0 without sides."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Seed of the plan."""
    rests_on: tuple[str, ...] = ()
    """Figures that the prediction rests on, and their sources."""
    digest: str = Field(default="", pattern=r"^([0-9a-f]{12})?$")
    """Digest of the planned protocol; another one after a change."""


def read_presses(file: Path) -> list[dict[str, Any]]:
    """Read a CSV file of presses, one per row; its columns are the keys of `PressEntry`.

    An empty cell is a key that is not set. Raises InputError naming file, row and column.
    """
    rows: list[dict[str, Any]] = []
    table = csv.DictReader(read_text(file).splitlines(), skipinitialspace=True, restkey="")
    for row in table:
        source = f"{file}: row {table.line_num}"
        if row.pop("", None):
            raise InputError(f"{source}: more cells than the header has columns")
        cells = {key.strip(): (cell or "").strip() for key, cell in row.items()}
        values = {key: _cell_value(key, cell, source) for key, cell in cells.items() if cell}
        rows.append(validate(PressEntry, values, source).model_dump(exclude_unset=True))
    if not rows:
        raise InputError(f"{file}: no presses; expected a header with indenter, depth_mm and rows")
    return rows


def _cell_value(key: str, cell: str, source: str) -> str | float | int:
    if key in ("indenter", "role") or key not in PressEntry.model_fields:
        return cell  # an unknown key is refused with the row
    try:
        return int(cell) if key == "repeats" else float(cell)
    except ValueError as error:
        raise InputError(f"{source}: {key}: {cell!r} is not a number") from error
