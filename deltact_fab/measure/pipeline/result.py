"""What a measurement says of one image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ...aliases import Array
from ..dots import DotObservation
from ..face import FaceFlow
from ..flow import FlowObservation
from ..force import TractionField, Wrench
from ..health import Health
from ..shape import ContactRegion, Density, Depth

Output = Literal["flow", "observation", "shape", "contacts", "force", "traction"]


@dataclass(frozen=True)
class Shape:
    """Of the face, at points of the resting face x_mm (w,), y_mm (h,).

    density: as in the paper. relative (h, w) float32: its relative depth, without unit. depth: in
    mm, None without a calibration of depth.
    """

    density: Density
    relative: Array
    x_mm: Array
    y_mm: Array
    depth: Depth | None

    @property
    def cover(self) -> float:
        """Share of what it rests on that is known."""
        return self.density.cover if self.depth is None else self.depth.cover


@dataclass(frozen=True)
class Result:
    """One image's outputs; those that were not asked for are None.

    frame: 0 for the reference image, then one more an image followed. t_s: when the image was
    taken, on the clock of `time.monotonic`, or when it was given; age_ms: from then until this
    result was complete. cover: share of the view whose motion is known. trusted: the tracker
    believes enough of what it sees; without it no output counts.

    health: of the sensor at the reference image, None where no calibration kept one to compare.
    flow: of the face. observation: the tracker's own words, on its half grid. contacts: the deepest
    first. force: on the sensor. traction: its distribution over the face. Each has a cover of its
    own, of what it rests on. markers: of a skin of such; cover is then the share that is held.
    """

    frame: int
    t_s: float
    age_ms: float
    cover: float
    trusted: bool
    health: Health | None = None
    flow: FaceFlow | None = None
    observation: FlowObservation | None = None
    shape: Shape | None = None
    contacts: list[ContactRegion] | None = None
    force: Wrench | None = None
    traction: TractionField | None = None
    markers: DotObservation | None = None

    @property
    def extrapolated(self) -> bool:
        """A calibration is used beyond what it was made from, so its errors do not hold."""
        depth = self.shape.depth if self.shape is not None else None
        return any(part is not None and part.extrapolated for part in (self.force, depth))
