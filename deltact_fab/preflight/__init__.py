"""What a protocol will ask of stage and force sensor, before anything moves.

Reading order: `press` (normal force of one press, or a bound of it), `peaks` (every indenter,
position and depth, with shear and moments), `rule` (what a rig allows), `plate` (what the acrylic
behind the gel bears), `needs` (time, disk, frames a second).
"""

from .needs import image_px, needs
from .peaks import PAPER_REMARK, Peak, predict
from .plate import plate_checks
from .rule import ForceLimits, checks, limits_of

__all__ = [
    "PAPER_REMARK",
    "ForceLimits",
    "Peak",
    "checks",
    "image_px",
    "limits_of",
    "needs",
    "plate_checks",
    "predict",
]
