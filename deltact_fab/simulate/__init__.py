"""Runs before and without hardware: checks of a request, and the virtual rig below the wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .experiment.request import RunRequest
    from .experiment.session import dry_run_experiment, run_experiment, run_presses
    from .preflight.peaks import MODULUS_FACTOR
    from .virtual.drawing import crop_lattice, picture_geometry
    from .virtual.fault_bench import FaultBench, FaultScenario
    from .virtual.photographs import take_photographs
    from .virtual.picture import FrameRenderer, PictureGeometry
    from .virtual.population import SensorDraw
    from .virtual.presolve import PressRow, solve_presses
    from .virtual.presses import PressPath, Presses, require_gel_level
    from .virtual.rig import VirtualKind, VirtualRig
    from .virtual.scene import LatticeCrop
    from .virtual.served import serve_rig
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
