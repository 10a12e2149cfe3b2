"""Protocols and their expansion into steps (paper, Pattern Selection, steps 1-6).

The protocol is stored and hashed; the steps are derived from it and have ids that stay the same
when the run is repeated or resumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_serializer, field_validator, model_validator

from deltact_fab.common import (
    InputError,
    OneOrEach,
    Point,
    Point2,
    Table,
    find_file,
    read_toml,
    validate,
)
from deltact_fab.sensor import GEL_LEVELS, GelMaterial, Indenter, find_level, parse_indenter

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
SettleTimes = OneOrEach[SettleTime, StopKind]
"""One value for all stops, or one per kind of stop."""

MAX_PROTOCOL_STEPS = 200_000
"""By hand: the paper's force calibration has 2435; more make planning slow."""


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

    @property
    def legs(self) -> int:
        """Drags at each depth."""
        side = 2 * self.points_per_side + 1
        return side * side if self.grid else side * len(self.axes)

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
    thickness; "hyperelastic" (finite strain) for deep ones, takes minutes."""
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


class Protocol(Table):
    """One scripted indentation experiment."""

    name: str = Field(examples=["mine"], pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    """Name of the experiment; letters, digits, dot, hyphen, underscore."""
    description: str = ""
    """One line for lists and reports."""
    indenters: tuple[str, ...] = Field(min_length=1)
    """Indenters in order of use: sphere:DIAMETER_MM, or 4dots, 2dots, edges, ellipsoid, hexprism,
    star, cylinder, ring, hat, with or without :SIZE_MM; or a shape of cad/indenters.toml."""
    positions_mm: tuple[tuple[PosMm, PosMm], ...] = Field(default=(), examples=[[[0.0, 0.0]]])
    """Positions (x, y) of the presses from the centre of the face. Either this or grid."""
    grid: PlaceGrid | None = Field(default=None, json_schema_extra={"instead_of": "positions_mm"})
    depths_mm: tuple[PlanLength, ...] = ()
    """Depths of the stops of each press below the resting face, increasing."""
    weights: DeadWeights | None = Field(default=None, json_schema_extra={"instead_of": "depths_mm"})
    channels: frozenset[Literal["image", "dots", "force", "shear", "traction"]]
    """Data that the analysis needs; others are not computed. Empty: stage poses only. traction:
    traction on the face at every frame, virtual rigs only."""
    shear: Shear | None = None
    capture: Capture
    motion: MotionPlan = MotionPlan()
    specimen: Specimen = Specimen()

    @field_validator("indenters")
    @classmethod
    def _valid_indenters(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        try:
            names = tuple(parse_indenter(name).name for name in value)
        except InputError as error:
            raise ValueError(str(error)) from error
        if len(set(names)) != len(names):
            raise ValueError("list each indenter once")
        return names

    @model_validator(mode="after")
    def _check_combinations(self) -> Self:
        if bool(self.positions_mm) == bool(self.grid):
            raise ValueError("either positions_mm or grid is needed")
        if self.grid is not None:  # expanded here, so that records list the positions
            object.__setattr__(self, "positions_mm", self.grid.places_mm())
            object.__setattr__(self, "grid", None)
        if "dots" in self.channels and "image" not in self.channels:
            raise ValueError("channels: 'dots' needs 'image'")
        if "traction" in self.channels and "image" not in self.channels:
            raise ValueError("channels: 'traction' needs 'image': it is stored per frame")
        if self.shear and "shear" not in self.channels:
            raise ValueError("channels: a protocol with [shear] needs 'shear'")
        if bool(self.depths_mm) == bool(self.weights):
            raise ValueError("either depths_mm (stage) or [weights] (by hand) is needed")
        capture = self.capture
        filmed = self.shear or capture.rates_hz()
        if self.weights and (filmed or not capture.wait_s("press")):
            raise ValueError(
                "[weights] need capture.settle_s, and none of rate_hz, hold, retract and [shear]; "
                "for shear, tilt the face"
            )
        if list(self.depths_mm) != sorted(set(self.depths_mm)):
            raise ValueError("depths_mm: must be strictly increasing, as the gel has memory")
        legs = 0 if self.shear is None else self.shear.legs
        presses = len(self.indenters) * len(self.positions_mm)
        stops = 1 + legs + (capture.hold is not None)
        if (count := presses * (4 + len(self.depths_mm) * stops)) > MAX_PROTOCOL_STEPS:
            raise ValueError(f"{count} steps; at most {MAX_PROTOCOL_STEPS}: split the protocol")
        return self

    @field_serializer("channels", when_used="json")
    def _sort_channels(self, channels: frozenset[str]) -> list[str]:
        """Sort the channels: a set's order differs between processes and changes cache keys."""
        return sorted(channels)


