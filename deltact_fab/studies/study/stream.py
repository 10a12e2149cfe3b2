"""Frames of one press as a stream: rendered, used and dropped without a record.

Geometry and truth of a frame are computed once for all patterns; a pattern adds its print once and
the camera model per frame. The images equal those recorded by the virtual rig except for the tip
position on a real controller's ramps (a few micrometres); moments taken from a record reproduce its
images exactly.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import Protocol, Step, VirtualConfig, expand_protocol
from deltact_fab.common import Field, SolverError
from deltact_fab.estimate import PatternDots, TrueFrame
from deltact_fab.fabricate import PatternRecipe
from deltact_fab.physics import CONTACT_EPS_MM, Increments, SolvedKnot
from deltact_fab.sensor import FlatField, Pinhole, Rectified, SeenFace, SensorDimensions
from deltact_fab.simulate import (
    FrameRenderer,
    Presses,
    PressPath,
    SensorDraw,
    VirtualKind,
    crop_lattice,
    picture_geometry,
)


@dataclass(frozen=True)
class FrameMoment:
    """Moment of a frame: `fraction` from knot a to knot b of the press; knot 0 is rest.

    tip_mm: tip position, sensor frame. step: id of the protocol's step.
    """

    step: str
    a: int
    b: int
    fraction: float
    tip_mm: tuple[float, float, float] = (math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class FaceFrame:
    """Face at one moment, independent of the pattern.

    at_px: (h + 2, w + 2, 2), face point of each pixel, for `FrameRenderer.expose`. displacement_mm:
    (ny, nx, 3) on the lattice, None at rest. true: None for the first frame, the reference, and if
    not asked for.
    """

    number: int
    moment: FrameMoment
    at_px: NDArray[np.float32]
    displacement_mm: Field | None
    true: TrueFrame | None


class PressStream:
    """Frames of one press of a protocol on a virtual rig, its gel solved or from the store."""

    def __init__(
        self,
        protocol: Protocol,
        press: str,
        sensor: SensorDimensions,
        config: VirtualConfig,
        source: Path = Path("rig.toml"),
        draw: SensorDraw | None = None,
        knots: Sequence[SolvedKnot] | None = None,
    ) -> None:
        """press: as `sphere-10/p1`. source: of the rig file, for the paths in it. draw: of the
        sensor, None: the nominal one. knots: of the press, for 1 MPa, instead of solving it.

        Raises SolverError and InputError where the gel cannot be solved.
        """
        self.protocol, self.config, self.sensor, self.press = protocol, config, sensor, press
        draw = draw or SensorDraw()
        presses = Presses(draw.protocol(protocol), draw.skin(sensor.skin), config.virtual.gel)
        self.path = presses.path(press)
        self.increments = presses.increments
        self.solver = presses.planned_press(self.path).solver
        if knots is None:
            self.solver.solve_all()
        self.knots = self.solver.knots if knots is None else knots
        self._draw, self._modulus_mpa = draw, presses.modulus_mpa
        kind = VirtualKind(config, source, draw.number)
        view, self._flat = kind.camera(protocol, sensor), kind.flat(protocol)
        assert view is not None, "the protocol has images"
        self.view: Pinhole | Rectified = view
        self._crop = crop_lattice(config, sensor, self.solver.axes_mm, draw)
        lattice = self._crop.lattice
        self.geometry, lens = picture_geometry(config, sensor, view, lattice, draw)
        self.face = SeenFace(view, lattice, lens)
        self._knot: list[tuple[int, NDArray[Any]]] = [(-1, np.zeros(0))] * 2

    @cached_property
    def moments(self) -> list[FrameMoment]:
        """Moments of the protocol's frames."""
        return frame_moments(self.protocol, self.path, self.increments)

    def frames(
        self, chosen: Iterable[FrameMoment] | None = None, *, has_truth: bool = True
    ) -> Iterator[FaceFrame]:
        """Iterate over moments of the face. chosen: None for the protocol's.

        has_truth: False saves the time of computing the true motion. Raises SolverError if a pixel
        sees no point of the surface.
        """
        in_view = TrueFrame.imaged_pixels(self.view)
        zeros = np.zeros((*in_view.shape, 2))
        for number, moment in enumerate(self.moments if chosen is None else chosen):
            u_mm, true = self.displacement_mm(moment), None
            if number and has_truth:
                flow, in_plane = (zeros, zeros) if u_mm is None else self.face.motion(u_mm)
                true = TrueFrame.from_flow(flow, in_plane, in_view, self.view.mm_per_px)
            yield FaceFrame(number, moment, self.geometry.material_px(u_mm), u_mm, true)

    def displacement_mm(self, moment: FrameMoment) -> Field | None:
        """Displacement (ny, nx, 3) of the face at a moment; None at rest."""
        if not (moment.a or moment.b):
            return None
        # Linear between knots of float32, as in the rig's scene.
        first, second = (self._field(knot).astype(float) for knot in (moment.a, moment.b))
        return np.asarray(first + moment.fraction * (second - first))

    def wrench(self, moment: FrameMoment) -> Field:
        """True wrench (6,) on the sensor at a moment, N and N mm."""
        first, second = (
            np.array(self.knots[knot - 1].wrench) if knot else np.zeros(6)
            for knot in (moment.a, moment.b)
        )
        return np.asarray(self._modulus_mpa * (first + moment.fraction * (second - first)))

    def picture(self, recipe: PatternRecipe, seed: int) -> FrameRenderer:
        """Renderer of the gel with a printed pattern, as in a run of the rig with that seed."""
        return FrameRenderer.printed(
            self.geometry, self.config.virtual, recipe, seed, self._draw
        )  # fmt: skip

    def noise(self, seed: int) -> np.random.Generator:
        """Noise generator for `FrameRenderer.expose`; one per pattern, from the first frame on."""
        return FrameRenderer.noise(seed, self.press)

    def tracker_image(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Image for the tracker: rectified if the rig has a lens."""
        if not isinstance(self.view, Rectified):
            return image
        rectified = np.asarray(self.view.rectify(image), np.uint8)
        return rectified if self._light is None else self._light.apply(rectified)

    def marks(self, recipe: PatternRecipe) -> PatternDots:
        """Dots of the pattern in this camera's view."""
        return PatternDots.from_record(self.view, recipe.as_record())

    @cached_property
    def _light(self) -> FlatField | None:
        return None if self._flat is None else self._flat.for_view(self.view)

    def _field(self, knot: int) -> NDArray[Any]:
        """Displacement (ny, nx, 3), mm, of a knot on the cropped lattice; caches the last two."""
        for number, field in self._knot:
            if number == knot:
                return field
        if knot == 0:
            lattice = self._crop.lattice
            field = np.zeros((lattice.ny, lattice.nx, 3), np.float32)
        else:
            full_field = self.knots[knot - 1].displacement_mm
            if full_field is None:
                raise SolverError(f"{self.press}: knot {knot} has no displacement of the face")
            field = self._crop(full_field)
        self._knot = [self._knot[1], (knot, field)]
        return field


def frame_moments(protocol: Protocol, path: PressPath, increments: Increments) -> list[FrameMoment]:
    """Moments of a press's frames: evenly over each filmed line, the last at its end.

    Not for a gel that creeps, whose rests have their own knots.
    """
    moments: list[FrameMoment] = []
    position_mm, knot = (*path.at_mm, protocol.motion.clearance_mm), 0
    for step in expand_protocol(protocol):
        if step.press != path.press:
            continue
        start, position_mm = position_mm, step.target_mm
        if step.kind == "hold":
            moments += [FrameMoment(step.id, knot, knot, 0.0, position_mm)] * step.frames
            continue
        if position_mm[2] > -CONTACT_EPS_MM and not (step.kind == "retract" and step.frames):
            knot = 0
            moments += [FrameMoment(step.id, 0, 0, 0.0, position_mm)] * step.frames
            continue
        splits, tips_mm = increments.divide(start, position_mm)
        numbers = [knot]
        for tip in tips_mm[1:]:
            knot = knot + 1 if tip[2] < 0 else 0
            numbers.append(knot)
        moments += [_moment_at(step, start, splits, numbers, k) for k in range(1, step.frames + 1)]
    return moments


def _moment_at(
    step: Step, start: tuple[float, ...], splits: list[float], numbers: list[int], k: int
) -> FrameMoment:
    """Moment of the k-th frame of a line with knots `numbers` at its fractions `splits`."""
    progress = k / step.frames
    i = 0
    while i + 2 < len(splits) and splits[i + 1] <= progress:
        i += 1
    part = min(max((progress - splits[i]) / (splits[i + 1] - splits[i]), 0.0), 1.0)
    x, y, z = (p + progress * (q - p) for p, q in zip(start, step.target_mm, strict=True))
    return FrameMoment(step.id, numbers[i], numbers[i + 1], part, (x, y, z))
