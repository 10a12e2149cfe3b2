"""Tracking error of flow: at the dots as in the paper, and off the dots against truth.

The paper's error (Eq. 7) compares the flow with the white dots, which are features themselves and
flatter the flow; on a virtual rig the truth is known everywhere, so the error of the pattern
between the dots is reported beside it, over all moving visible pixels and over those of them that
the tracker is confident of, with their share. An error is the endpoint error of the projected
motion in pixels times mm/px at rest. In-plane surface motion is another figure: what remains when
the projected flow is taken for it stands in its own column.
"""

from .result import PAPER_BEST_MM, RULE, TrackingResult, TrackingVerdict, judge, percent
from .run import ARROW_STEP_PX, analyse
from .tally import MOVING_MM, WRONG_MM, shown

__all__ = [
    "ARROW_STEP_PX",
    "MOVING_MM",
    "PAPER_BEST_MM",
    "RULE",
    "WRONG_MM",
    "TrackingResult",
    "TrackingVerdict",
    "analyse",
    "judge",
    "percent",
    "shown",
]
