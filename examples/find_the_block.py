"""Where the face is sideways: a block around the sensor, touched from beside by a ball.

    python find_the_block.py RIG HALF_X_MM HALF_Y_MM TOP_MM [sphere:10]

HALF: half its sides along the sensor's x and y. TOP: height of its top above the resting face,
negative. Run it after `rig register`; what it prints stands for `origin_machine_mm` and `angle_deg`
in that registration. The rig homes, and asks for the ball first.

A force says nothing about where on an even face it acts, so place and turn come from something with
edges: the tactile base's own frame, or a block that is put over it. Opposite sides are touched in
the same way, so that the ball's size, the threshold and the way to a stop are not part of the
middle between them. The turn comes from two touches of one side.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import deltact_fab as dt

STRIDE_MM = 0.2
STEP_MM = 0.01
LOWERING = 4.0  # times the feed of the approach, away from the block
MOST = 5.0  # times the threshold: no deeper into a step
BELOW_MM = 1.0  # the ball's widest place under the block's top
BACK_MM = 0.1
OFF_MM = 0.5  # of the declared size, at most
MAX_TURN_DEG = 5.0

Vector = tuple[float, float, float]
At = Callable[[float, float], Vector]
Side = tuple[float, float]  # a unit vector out of the block


@dataclass(frozen=True)
class BlockPlace:
    """By how much the block lies off the frame, in its own axes (mm, degrees), and its size."""

    x_mm: float
    y_mm: float
    turn_deg: float
    half_mm: tuple[float, float]

    def frame(self, before):
        """The stage's frame moved and turned so that the block is in its middle."""
        origin = before.to_machine_mm((self.x_mm, self.y_mm, 0.0))
        turned = before.angle_deg + self.turn_deg
        return replace(before, origin_machine_mm=origin, angle_deg=turned)


class BlockTouch:
    """Touches the sides of a block with a ball, in the stage's frame, whose z = 0 is the face.

    probe, touch: what `dt.open_probe` yields. ball: as `dt.parse_indenter` reads it.
    """

    def __init__(self, probe, touch, half_mm: tuple[float, float], top_mm: float, ball) -> None:
        self._feeler, self._stage = probe, probe.stage
        self._config = touch
        self._half_mm = half_mm
        self._radius_mm = ball.footprint_half_mm[0]
        self._low_mm = top_mm - BELOW_MM - self._radius_mm

    def find(self) -> BlockPlace:
        """Touch all sides, one of them twice. Raises SensorError or RunFailed; the tip is up then,
        unless the stage is at fault."""
        half_x, half_y = self._half_mm
        high_mm = max(self._stage.position_mm()[2], self._config.clear_mm)
        try:
            left = self._touch((-1, 0), 0.0, high_mm)
            right = self._touch((1, 0), 0.0, high_mm)
            near = (
                self._touch((0, -1), -half_x / 2, high_mm),
                self._touch((0, -1), half_x / 2, high_mm),
            )
            far = self._touch((0, 1), 0.0, high_mm)
        finally:
            self._feeler.release()
        turn = math.atan2(near[1] - near[0], half_x)
        middle = (right + left) / 2, (far + (near[0] + near[1]) / 2) / 2
        found = (right - left) / 2, (far - (near[0] + near[1]) / 2) / 2
        size = tuple(f * math.cos(turn) - self._radius_mm for f in found)
        for axis, got, said in zip("xy", size, (half_x, half_y), strict=True):
            if abs(got - said) > OFF_MM:
                raise dt.RunFailed(
                    f"the block is {2 * got:.2f} mm wide along {axis}, {2 * said:g} were given: "
                    "another block, or another ball"
                )
        if abs(math.degrees(turn)) > MAX_TURN_DEG:
            raise dt.RunFailed(
                f"the block is turned by {math.degrees(turn):.1f} degrees, more than "
                f"{MAX_TURN_DEG:g}: put it straight"
            )
        return BlockPlace(*middle, math.degrees(turn), (size[0], size[1]))

    def _touch(self, side: Side, along_mm: float, high_mm: float) -> float:
        """One side at a place along it; where the ball's middle met it, on that side's axis.

        The ball leaves outwards, and up only there.
        """
        config = self._config
        axis = 0 if side[0] else 1
        sign = side[axis]
        expected = self._half_mm[axis] + self._radius_mm
        far, near = expected + config.search_mm, expected - config.search_mm

        def at(out_mm: float, z_mm: float) -> Vector:
            out = sign * out_mm
            return (out, along_mm, z_mm) if axis == 0 else (along_mm, out, z_mm)

        x, y, _ = self._stage.position_mm()
        for target in ((x, y, high_mm), at(far, high_mm)):
            self._go(target, config.feed_mm_min * LOWERING)
        self._feeler.tare()
        try:
            if self._feeler.move(
                at(far, self._low_mm), config.feed_mm_min * LOWERING, config.force_n
            ):
                raise dt.SensorError(f"something is in the way beside the block, at {_side(side)}")
            self._approach(side, far, near, at)
            out = sign * self._stage.position_mm()[axis]
            out += BACK_MM
            self._go(at(out, self._low_mm), config.feed_mm_min)
            while not float((self._feeler.at_rest() ** 2).sum()) ** 0.5 > config.force_n:
                out -= STEP_MM
                if out < near:
                    raise dt.SensorError(f"the side at {_side(side)} gave way")
                self._feeler.move(at(out, self._low_mm), config.feed_mm_min, MOST * config.force_n)
            return sign * out
        finally:
            self._stage.stop()
            out = sign * self._stage.position_mm()[axis]
            for target in (at(max(out, far), self._low_mm), at(max(out, far), high_mm)):
                self._go(target, config.feed_mm_min * LOWERING)
            self._feeler.release()

    def _go(self, target_mm: Vector, feed_mm_min: float) -> None:
        self._stage.start_move(target_mm, feed_mm_min)
        self._stage.wait()

    def _approach(self, side: Side, far: float, near: float, at: At) -> None:
        out = far
        while out > near + 1e-3:
            out = max(out - STRIDE_MM, near)
            if self._feeler.move(
                at(out, self._low_mm), self._config.feed_mm_min, self._config.force_n
            ):
                return
        raise dt.SensorError(
            f"the block was not met at {_side(side)} within {self._config.search_mm:g} mm of its "
            "side (touch.search_mm)"
        )


def _side(side: Side) -> str:
    return ("+" if sum(side) > 0 else "-") + ("x" if side[0] else "y")


def main(rig: str, half_x: float, half_y: float, top: float, indenter: str = "sphere:10") -> None:
    """Home, touch, print."""
    ball = dt.parse_indenter(indenter)
    with dt.open_probe(rig, ball.name) as (probe, touch):
        found = BlockTouch(probe, touch, (half_x, half_y), top, ball).find()
        frame = found.frame(probe.stage.frame)
    print(f"# the block was off by ({found.x_mm:+.3f}, {found.y_mm:+.3f}) mm")
    print(f"origin_machine_mm = {[round(p, 4) for p in frame.origin_machine_mm]}")
    print(f"angle_deg = {frame.angle_deg:.4f}")


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:5]), *sys.argv[5:])
