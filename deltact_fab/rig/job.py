"""One run as a rig sees it: the job, the devices that it drives, and who builds them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ..aliases import Progress
from .interface import Camera, Clock, ForceSensor, Guard, Stage

if TYPE_CHECKING:
    from ..optics import CameraModel, FlatField
    from ..patterns.recipe import PatternRecipe
    from ..protocols import plan
    from ..shapes import SensorDimensions


@dataclass
class Devices:
    """What a run drives. A camera or force sensor that the protocol does not ask for is None."""

    clock: Clock
    stage: Stage
    camera: Camera | None
    force: ForceSensor | None
    change_indenter: Callable[[str], str | None]
    """Has an indenter mounted and finds its tip; returns what the record is to keep of it."""
    guard: Guard | None = None
    begin: Callable[[], str] | None = None
    """Before a session's homing, the stage connected: asks, lifts a tip out of the gel, or raises;
    returns what the record is to keep of it."""
    change_s: float = 0.0
    """What `change_indenter` takes by plan."""
    wall_clock: bool = False
    """Time passes by itself: every device has a thread of its own; else one scheduler steps all."""


@dataclass(frozen=True)
class RigSetup:
    """One run as it was asked for: what a rig is built from. folder: of the run."""

    protocol: plan.Protocol
    sensor: SensorDimensions
    recipe: PatternRecipe
    view: CameraModel | None
    """Of the images that are tracked, see `RigKind.camera`."""
    seed: int
    folder: Path
    air: bool = False
    """Nothing is touched, see `protocols.plan.expand`."""
    unattended: bool = False
    """Run without prompts: nobody changes an indenter or answers."""
    tip_is_clear: bool = False
    """The operator's word that the tip touches nothing when the session begins."""


class Rig(Protocol):
    """All devices of one run. Whoever builds it closes it, however the run ends."""

    def devices(self) -> Devices: ...
    def identity(self) -> dict[str, Any]:
        """What the summary keeps of each device; None for one that is not there."""

    def notes(self) -> list[str]:
        """What a reader of the results must know, once the run is over."""

    def left_out(self) -> list[str]:
        """What was not built, driven or solved, and why."""

    def close(self) -> None:
        """Close every device, also after one that fails to; again does nothing."""


class RigKind(Protocol):
    """What one kind of rig says before any device is opened, and how it is built."""

    part: str
    """What `refusals` speaks of, for a table of checks."""

    def refusals(self, protocol: plan.Protocol, sensor: SensorDimensions, source: str) -> list[str]:
        """Why a protocol cannot be carried out on it, a line each; source: of the protocol."""

    def camera(self, protocol: plan.Protocol, sensor: SensorDimensions) -> CameraModel | None:
        """The projection of the images that are tracked; None without a camera.

        Raises InputError for a calibration that cannot be read, or not serve here.
        """

    def flat(self, protocol: plan.Protocol) -> FlatField | None:
        """How the light falls off in that camera's images, where it is known. Raises InputError."""

    def build(self, job: RigSetup, progress: Progress | None = None) -> Rig:
        """Every device of the run, or none: what was opened is closed when another fails.

        progress: told of what has to be solved first.
        """
