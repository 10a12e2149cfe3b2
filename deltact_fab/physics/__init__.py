"""Physics of the simulated sensor: gel mechanics, and the image chain from ink to bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .gel.fit.fit import fit_press
    from .gel.fit.measured import MeasuredIndentation
    from .gel.level import Choice, GelLevel, follow_path
    from .gel.level_selection import FORCE_TOLERANCE, poisson_limit
    from .gel.linear.contact import LinearContact
    from .gel.path.knots import CONTACT_EPS_MM, Increments, KnotPose, ObservedChannels, SolvedKnot
    from .gel.path.open import choose_level, open_path
    from .gel.path.solver import PathSolver
    from .gel.press import PressOutcome, press_gel
    from .gel.zones import Zones
    from .imaging import Exposure, print_colours, view_grid
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
