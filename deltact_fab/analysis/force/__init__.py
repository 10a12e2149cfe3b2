"""The regression that calibrates the force, and what it may be trusted to.

Points are the settled frames of runs: features of the flow (`measure.force`) against the wrench
that was measured. Models are ranked by how they predict positions and indenters that they never
saw, for a random split hides that (decision 0026).
"""

from .calibrate import calibrate, carry_over, fit_best
from .dataset import ForceData, joined
from .judge import FORCES, SPLITS, component, figures, fit, judge
from .result import PAPER, PAPER_TABLE, ForceResult, errors_kept, write_calibration
