"""An experiment on a stage: protocols, rigs and their drivers, and the record of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .protocols.limits import RunEstimate, check_limits
    from .protocols.motion import StageConfig
    from .protocols.plan import Protocol, Step, expand_protocol, load_protocol
    from .protocols.presses import Press
    from .record.check import check_run
    from .record.conditions import require_same_conditions
    from .record.export import export_run
    from .record.images import ImageFormat, encode_png
    from .record.importing import import_recording
    from .record.ledger import SensorLedger
    from .record.notes import RunNote
    from .record.run import Run, open_run
    from .record.truth import RunTruth
    from .record.writer import RunWriter
    from .rig.bench import GrblKind
    from .rig.camera.files import ImageFolder, ImageSource, open_images
    from .rig.camera.model import load_view, open_camera, raw_size_px, take_photograph, view_notes
    from .rig.camera.stream import FeedImage, StreamCamera
    from .rig.check import ask_devices, check_rig
    from .rig.config import (
        GelConfig, GrblConfig, RigConfig, SimulatorConfig, VirtualConfig, load_rig,
    )
    from .rig.devices import HostDevice, list_devices
    from .rig.force.guard import ForceGuard, GuardLimits
    from .rig.force.netft import NetFTSensor
    from .rig.force.scale import SerialScale
    from .rig.interface import CameraFrame, Clock, Devices, Rig, RigKind, RigSetup, WallClock
    from .rig.run.runner import RunProgress, carry_out_steps
    from .rig.stage.grbl import GrblStage
    from .rig.tables import CameraConfig, ForceConfig
    from .rig.tool.hand import HandStage
    from .rig.tool.session import open_probe, register_rig
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
