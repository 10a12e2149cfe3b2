"""Part 1, the tactile skin base: the black frame that the skin is cast into.

Seen along -z (from the touched side):            Section at y = 0:

    +--------------------------------+               z = -protrusion
    |  o  +--------------------+  o  |  y        +--+      +--+
    |     |                    |     |  ^        |  |      |  |   height
    +-----+                    +-----+  |        |  |      |  |
      |           window           |    +-> x    +--+      +--+
    +-----+  width x length    +-----+           <-> wall_x
    |     |  less the posts    |     |
    |  o  +--------------------+  o  |        o: blind pilot from below, pilot_depth deep, on the
    +--------------------------------+           axis of the square corner post (side post)

The paper gives no drawing. A 3 mm wall cannot hold an M1.6 screw, so a square post stands in each
corner and takes a corner of the window; the skin is notched there below the protrusion. Frame and
skin share faces and no volume.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from ...shapes import SensorDimensions
from ..checks import Expected, at_most, less
from ..kernel import require

if TYPE_CHECKING:
    from cadquery import Shape

NAME = "skin-frame"


def post_in_window_mm(dims: SensorDimensions) -> tuple[float, float]:
    """Sides (x, y) by which a corner post reaches into the window; (0, 0) when the walls hold it.

    x = post - wall_x, y = post - wall_y.
    """
    frame = dims.frame
    x_mm, y_mm = frame.post_mm - frame.wall_x_mm, frame.post_mm - frame.wall_y_mm
    return (x_mm, y_mm) if min(x_mm, y_mm) > 0 else (0.0, 0.0)


def hole_centres_mm(dims: SensorDimensions) -> list[tuple[float, float]]:
    """Axes (x, y) of the four screws = outer / 2 - post / 2: (+-16.3, +-16.8) by default."""
    x_mm, y_mm = (side / 2 - dims.frame.post_mm / 2 for side in dims.frame_outer_mm)
    return [(sx * x_mm, sy * y_mm) for sy in (-1, 1) for sx in (-1, 1)]


def window_area_mm2(dims: SensorDimensions) -> float:
    """Area of the window = width x length - 4 post corners."""
    x_mm, y_mm = post_in_window_mm(dims)
    return dims.skin.width_mm * dims.skin.length_mm - 4 * x_mm * y_mm


def expect(dims: SensorDimensions) -> Expected:
    """Closed forms of the frame. Raises InputError stating the inequality that fails."""
    skin, frame = dims.skin, dims.frame
    outer_x, outer_y = dims.frame_outer_mm
    less(NAME, ("pilot_diameter_mm", frame.pilot_diameter_mm), ("post_mm", frame.post_mm))
    less(NAME, ("pilot_depth_mm", frame.pilot_depth_mm), ("height_mm", frame.height_mm))
    for side, wall, window in (
        ("x", frame.wall_x_mm, skin.width_mm),
        ("y", frame.wall_y_mm, skin.length_mm),
    ):
        less(
            NAME,
            (f"2 (post_mm - wall_{side}_mm)", 2 * (frame.post_mm - wall)),
            (f"the window's side in {side}", window),
        )
    # The frame holds the acrylic as well; a shorter one would leave it standing out behind.
    behind_mm = skin.thickness_mm - skin.protrusion_mm + dims.optics.acrylic_mm
    at_most(
        NAME,
        ("thickness_mm - protrusion_mm + acrylic_mm", behind_mm),
        ("height_mm", frame.height_mm),
    )
    hole_mm3 = math.pi / 4 * frame.pilot_diameter_mm**2 * frame.pilot_depth_mm
    volume_mm3 = (outer_x * outer_y - window_area_mm2(dims)) * frame.height_mm - 4 * hole_mm3
    top_mm = -skin.protrusion_mm
    return Expected(
        (volume_mm3, volume_mm3),
        (
            (-outer_x / 2, -outer_y / 2, top_mm - frame.height_mm),
            (outer_x / 2, outer_y / 2, top_mm),
        ),
        {"width_mm": skin.width_mm, "length_mm": skin.length_mm, **asdict(frame)},
    )


def build(dims: SensorDimensions) -> Shape:
    """The frame as one solid in the sensor frame, z from -protrusion - height to -protrusion."""
    cq = require()
    frame = dims.frame
    outer_x, outer_y = dims.frame_outer_mm
    bottom_mm = -dims.skin.protrusion_mm - frame.height_mm
    outer = cq.Workplane().workplane(offset=bottom_mm).rect(outer_x, outer_y)
    # The cutter stands out at both ends: faces that coincide are where booleans go wrong.
    window = (
        cq.Workplane()
        .workplane(offset=bottom_mm - 1)
        .polyline(_window_outline_mm(dims))
        .close()
        .extrude(frame.height_mm + 2)
    )
    pilots = (
        cq.Workplane()
        .workplane(offset=bottom_mm - 1)
        .pushPoints(hole_centres_mm(dims))
        .circle(frame.pilot_diameter_mm / 2)
        .extrude(frame.pilot_depth_mm + 1)
    )
    return outer.extrude(frame.height_mm).cut(window).cut(pilots).val()


def _window_outline_mm(dims: SensorDimensions) -> list[tuple[float, float]]:
    """Corners (x, y) of the window, counter-clockwise: 4, or 12 where posts cut its corners."""
    w, h = dims.skin.width_mm / 2, dims.skin.length_mm / 2
    x, y = post_in_window_mm(dims)
    if x == 0:
        return [(-w, -h), (w, -h), (w, h), (-w, h)]
    upper = [(w, h - y), (w - x, h - y), (w - x, h), (x - w, h), (x - w, h - y), (-w, h - y)]
    return upper + [(-px, -py) for px, py in upper]
