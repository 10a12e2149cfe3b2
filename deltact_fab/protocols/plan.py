"""A protocol: what a lab declares, and the steps it becomes (paper, Pattern Selection, steps 1-6).

The declaration is the value that is stored and hashed; the steps are derived from it and carry ids
that do not change when the run is repeated or resumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from .. import catalog
from ..errors import InputError
from ..shapes import Indenter
from ..shapes.indenter import parse as parse_indenter

Point = tuple[float, float, float]
Kind = Literal["change", "travel", "approach", "press", "shear", "retract"]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Shear(_Strict):
    """Sideways motion at each depth: to one side, through to the other, back to the centre."""

    amplitude_mm: Positive
    axes: tuple[Literal["x", "y"], ...] = ("x", "y")
    points_per_side: int = Field(default=2, ge=1, le=100)
    """Step mode: stops on each side of the centre; sweep mode does not use it."""
    first: Literal["positive", "outward"] = "positive"
    """The side gone to first: + always, or away from the centre of the face (+ where the position
    is on it). Outward, positions that are mirror images of each other have paths that are too."""


class Capture(_Strict):
    """`sweep` films while the indenter moves; `step` stops, settles and reads."""

    mode: Literal["sweep", "step"]
    rate_hz: Positive = 1.0
    """Sweep mode: frames per second of planned motion."""
    settle_s: float = Field(default=1.0, ge=0, le=600, allow_inf_nan=False)
    """Step mode: time between the end of the motion and the reading."""


class Motion(_Strict):
    """Feeds and heights of the stage, in the sensor frame."""

    clearance_mm: Positive = 5.0
    """Height above the resting face from which sideways travel is allowed."""
    approach_gap_mm: Positive = 0.5
    """Height at which the travel feed gives way to the press feed."""
    park_mm: Positive = 20.0
    """Height at which the indenter is changed."""
    travel_feed_mm_min: Positive = 600.0
    press_feed_mm_min: Positive = 30.0
    shear_feed_mm_min: Positive = 30.0

    @model_validator(mode="after")
    def _heights(self) -> Self:
        if not self.approach_gap_mm <= self.clearance_mm <= self.park_mm:
            raise ValueError(
                "approach_gap_mm <= clearance_mm <= park_mm: "
                f"{self.approach_gap_mm} <= {self.clearance_mm} <= {self.park_mm} fails"
            )
        return self


class Specimen(_Strict):
    """The sensor under test: which design and pattern, and what its gel is believed to be."""

    serial: str | None = Field(default=None, min_length=1, max_length=64)
    """The sensor's own number, as it is written on it; a second sensor of a design has another."""
    design: str = "deltact"
    pattern: str = "dense-with-dots"
    gel_model: Literal["layer", "block", "hyperelastic"] = "layer"
    modulus_mpa: Positive = 0.56
    poisson: float = Field(default=0.49, ge=0, le=0.5)
    friction: float = Field(default=0.5, ge=0, le=100)
    prony: tuple[tuple[NotNegative, Positive], ...] = ()
    """Pairs (g, tau_s) of a gel that creeps, as `GelMaterial` has them: modulus_mpa is that of a
    slow press."""
    depth_margin_mm: Positive = 1.0
    """Gel that must remain below the deepest press."""

    @field_validator("serial")
    @classmethod
    def _printable(cls, value: str | None) -> str | None:
        if value is not None and not (value.isprintable() and value == value.strip()):
            raise ValueError("printable characters, with no blank at either end")
        return value


