"""The regression that calibrates the force, and what it may be trusted to.

Points are the settled frames of runs: features of the flow (`measure.force`) against the wrench
that was measured. Models are ranked by how they predict positions and indenters that they never
saw, for a random split hides that (decision 0026).
"""

from .calibrate import calibrate, carry_over, fit_best
from .dataset import ForceData, joined
from .judge import (
    FORCES,
    LEFT_OUT,
    component,
    enough,
    figures,
    fit,
    judge,
    learning_curve,
    score,
)
from .result import PAPER, PAPER_TABLE, ForceResult, errors_kept, write_calibration
from .transfer import transfer

__all__ = [
    "FORCES",
    "LEFT_OUT",
    "PAPER",
    "PAPER_TABLE",
    "ForceData",
    "ForceResult",
    "calibrate",
    "carry_over",
    "component",
    "enough",
    "errors_kept",
    "figures",
    "fit",
    "fit_best",
    "joined",
    "judge",
    "learning_curve",
    "score",
    "transfer",
    "write_calibration",
]
