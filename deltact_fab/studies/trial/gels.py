"""Presses on the gels of drawn sensors, from a few solved ones.

Modulus is a factor of the forces. In thickness and Poisson's ratio, the linear level's solution is
a quadratic through three gels each. A finite-strain gel is solved once, for the nominal sensor;
what a sensor differs by is added from the linear level.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from deltact_fab.bench import Protocol, VirtualConfig
from deltact_fab.physics import GelLevel, SolvedKnot, poisson_limit
from deltact_fab.sensor import SensorDimensions
from deltact_fab.simulate import SensorDraw

from ..study.stream import PressStream

NODE_DEVIATIONS = 2.0  # by hand: of the outer gels; most sensors lie between them


@dataclass(frozen=True)
class DrawnPress:
    """One press of a protocol, on any sensor of a rig's population.

    press: as `sphere-10/p1`. level: of the gel; "linear" is the planner's own.
    """

    protocol: Protocol
    press: str
    sensor: SensorDimensions
    rig: VirtualConfig
    source: Path
    level: GelLevel

    def draw(self, number: int) -> SensorDraw:
        """Return the sensor of a number."""
        return SensorDraw.from_population(self.rig, number, str(self.source))

    def on_sensor(self, number: int) -> PressStream:
        """Open the press on a sensor. Raises SolverError and InputError where no gel is solved."""
        draw = self.draw(number)
        knots, weights = [self._nominal.knots], [1.0]
        for key, (nodes, streams) in self._linear_gels.items():
            value = getattr(draw.protocol(self.protocol).specimen, key, draw.thickness_mm)
            shares = _lagrange(nodes, value)
            knots += [stream.knots for stream in streams]
            weights += [w - (node == nodes[0]) for node, w in zip(nodes, shares, strict=True)]
        mixed = [_mix(states, weights) for states in zip(*knots, strict=True)]
        return self._stream(self.level, draw, mixed)

    @cached_property
    def _nominal(self) -> PressStream:
        return self._stream(self.level, SensorDraw())

    @cached_property
    def _linear_gels(self) -> dict[str, tuple[list[float], list[PressStream]]]:
        """Values of thickness deviation and Poisson's ratio, the nominal first, with their gels."""
        population = self.rig.virtual.population
        assert population is not None, "required by whoever draws a sensor"
        nominal, limit = self.protocol.specimen.poisson, poisson_limit("linear")
        step, start = NODE_DEVIATIONS * population.poisson, min(nominal, limit)
        thick_mm = NODE_DEVIATIONS * population.thickness_mm
        nodes = {
            "thickness_mm": [0.0, -thick_mm, thick_mm],
            "poisson": [start, start - step, min(start + step, limit)],
        }
        if nodes["poisson"][2] == start:
            nodes["poisson"][2] = start - 2 * step
        gels = {}
        for key, values in nodes.items():
            if len(set(values)) < len(values):
                continue
            draws = [
                replace(SensorDraw(), thickness_mm=v) if key == "thickness_mm"
                else replace(SensorDraw(), poisson=v - nominal)
                for v in values
            ]  # fmt: skip
            gels[key] = values, [self._stream("linear", draw) for draw in draws]
        return gels

    def _stream(
        self, level: GelLevel, draw: SensorDraw, knots: Sequence[SolvedKnot] | None = None
    ) -> PressStream:
        specimen = self.protocol.specimen.model_copy(update={"gel_model": level, "prony": ()})
        protocol, rig = self.protocol.model_copy(update={"specimen": specimen}), self.rig
        if self.level != "linear":  # knots at the same places
            gel = rig.virtual.gel
            finite = gel.hyperelastic
            gel = gel.model_copy(update={
                "press_increment_mm": finite.press_increment_mm,
                "shear_increment_mm": finite.shear_increment_mm,
            })  # fmt: skip
            rig = rig.model_copy(update={"virtual": rig.virtual.model_copy(update={"gel": gel})})
        return PressStream(
            protocol, self.press, self.sensor, rig, self.source, draw=draw, knots=knots
        )  # fmt: skip


def _lagrange(nodes: Sequence[float], value: float) -> Iterator[float]:
    """Yield the weight of each node in the polynomial through all of them."""
    for k, node in enumerate(nodes):
        rest = [root for j, root in enumerate(nodes) if j != k]
        yield float(np.prod([(value - root) / (node - root) for root in rest]))


def _mix(states: Sequence[SolvedKnot], weights: Sequence[float]) -> SolvedKnot:
    """Add the fields and wrenches of one knot on several gels."""
    fields = [f for state in states if (f := state.displacement_mm) is not None]
    fx, fy, fz, tx, ty, tz = np.tensordot(weights, [s.wrench for s in states], axes=1).tolist()
    mixed = np.zeros_like(fields[0])
    for weight, field_mm in zip(weights, fields, strict=True):
        mixed += np.float32(weight) * field_mm
    return replace(states[0], force_n=(fx, fy, fz), torque_nmm=(tx, ty, tz), displacement_mm=mixed)