class Protocol(_Strict):
    """One scripted indentation experiment."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    description: str = ""
    indenters: tuple[str, ...] = Field(min_length=1)
    positions_mm: tuple[tuple[Finite, Finite], ...] = Field(min_length=1)
    depths_mm: tuple[Positive, ...] = Field(min_length=1)
    channels: frozenset[Literal["image", "dots", "force", "shear", "traction"]]
    """What the analysis will ask for; what is not named here is not built and not solved. None at
    all leaves the poses of the stage. traction: what presses and shears the face, of every frame,
    which only a virtual rig knows."""
    shear: Shear | None = None
    capture: Capture
    motion: Motion = Motion()
    specimen: Specimen = Specimen()

    @field_validator("indenters")
    @classmethod
    def _known(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        try:
            names = tuple(parse_indenter(name).name for name in value)
        except InputError as why:
            raise ValueError(str(why)) from why
        if len(set(names)) != len(names):
            raise ValueError("each indenter once")
        return names

    @model_validator(mode="after")
    def _channels_and_depths(self) -> Self:
        if "dots" in self.channels and "image" not in self.channels:
            raise ValueError("channels: 'dots' needs 'image'")
        if "traction" in self.channels and "image" not in self.channels:
            raise ValueError("channels: 'traction' needs 'image': it is kept for the frames")
        if self.shear and "shear" not in self.channels:
            raise ValueError("channels: a protocol with [shear] needs 'shear'")
        if list(self.depths_mm) != sorted(set(self.depths_mm)):
            raise ValueError("depths_mm: strictly increasing, the gel has a history")
        return self


@dataclass(frozen=True)
class Step:
    """One straight move and what is captured with it. Points are tip positions, sensor frame."""

    id: str
    press: str
    indenter: str
    kind: Kind
    target_mm: Point
    feed_mm_min: float
    frames: int = 0
    """0: nothing; in a sweep, frames evenly over the move, the last one at its end; else 1."""
    settle_s: float = 0.0


def load(name: str) -> tuple[Protocol, Path]:
    """Read a protocol by catalogue name or path. Raises InputError."""
    path = catalog.find("protocols", name)
    return catalog.validate(Protocol, catalog.read(path), str(path)), path


def expand(protocol: Protocol, air: bool = False) -> list[Step]:
    """All steps in order. Ids read `indenter/position/depth/leg`; a press is indenter/position.

    air: the clearance plane stands for every height below it, so that nothing is touched; steps,
    ids and frames stay what they are.
    """
    steps = list(_steps(protocol))
    if not air:
        return steps
    floor_mm = protocol.motion.clearance_mm
    lifted = ((x, y, max(z, floor_mm)) for x, y, z in (s.target_mm for s in steps))
    return [replace(s, target_mm=p) for s, p in zip(steps, lifted, strict=True)]


def _steps(protocol: Protocol) -> Iterator[Step]:
    motion = protocol.motion
    for name in protocol.indenters:
        indenter = parse_indenter(name)
        yield Step(
            f"{indenter.slug}/change",
            f"{indenter.slug}/change",
            indenter.name,
            "change",
            (0.0, 0.0, motion.park_mm),
            motion.travel_feed_mm_min,
        )
        for number, (x, y) in enumerate(protocol.positions_mm, start=1):
            yield from _press(protocol, indenter, f"{indenter.slug}/p{number}", x, y)


def _press(
    protocol: Protocol, indenter: Indenter, press: str, x: float, y: float
) -> Iterator[Step]:
    motion, capture = protocol.motion, protocol.capture
    settle_s = capture.settle_s if capture.mode == "step" else 0.0

    def move(
        leg: str,
        kind: Kind,
        start: Point,
        target: Point,
        feed_mm_min: float,
        film: bool | None = None,
    ) -> Step:
        """film: True in a sweep, False one frame at the end, None nothing."""
        frames = 0 if film is None else 1
        if film and capture.mode == "sweep":
            seconds = math.dist(start, target) / (feed_mm_min / 60)
            frames = max(1, round(seconds * capture.rate_hz))
        return Step(
            f"{press}/{leg}",
            press,
            indenter.name,
            kind,
            target,
            feed_mm_min,
            frames,
            settle_s if film is not None else 0.0,
        )

    above = (x, y, motion.clearance_mm)
    gap = (x, y, motion.approach_gap_mm)
    yield move("rest", "travel", above, above, motion.travel_feed_mm_min, film=False)
    yield move("approach", "approach", above, gap, motion.travel_feed_mm_min)
    here: Point = gap
    for depth in protocol.depths_mm:
        down = (x, y, -depth)
        yield move(f"d{depth:.2f}/press", "press", here, down, motion.press_feed_mm_min, film=True)
        here = down
        for axis in protocol.shear.axes if protocol.shear else ():
            for leg, target in _legs(protocol, axis, down):
                name = f"d{depth:.2f}/{leg}"
                yield move(name, "shear", here, target, motion.shear_feed_mm_min, film=True)
                here = target
    yield move("retract", "retract", here, (here[0], here[1], motion.clearance_mm),
               motion.press_feed_mm_min)  # fmt: skip
    yield move("after", "travel", above, above, motion.travel_feed_mm_min, film=False)


def _legs(protocol: Protocol, axis: str, centre: Point) -> Iterator[tuple[str, Point]]:
    """Targets of one shear axis: +A, -A, back, or -A first; in step mode with stops on the way."""
    shear = protocol.shear
    assert shear is not None
    backwards = shear.first == "outward" and centre["xy".index(axis)] < 0
    first = -shear.amplitude_mm if backwards else shear.amplitude_mm
    if protocol.capture.mode == "sweep":
        offsets = [first, -first, 0.0]
        names = [f"shear-{axis}{'+' if s > 0 else '-'}" for s in offsets[:2]] + [f"shear-{axis}0"]
    else:
        n = shear.points_per_side
        side = [first * k / n for k in range(1, n + 1)]
        offsets = [*side, *(-s for s in side), 0.0]
        names = [f"shear-{axis}{s:+.2f}" for s in offsets[:-1]] + [f"shear-{axis}0"]
    x, y, z = centre
    for name, offset in zip(names, offsets, strict=True):
        yield name, ((x + offset, y, z) if axis == "x" else (x, y + offset, z))
