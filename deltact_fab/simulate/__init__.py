"""Runs before and without hardware: checks of a request, and the virtual rig below the wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .experiment.request import RunRequest
    from .experiment.session import (
        dry_run_experiment, library_versions, pattern_data, run_experiment, run_presses,
    )
    from .preflight.peaks import MODULUS_FACTOR, PAPER_REMARK, Peak
    from .virtual.clock import VirtualClock
    from .virtual.controller import GrblController
    from .virtual.drawing import crop_of, geometry_of, noise_of, printed_renderer, resting_geometry
    from .virtual.grbl_lines import grbl_settings
    from .virtual.netft import BoxFaults, Datagram, NetFTBox
    from .virtual.photographs import take_photographs
    from .virtual.picture import (
        FrameRenderer, PICTURE_MARGIN_PX, PICTURE_TOLERANCE_PX, PictureGeometry, Texture,
    )
    from .virtual.presolve import PressRow, solve_ahead
    from .virtual.presses import (
        PressPath, Presses, path_of_press, require_gel_level, stored_press_files,
    )
    from .virtual.rig import VirtualForce, VirtualKind, VirtualRig
    from .virtual.scene import LatticeCrop
    from .virtual.served import serve_rig
    from .virtual.wire import SerialLink, WireExchange
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
