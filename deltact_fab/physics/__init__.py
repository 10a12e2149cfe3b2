"""What the simulated sensor obeys: gel mechanics, and the way from ink to an image's bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .gel.finite.gel import FaceLattice, face_wrench
    from .gel.finite.linear import SolverName
    from .gel.finite.material import MAX_FINITE_POISSON
    from .gel.finite.mesh import block_mesh
    from .gel.finite.press import FinitePress
    from .gel.finite.state import FiniteState
    from .gel.fit.fit import fit_press
    from .gel.fit.measured import read_press_csv
    from .gel.level import Choice, IncrementDiagnostics, Level, Reach, follow_path
    from .gel.level_selection import MODEL_TOLERANCE_SHARE, select_level
    from .gel.linear.contact import LinearContact, SMALL_STRAIN
    from .gel.linear.validity import linear_refusal
    from .gel.path.knots import (
        CONTACT_EPS_MM, Increments, KnotPose, ObservedChannels, SolvedKnot, divide_path,
        poses_along,
    )
    from .gel.path.open import choose_level, open_contact, open_path
    from .gel.path.solver import PathSolver, SOLVED_PATHS
    from .gel.press import press_gel
    from .gel.zones import Zones
    from .imaging import Exposure, print_colours, view_grid
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
