"""An experiment on a stage: protocols, rigs and their drivers, and the record of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .protocols.limits import (
        RunEstimate, at_most, check_limits, estimate_run, reason, refusal_check, require_limits,
    )
    from .protocols.motion import (
        LOCKSTEP, StageConfig, WALL_CLOCK, add_vectors, along_line, subtract_vectors,
    )
    from .protocols.plan import DeadWeights, Protocol, Step, expand_protocol, load_protocol
    from .record.check import check_run, require_whole
    from .record.conditions import require_same_conditions
    from .record.export import export_run
    from .record.files import LATTICE_FILE, LENS_FILE, UNKNOWN_SENSOR, json_bytes, truth_file
    from .record.images import encode_png, image_format, rate_held_hz, require_image_format
    from .record.importing import import_recording
    from .record.journal import CLOCK_COLUMNS, PRESS_TABLES
    from .record.notes import add_note, usable_note
    from .record.run import Run, describe_run, open_run
    from .record.truth import RunTruth
    from .record.writer import RunWriter
    from .rig.bench import GrblKind, undeclared_lengths, unmet_conditions
    from .rig.camera.files import (
        IMAGE_NAMES, ImageFolder, ImageSource, decode_image, list_images, sort_by_number,
    )
    from .rig.camera.model import (
        calibrated_camera, open_camera, raw_size_px, take_photograph, tracked_view, view_notes,
    )
    from .rig.camera.stream import ArrivedImage, StreamCamera
    from .rig.check import check_rig
    from .rig.config import (
        GelConfig, GrblConfig, RigConfig, SimulatorConfig, VirtualConfig, load_rig,
    )
    from .rig.devices import FoundDevice, list_cameras, list_ports
    from .rig.force.guard import ForceGuard, GUARD_SHARE, GuardLimits
    from .rig.force.netft import (
        ARRIVAL, DatagramArrivals, NETFT_ERROR, NETFT_SATURATED, NetFTSensor, NetFTSettings,
    )
    from .rig.force.watchdog import Watchdog, open_guarded
    from .rig.interface import (
        CameraFrame, Clock, Devices, OpenBench, Rig, RigKind, RigSetup, WallClock, move_to,
    )
    from .rig.run.loop import watch_force
    from .rig.run.runner import RunProgress, Runner
    from .rig.stage.controller import PIECE_S, PLANNED_AHEAD_S
    from .rig.stage.exchange import state_text
    from .rig.stage.grbl import GrblStage
    from .rig.tables import CameraConfig, ForceConfig
    from .rig.tool.hand import (
        HandSession, go_to, plan_move, position_text, require_short_move, stopped_by_ctrl_c,
    )
    from .rig.tool.session import (
        GuardedStage, home_stage, open_probe, register_face, requested_tool, write_registration,
    )
    from .rig.tool.tooling import TerminalOperator, home_safely
    from .rig.tool.touch import tool_change_s
    from .rig.weights import WeightsBench
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
