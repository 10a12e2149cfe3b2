"""A sensor as its calibrations know it, and what it says of one image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from deltact_fab.common import Array, InputError, did_you_mean
from deltact_fab.sensor import CameraModel

from ..dots.tracker import DotObservation
from ..face import FaceFlow, whole
from ..flow.confidence import FlowObservation
from ..force import load_features
from ..force.calibration import ForceCalibration, load_force
from ..force.inverse import Inverse
from ..force.model import Features, ForceModel, TractionField, Wrench
from ..health import Health
from ..sensor_id import SensorModel, read_calibration, require_same_sensor
from ..shape.density import Density, jacobian_density, relative_depth
from ..shape.depth import ContactRegion, Depth, DepthFinder, DepthModel, find_contacts

Output = Literal["flow", "observation", "shape", "contacts", "force", "traction"]
OUTPUTS: tuple[Output, ...] = get_args(Output)
Calibration = ForceModel | ForceCalibration | DepthModel | Path | str


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
class MeasurementResult:
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


class Estimators:
    """All that makes outputs of a sensor's observations, by its calibrations, at most one a kind.

    view: the sensor with gel and untouched face of the calibration of force. force, features,
    depth: None where they are not calibrated.

    Raises InputError for a file that is none, another sensor's, and a second one of a kind.
    """

    def __init__(
        self, view: SensorModel | CameraModel, calibrations: Sequence[Calibration]
    ) -> None:
        self.view = view if isinstance(view, SensorModel) else SensorModel(view)
        self.force: ForceModel | None = None
        self.features: Features | None = None
        self.depth: DepthModel | None = None
        for given in calibrations:
            name = str(given) if isinstance(given, Path | str) else "calibration"
            self._take(
                _read(Path(given), self.view) if isinstance(given, Path | str) else given, name
            )
        if self.force is not None:
            self.features = load_features(self.force, self.view, "force model")

    def _take(self, model: ForceModel | ForceCalibration | DepthModel, name: str) -> None:
        if isinstance(model, ForceCalibration):
            self.view, model = model.view(self.view), model.model
        kind = "force" if isinstance(model, ForceModel) else "depth"
        if getattr(self, kind) is not None:
            raise InputError(f"{name}: a second calibration of {kind}; one is needed")
        setattr(self, kind, model)

    @property
    def allowed(self) -> tuple[str, ...]:
        """All outputs for which there is what they need."""
        lacking = {"contacts"} if self.depth is None else set[str]()
        if self.features is None or not self.features.local:
            lacking |= {"force", "traction"} if self.features is None else {"traction"}
        return tuple(output for output in OUTPUTS if output not in lacking)

    def prepare(self, include: Sequence[str]) -> None:
        """Make what these outputs need and no image changes, which may take seconds.

        Raises InputError for an output that is unknown or whose calibration is missing.
        """
        for output in include:
            if output not in OUTPUTS:
                raise InputError(f"output {output!r}: unknown; {did_you_mean(output, OUTPUTS)}")
            if output not in self.allowed:
                kind = "depth" if output == "contacts" else "force"
                if kind == "force" and self.features is not None:
                    features = f"the force model's features {self.features.name!r}"
                    raise InputError(f"output {output!r}: {features} do not say where")
                raise InputError(
                    f"output {output!r}: a calibration of {kind} is needed; `deltact-fab calibrate "
                    f"{kind} RUN` makes one"
                )
        if isinstance(self.features, Inverse) and {"force", "traction"} & set(include):
            _ = self.features.inverse
        if {"shape", "contacts"} & set(include):
            _ = self.finder

    @cached_property
    def finder(self) -> DepthFinder | None:
        """By the calibration of depth."""
        return None if self.depth is None else DepthFinder(self.view, self.depth)

    def health(self, unloaded: Array) -> Health | None:
        """Of an unloaded face (h, w[, 3]) as it is tracked; None with no image to compare."""
        rest = self.view.rest
        return None if rest is None else Health.compare(rest, unloaded, self.view.camera)

    def outputs(self, include: Sequence[str], seen: FlowObservation, every: int) -> dict[str, Any]:
        """What an observation says, by name; no more is made than these outputs need.

        every: px between the points of "flow".
        """
        camera, asked = self.view.camera, set(include)
        made: dict[str, Any] = {"observation": seen} if "observation" in asked else {}
        if "flow" in asked:
            made["flow"] = FaceFlow.of(seen, camera, every)
        if asked <= {"flow", "observation"}:
            return made
        face = whole(FaceFlow.of(seen, camera, FaceFlow.SPACING_PX))
        depth = None
        if self.finder is not None and asked & {"shape", "contacts"}:
            depth = self.finder.find(face)
        if "shape" in asked:
            density = jacobian_density(face, camera.mm_per_px)
            relative = relative_depth(density, face)
            made["shape"] = Shape(density, relative, face.x_mm, face.y_mm, depth)
        if self.finder is not None and depth is not None and "contacts" in asked:
            press = self.finder.inverse.solve(face)  # kept since the depth asked for it
            made["contacts"] = find_contacts(depth, face, camera, press)
        if self.features is not None and self.force is not None:
            if "force" in asked:
                numbers, cover = self.features.compute(face), self.features.cover(face)
                made["force"] = self.force.wrench(numbers, cover)
            if "traction" in asked:
                made["traction"] = self.features.traction(face, self.force)
        return made


def _read(path: Path, view: SensorModel) -> ForceCalibration | DepthModel:
    """Of a file, which must be this sensor's."""
    head, _ = read_calibration(path)
    require_same_sensor(head, view.id, str(path))
    return load_force(path) if head.kind == "force" else DepthModel.load(path)[1]