@dataclass(frozen=True)
class Step:
    """One straight move and its captures. Points are tip positions in the sensor frame."""

    id: str
    press: str
    indenter: str
    kind: StepKind
    target_mm: Point
    feed_mm_min: float
    frames: int = 0
    """Number of frames, evenly over the move and hold_s; the last one after settle_s."""
    settle_s: float = 0.0
    settled: bool = False
    """True if the last frame is taken at rest, see `Capture.settle_s`."""
    hold_s: float = 0.0
    """Time that the tip stays at the end of the move."""


def load_protocol(name: str, by_hand: bool = False) -> tuple[Protocol, Path]:
    """Read a protocol by catalogue name or path. by_hand: accept dead weights.

    Raises InputError.
    """
    path = find_file("protocols", name)
    protocol = validate(Protocol, read_toml(path), str(path))
    if protocol.weights is not None and not by_hand:
        raise InputError(f"{path}: weights: only for a `run` on a real rig, placed by hand")
    return protocol, path


def expand_protocol(
    protocol: Protocol, air: bool = False, descent_feed_mm_min: float = math.inf
) -> list[Step]:
    """Expand a protocol into all steps in order.

    Ids read `indenter/position/depth/leg`; a press is indenter/position.

    air: raise all targets to the clearance plane, so that nothing is touched; steps, ids and
    frames stay the same. descent_feed_mm_min: largest feed downwards until the face was touched,
    which a change of indenter ends with; in air it never is.
    """
    floor_mm = protocol.motion.clearance_mm if air else -math.inf
    steps, height_mm = [], math.inf
    for step in _steps(protocol):
        x, y, z = step.target_mm
        z, feed = max(z, floor_mm), step.feed_mm_min
        if z < height_mm and (air or step.kind == "change"):
            feed = min(feed, descent_feed_mm_min)
        steps.append(replace(step, target_mm=(x, y, z), feed_mm_min=feed))
        height_mm = z
    return steps


def _steps(protocol: Protocol) -> Iterator[Step]:
    motion = protocol.motion
    for name in protocol.indenters:
        indenter = parse_indenter(name)
        id, park_mm = f"{indenter.slug}/change", (0.0, 0.0, motion.park_mm)
        yield Step(id, id, indenter.name, "change", park_mm, motion.travel_feed_mm_min)
        for number, (x, y) in enumerate(protocol.positions_mm, start=1):
            yield from _press(protocol, indenter, f"{indenter.slug}/p{number}", x, y)


