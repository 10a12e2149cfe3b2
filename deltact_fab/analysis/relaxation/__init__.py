"""How a gel's force fades at rest: the series in closed form, a run's rests, and what fits them.

Reading order: `series`, `rests`, `fit`.
"""

from .fit import RelaxationFit, Series, fit, time_to
from .rests import Rest, rests

__all__ = ["RelaxationFit", "Rest", "Series", "fit", "rests", "time_to"]
