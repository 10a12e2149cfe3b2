"""Protocols and their expansion into steps (paper, Pattern Selection, steps 1-6).

The protocol is stored and hashed; the steps are derived from it and have ids that stay the same
when the run is repeated or resumed.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    field_serializer,
    field_validator,
    model_serializer,
    model_validator,
)

from deltact_fab.common import InputError, Point, Point2, Table, find_file, read_toml, validate
from deltact_fab.sensor import parse_indenter

from .motion import PosMm
from .presses import Press, add_references, repeat_presses, shuffle_presses
from .tables import (
    Capture,
    DeadWeights,
    MotionPlan,
    PlaceGrid,
    PlanLength,
    PressCount,
    PressEntry,
    Promise,
    ReferencePress,
    Shear,
    Specimen,
    StepKind,
    StopKind,
    canonical_indenter,
    read_presses,
)

MAX_PROTOCOL_STEPS = 200_000
"""By hand: the paper's force calibration has 2435; more make planning slow."""


# Newer than 0.3.0.
_NEW_KEYS = ("presses", "press", "order", "order_seed", "repeats", "reference", "promise")


class Protocol(Table):
    """One scripted indentation experiment."""

    name: str = Field(examples=["mine"], pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    """Name of the experiment; letters, digits, dot, hyphen, underscore."""
    description: str = ""
    """One line for lists and reports."""
    indenters: tuple[str, ...] = Field(default=(), examples=[["sphere:10"]])
    """Indenters in order of use: sphere:DIAMETER_MM, or 4dots, 2dots, edges, ellipsoid, hexprism,
    star, cylinder, ring, hat, with or without :SIZE_MM; or a shape of cad/indenters.toml. One that
    is listed again is mounted again, and its presses are spread over its mountings. Each presses
    all positions; needed unless [[press]] lists the presses."""
    positions_mm: tuple[tuple[PosMm, PosMm], ...] = Field(default=(), examples=[[[0.0, 0.0]]])
    """Positions (x, y) of the presses from the centre of the face. Either this or grid."""
    grid: PlaceGrid | None = Field(default=None, json_schema_extra={"instead_of": "positions_mm"})
    depths_mm: tuple[PlanLength, ...] = ()
    """Depths of the stops of each press below the resting face, increasing."""
    weights: DeadWeights | None = Field(default=None, json_schema_extra={"instead_of": "depths_mm"})
    press: tuple[PressEntry, ...] = Field(default=(), json_schema_extra={"instead_of": "indenters"})
    """Presses one by one, instead of indenters, positions_mm and depths_mm."""
    presses: str | None = Field(
        default=None, max_length=4096, examples=["presses.csv"],
        json_schema_extra={"instead_of": "press"},
    )  # fmt: skip
    """CSV file of the presses, relative to this file: its columns are the keys of [[press]]."""
    repeats: PressCount = 1
    """Number of times that each press is made."""
    order: Literal["file", "random"] = "file"
    """Order of the presses of each mounting: as in this file, or random."""
    order_seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Seed of the random order."""
    reference: ReferencePress | None = None
    channels: frozenset[Literal["image", "dots", "force", "shear", "traction"]]
    """Data that the analysis needs; others are not computed. Empty: stage poses only. traction:
    traction on the face at every frame, virtual rigs only."""
    shear: Shear | None = None
    capture: Capture
    motion: MotionPlan = MotionPlan()
    specimen: Specimen = Specimen()
    promise: Promise | None = None

    @field_validator("indenters")
    @classmethod
    def _valid_indenters(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(canonical_indenter(name) for name in value)

    @model_validator(mode="after")
    def _check_combinations(self) -> Self:
        self._check_form()
        if self.grid is not None:  # expanded here, so that records list the positions
            object.__setattr__(self, "positions_mm", self.grid.places_mm())
            object.__setattr__(self, "grid", None)
        if "dots" in self.channels and "image" not in self.channels:
            raise ValueError("channels: 'dots' needs 'image'")
        if "traction" in self.channels and "image" not in self.channels:
            raise ValueError("channels: 'traction' needs 'image': it is stored per frame")
        presses = self.list_presses()
        if any(press.shear for press in presses) and "shear" not in self.channels:
            key = "a protocol with [shear]" if self.shear else "a press with shear_x_mm, shear_y_mm"
            raise ValueError(f"channels: {key} needs 'shear'")
        if len({press.name for press in presses}) < len(presses):
            raise ValueError("indenters: a shape by two names")
        capture = self.capture
        filmed = self.shear or capture.rates_hz()
        if self.weights and (filmed or not capture.wait_s("press")):
            raise ValueError(
                "[weights] need capture.settle_s, and none of rate_hz, hold, retract and [shear]; "
                "for shear, tilt the face"
            )
        if list(self.depths_mm) != sorted(set(self.depths_mm)):
            raise ValueError("depths_mm: must be strictly increasing, as the gel has memory")
        holds = capture.hold is not None
        stops = (1 + holds + len(legs) for press in presses for legs in press.legs.values())
        if (count := 4 * len(presses) + sum(stops)) > MAX_PROTOCOL_STEPS:
            raise ValueError(f"{count} steps; at most {MAX_PROTOCOL_STEPS}: split the protocol")
        return self

    def _check_form(self) -> None:
        """Raise ValueError unless the presses are given in exactly one form."""
        if self.presses is not None:
            raise ValueError("presses: a file is read only with the protocol's own file")
        if self.press:
            for key in ("indenters", "positions_mm", "grid", "depths_mm", "weights", "shear"):
                if getattr(self, key):
                    raise ValueError(f"{key}: not with [[press]], whose entries give it")
            return
        if not self.indenters:
            raise ValueError("indenters: missing key; or list the presses as [[press]]")
        if bool(self.positions_mm) == bool(self.grid):
            raise ValueError("either positions_mm or grid is needed")
        if bool(self.depths_mm) == bool(self.weights):
            raise ValueError("either depths_mm (stage) or [weights] (by hand) is needed")
        if self.weights and (self.order == "random" or self.repeats > 1 or self.reference):
            raise ValueError("[weights]: laid on in the order of the file, once, no [reference]")

    @model_serializer(mode="wrap")
    def _omit_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Omit keys newer than 0.3.0 at their defaults: its records and caches stay valid."""
        fields = type(self).model_fields
        unused = {key for key in _NEW_KEYS if getattr(self, key) == fields[key].default}
        return {key: value for key, value in handler(self).items() if key not in unused}

    @field_serializer("channels", when_used="json")
    def _sort_channels(self, channels: frozenset[str]) -> list[str]:
        """Sort the channels: a set's order differs between processes and changes cache keys."""
        return sorted(channels)

    def list_presses(self) -> tuple[Press, ...]:
        """All presses in the order in which they are made.

        Only this reads how a file states them: by indenters and positions, or one by one.
        """
        references: Counter[str] = Counter()
        presses: list[Press] = []
        for mounting, mounted in enumerate(self._mountings()):
            if self.order == "random":
                mounted = shuffle_presses(mounted, self.order_seed)
            if self.reference is not None:
                mounted = list(add_references(mounted, self.reference, references))
            presses += [replace(press, mounting=mounting) for press in mounted]
        return tuple(presses)

    def _mountings(self) -> Iterator[list[Press]]:
        """The presses of each mounting of an indenter, in the order of the file."""
        if self.press:
            entries = []
            for n, entry in enumerate(self.press, start=1):
                tip, drag = entry.indenter, (entry.shear_x_mm, entry.shear_y_mm)
                name, place = f"{parse_indenter(tip).slug}/p{n}", (entry.x_mm, entry.y_mm)
                shear = drag if any(drag) else None
                press = Press(name, n, tip, place, (entry.depth_mm,), shear, entry.role)
                entries.append((press, entry.repeats or self.repeats))
            for _, group in itertools.groupby(entries, key=lambda item: item[0].indenter):
                yield repeat_presses(list(group))
            return
        for k, tip in enumerate(self.indenters):
            slug = parse_indenter(tip).slug
            presses = repeat_presses([
                (Press(f"{slug}/p{n}", n, tip, place, self.depths_mm, self.shear), self.repeats)
                for n, place in enumerate(self.positions_mm, start=1)
            ])  # fmt: skip
            turns, turn = self.indenters.count(tip), self.indenters[:k].count(tip)
            first, last = (len(presses) * (turn + i) // turns for i in (0, 1))
            yield presses[first:last]

    @property
    def tips(self) -> tuple[str, ...]:
        """Indenters, each once, in order of use."""
        return tuple(dict.fromkeys(press.indenter for press in self.list_presses()))

    @property
    def places_mm(self) -> tuple[Point2, ...]:
        """Positions, each once, in order of use."""
        return tuple(dict.fromkeys(press.at_mm for press in self.list_presses()))

    @property
    def stops_mm(self) -> tuple[float, ...]:
        """Depths of all stops, each once, increasing."""
        return tuple(sorted({depth for press in self.list_presses() for depth in press.depths_mm}))

    @property
    def digest(self) -> str:
        """Digest of everything but the promise, name and description: of what is carried out."""
        plan = self.model_dump(mode="json", exclude={"promise", "name", "description"})
        return hashlib.sha256(json.dumps(plan, sort_keys=True).encode()).hexdigest()[:12]

    def narrowed(
        self,
        tips: Sequence[str] | None = None,
        places_mm: Sequence[Point2] | None = None,
        stops_mm: Sequence[float] | None = None,
    ) -> Protocol:
        """A protocol with only these indenters, positions and depths of it.

        A list of presses is numbered anew. Raises InputError if nothing is left.
        """

        def select(values: Iterable[Any], choice: Sequence[Any] | None) -> list[Any]:
            return [v for v in values if choice is None or v in choice]

        chosen = {
            "indenters": select(self.indenters, tips),
            "positions_mm": select(self.positions_mm, places_mm),
            "depths_mm": select(self.depths_mm, stops_mm),
            "press": [
                entry.model_dump() for entry in self.press
                if select([entry.indenter], tips) and select([(entry.x_mm, entry.y_mm)], places_mm)
                and select([entry.depth_mm], stops_mm)
            ],
        }  # fmt: skip
        return validate(Protocol, self.model_dump(mode="json") | chosen, self.name)


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
    protocol = validate(Protocol, read_declaration(path), str(path))
    if protocol.weights is not None and not by_hand:
        raise InputError(f"{path}: weights: only for a `run` on a real rig, placed by hand")
    return protocol, path


def read_declaration(path: Path) -> dict[str, Any]:
    """Read the keys of a protocol's file, its presses from their own file. Raises InputError."""
    data = read_toml(path)
    file = data.get("presses")
    if isinstance(file, str):
        if "press" in data:
            raise InputError(f"{path}: presses: not with [[press]]: give one of them")
        del data["presses"]
        try:
            data["press"] = read_presses(path.parent / file)
        except InputError as error:
            raise InputError(f"{path}: presses: {error}") from error
    return data


def expand_protocol(
    protocol: Protocol, air: bool = False, descent_feed_mm_min: float = math.inf
) -> list[Step]:
    """Expand a protocol into all steps in order.

    Ids read `press/depth/leg`; a press is named as in `Press`.

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
    motion, mountings = protocol.motion, Counter[str]()
    for _, group in itertools.groupby(protocol.list_presses(), key=lambda press: press.mounting):
        presses = list(group)
        indenter, park_mm = parse_indenter(presses[0].indenter), (0.0, 0.0, motion.park_mm)
        mountings[indenter.name] += 1
        times = mountings[indenter.name]
        id = f"{indenter.slug}/change{times if times > 1 else ''}"
        yield Step(id, id, indenter.name, "change", park_mm, motion.travel_feed_mm_min)
        for press in presses:
            yield from _press_steps(protocol, press)


def _press_steps(protocol: Protocol, press: Press) -> Iterator[Step]:
    (x, y), name = press.at_mm, press.name
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
            f"{name}/{leg}", name, press.indenter, kind, target, feed_mm_min, frames,
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
    for depth, legs in press.legs.items():
        down = (x, y, -depth)
        yield move(f"d{depth:.2f}/press", "press", down, "press")
        if capture.hold is not None:
            yield move(f"d{depth:.2f}/hold", "hold", down)
        for leg, (dx, dy) in legs:
            stop: StopKind | None = "shear" if (dx, dy) != (0, 0) else None
            yield move(f"d{depth:.2f}/{leg}", "shear", (x + dx, y + dy, -depth), stop)
    # Retraction has frames up to the approach gap, like the press: above it nothing moves.
    top_mm = motion.approach_gap_mm if "retract" in rates_hz else motion.clearance_mm
    yield move("retract", "retract", (*position[:2], top_mm))
    # The face may still be recovering: one frame, never settled.
    position = above = (*position[:2], motion.clearance_mm)
    yield replace(move("after", "travel", above, "after"), settled=False)