def _press(
    protocol: Protocol, indenter: Indenter, press: str, x: float, y: float
) -> Iterator[Step]:
    motion, capture = protocol.motion, protocol.capture
    rates_hz = capture.rates_hz()
    feeds = {"press": motion.press_feed_mm_min, "shear": motion.shear_feed_mm_min,
             "hold": motion.press_feed_mm_min,
             "retract": motion.press_feed_mm_min}  # fmt: skip
    position = above = (x, y, motion.clearance_mm)

    def move(leg: str, kind: StepKind, target: Point, stop: StopKind | None = None) -> Step:
        """Move from the current position, with frames if its kind has a rate or it is a stop."""
        nonlocal position
        feed_mm_min = feeds.get(kind, motion.travel_feed_mm_min)
        hold_s = capture.hold.s if kind == "hold" and capture.hold else 0.0
        seconds = math.dist(position, target) / (feed_mm_min / 60) + hold_s
        frames = 0
        if kind in rates_hz:
            frames = max(1, round(seconds * rates_hz[kind]))
        elif stop:
            frames = 1
        position = target
        wait_s = capture.wait_s(stop) if stop else None
        return Step(
            f"{press}/{leg}", press, indenter.name, kind, target, feed_mm_min, frames,
            wait_s or 0.0, wait_s is not None, hold_s,
        )  # fmt: skip

    # Always settled: nothing touches the gel yet.
    yield replace(move("rest", "travel", above, "rest"), settled=True)
    if protocol.weights is not None:
        for number in range(1, len(protocol.weights.masses_g) + 1):
            yield move(f"m{number}/press", "press", (x, y, 0.0), "press")
        yield replace(move("after", "travel", above, "after"), settled=False)
        return
    yield move("approach", "approach", (x, y, motion.approach_gap_mm))
    for depth in protocol.depths_mm:
        down = (x, y, -depth)
        yield move(f"d{depth:.2f}/press", "press", down, "press")
        if capture.hold is not None:
            yield move(f"d{depth:.2f}/hold", "hold", down)
        for leg, target in _legs(protocol.shear, down):
            stop: StopKind | None = "shear" if target != down else None
            yield move(f"d{depth:.2f}/{leg}", "shear", target, stop)
    # Retraction has frames up to the approach gap, like the press: above it nothing moves.
    top_mm = motion.approach_gap_mm if "retract" in rates_hz else motion.clearance_mm
    yield move("retract", "retract", (*position[:2], top_mm))
    # The face may still be recovering: one frame, never settled.
    position = above
    yield replace(move("after", "travel", above, "after"), settled=False)


def _legs(shear: Shear | None, centre: Point) -> Iterator[tuple[str, Point]]:
    """Yield names and targets of the drags at a depth; returns to the centre are no stops."""
    if shear is None:
        return
    n, (x, y, z) = shear.points_per_side, centre
    amplitude_mm = shear.at_depth_mm(-z)
    outward = shear.first == "outward"
    signs = [-1 if outward and coordinate < 0 else 1 for coordinate in (x, y)]

    def name(axis: int, k: int) -> str:
        side = amplitude_mm * k / n
        text = f"{side:+.2f}" if k and n > 1 else "0+-"[k]
        return f"{'xy'[axis]}{text}"

    for i, j, axes in _square_spiral(n) if shear.grid else _cross_path(n, shear.axes):
        k = (signs[0] * i, signs[1] * j)
        leg = "shear-" + "".join(name(axis, k[axis]) for axis in axes)
        dx, dy = (amplitude_mm * v / n for v in k)
        yield leg, (x + dx, y + dy, z)


def _cross_path(n: int, letters: Sequence[str]) -> Iterator[tuple[int, int, Sequence[int]]]:
    """Yield points of a cross: along each axis outwards, across to the other side, and back."""
    for axis in ("xy".index(letter) for letter in letters):
        for k in (*range(1, n + 1), *range(-1, -n - 1, -1), 0):
            yield (k, 0, (0,)) if axis == 0 else (0, k, (1,))


def _square_spiral(n: int) -> Iterator[tuple[int, int, Sequence[int]]]:
    """Yield points of a square in a spiral around (0, 0), and finally (0, 0)."""
    i = j = 0
    for ring in range(1, n + 1):
        i += 1
        yield i, j, (0, 1)
        # Up this side, then around the other three, to below the start.
        for di, dj, length in ((0, 1, 2 * ring - 1), (-1, 0, 2 * ring), (0, -1, 2 * ring),
                               (1, 0, 2 * ring)):  # fmt: skip
            for _ in range(length):
                i, j = i + di, j + dj
                yield i, j, (0, 1)
    yield 0, 0, (0, 1)
