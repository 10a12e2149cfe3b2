"""What a protocol will ask of stage and force sensor, before anything moves.

Reading order: `press` (normal force of one press, or a bound of it), `peaks` (every indenter,
position and depth, with shear and moments), `rule` (what a rig allows), `plate` (what the acrylic
behind the gel bears), `needs` (time, disk, frames a second).
"""

from .needs import image_px, needs
from .peaks import MODULUS_FACTOR, PAPER_REMARK, Peak, predict
from .plate import judge_plate, plate_checks
from .rule import ForceLimits, checks, judge, limits_of, may_trip, require

__all__ = [
    "MODULUS_FACTOR",
    "PAPER_REMARK",
    "ForceLimits",
    "Peak",
    "checks",
    "image_px",
    "judge",
    "judge_plate",
    "limits_of",
    "may_trip",
    "needs",
    "plate_checks",
    "predict",
    "require",
]
