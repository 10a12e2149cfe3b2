"""Lateral position of the face: a ball touches the sides of a block around the sensor.

    python find_the_block.py RIG HALF_X_MM HALF_Y_MM TOP_MM [sphere:10]

HALF: half the block's sides along the sensor's x and y. TOP: height of its top relative to the
resting face, negative. Run it after `rig register`; its output replaces `origin_machine_mm` and
`angle_deg` in that registration. The rig homes, and asks for the ball first.

A force does not show its position on an even face, so position and rotation are measured on an
object with edges: the tactile base's own frame, or a block placed over it. Opposite sides are
touched in the same way, so the ball's size, the threshold and the stopping distance cancel in the
midpoint between them. The rotation comes from two touches of one side.
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
MOST = 5.0  # times the threshold: force limit of a step
BELOW_MM = 1.0  # depth of the ball's equator under the block's top
BACK_MM = 0.1
OFF_MM = 0.5  # largest deviation from the declared size
MAX_TURN_DEG = 5.0

Vector = tuple[float, float, float]
At = Callable[[float, float], Vector]
Side = tuple[float, float]  # a unit vector out of the block


@dataclass(frozen=True)
class BlockPlace:
    """Offset and rotation of the block from the frame in its axes (mm, degrees), and its size."""

    x_mm: float
    y_mm: float
    turn_deg: float
    half_mm: tuple[float, float]

    def frame(self, before):
        """The stage's frame, shifted and rotated to centre on the block."""
        origin = before.to_machine_mm((self.x_mm, self.y_mm, 0.0))
        turned = before.angle_deg + self.turn_deg
        return replace(before, origin_machine_mm=origin, angle_deg=turned)


class BlockTouch:
    """Touches the sides of a block with a ball, in the stage's frame, whose z = 0 is the face.

    probe, touch: from `dt.open_probe`. ball: from `dt.parse_indenter`.
    """

    def __init__(self, probe, touch, half_mm: tuple[float, float], top_mm: float, ball) -> None:
        self._feeler, self._stage = probe, probe.stage
        self._config = touch
        self._half_mm = half_mm
        self._radius_mm = ball.footprint_half_mm[0]
        self._low_mm = top_mm - BELOW_MM - self._radius_mm

    def find(self) -> BlockPlace:
        """Touch all sides, one of them twice. Raises SensorError or RunFailed with the tip raised,
        unless the stage has failed."""
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
        for axis, measured, declared in zip("xy", size, (half_x, half_y), strict=True):
            if abs(measured - declared) > OFF_MM:
                raise dt.RunFailed(
                    f"the block is {2 * measured:.2f} mm wide along {axis}, not {2 * declared:g}: "
                    "wrong block, or wrong ball"
                )
        if abs(math.degrees(turn)) > MAX_TURN_DEG:
            raise dt.RunFailed(
                f"the block is rotated by {math.degrees(turn):.1f} degrees, more than "
                f"{MAX_TURN_DEG:g}: align it"
            )
        return BlockPlace(*middle, math.degrees(turn), (size[0], size[1]))

    def _touch(self, side: Side, along_mm: float, high_mm: float) -> float:
        """Touch one side; return the ball's centre at contact, on that side's axis.

        The ball retracts outwards before it moves up.
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
                raise dt.SensorError(f"obstacle next to the block, at {_side(side)}")
            self._approach(side, far, near, at)
            out = sign * self._stage.position_mm()[axis]
            out += BACK_MM
            self._go(at(out, self._low_mm), config.feed_mm_min)
            while not float((self._feeler.at_rest() ** 2).sum()) ** 0.5 > config.force_n:
                out -= STEP_MM
                if out < near:
                    raise dt.SensorError(f"the side at {_side(side)} yielded")
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
            f"no contact with the block at {_side(side)} within {self._config.search_mm:g} mm of "
            "its side (touch.search_mm)"
        )


def _side(side: Side) -> str:
    return ("+" if sum(side) > 0 else "-") + ("x" if side[0] else "y")


def main(rig: str, half_x: float, half_y: float, top: float, indenter: str = "sphere:10") -> None:
    """Home, touch, print."""
    ball = dt.parse_indenter(indenter)
    with dt.open_probe(rig, ball.name) as (probe, touch):
        found = BlockTouch(probe, touch, (half_x, half_y), top, ball).find()
        frame = found.frame(probe.stage.frame)
    print(f"# offset of the block: ({found.x_mm:+.3f}, {found.y_mm:+.3f}) mm")
    print(f"origin_machine_mm = {[round(p, 4) for p in frame.origin_machine_mm]}")
    print(f"angle_deg = {frame.angle_deg:.4f}")


if __name__ == "__main__":
    main(sys.argv[1], *map(float, sys.argv[2:5]), *sys.argv[5:])
