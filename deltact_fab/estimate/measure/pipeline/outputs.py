"""Estimators of a calibrated sensor, and their outputs for one image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

from deltact_fab.common import Array, InputError, did_you_mean
from deltact_fab.sensor import CameraModel

from ..dots.tracker import DotObservation
from ..face import FaceFlow, fill_unknown
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
OUTPUT_NAMES: tuple[Output, ...] = get_args(Output)
Calibration = ForceModel | ForceCalibration | DepthModel | Path | str


@dataclass(frozen=True)
class Shape:
    """Shape of the face at points of the resting face x_mm (w,), y_mm (h,).

    density: as in the paper. relative: (h, w) float32, its relative depth, without unit. depth: in
    mm, None without a depth calibration.
    """

    density: Density
    relative: Array
    x_mm: Array
    y_mm: Array
    depth: Depth | None

    @property
    def cover(self) -> float:
        """Fraction of its input that is known."""
        return self.density.cover if self.depth is None else self.depth.cover


@dataclass(frozen=True)
class MeasurementResult:
    """Outputs for one image; those not requested are None.

    frame: 0 for the reference image, then counted up. t_s: time of capture on the clock of
    `time.monotonic`, or of submission; age_ms: from then until this result was complete. cover:
    fraction of the view whose motion is known. trusted: enough of the flow is confident; if False,
    ignore all other outputs.

    health: of the sensor at the reference image, None without a calibration image to compare with.
    flow: of the face. observation: the tracker's output on its half grid. contacts: deepest first.
    force: on the sensor. traction: its distribution over the face. Each has its own cover, of its
    input. markers: of a marker skin; cover is then the fraction tracked.
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
        """True if a calibration's errors do not hold: outside its range, or too little is known."""
        depth = self.shape.depth if self.shape is not None else None
        return any(part is not None and part.extrapolated for part in (self.force, depth))


class Estimators:
    """Estimators of a sensor's outputs from its calibrations, at most one per kind.

    view: the sensor with gel and untouched face of the force calibration. force, features, depth:
    None if not calibrated.

    Raises InputError for an invalid file, another sensor's, and a second one of a kind.
    """

    def __init__(
        self, view: SensorModel | CameraModel, calibrations: Sequence[Calibration]
    ) -> None:
        self.view = view if isinstance(view, SensorModel) else SensorModel(view)
        self.force: ForceModel | None = None
        self.features: Features | None = None
        self.depth: DepthModel | None = None
        for item in calibrations:
            name = str(item) if isinstance(item, Path | str) else "calibration"
            self._take(_load(Path(item), self.view) if isinstance(item, Path | str) else item, name)
        if self.force is not None:
            self.features = load_features(self.force, self.view, "force model")

    def _take(self, model: ForceModel | ForceCalibration | DepthModel, name: str) -> None:
        if isinstance(model, ForceCalibration):
            self.view, model = model.view(self.view), model.model
        kind = "force" if isinstance(model, ForceModel) else "depth"
        if getattr(self, kind) is not None:
            raise InputError(f"{name}: a second {kind} calibration; give one only")
        setattr(self, kind, model)

    @property
    def allowed(self) -> tuple[str, ...]:
        """Outputs whose calibrations are present."""
        lacking = {"contacts"} if self.depth is None else set[str]()
        if self.features is None or not self.features.local:
            lacking |= {"force", "traction"} if self.features is None else {"traction"}
        return tuple(output for output in OUTPUT_NAMES if output not in lacking)

    def prepare(self, include: Sequence[str]) -> None:
        """Precompute the image-independent parts of these outputs, which may take seconds.

        Raises InputError for an output that is unknown or whose calibration is missing.
        """
        for output in include:
            if output not in OUTPUT_NAMES:
                raise InputError(f"no output {output!r}; {did_you_mean(output, OUTPUT_NAMES)}")
            if output not in self.allowed:
                kind = "depth" if output == "contacts" else "force"
                if kind == "force" and self.features is not None:
                    features = f"the force model's features {self.features.name!r}"
                    raise InputError(f"output {output!r}: {features} do not locate contacts")
                raise InputError(
                    f"output {output!r}: needs a {kind} calibration; make one with "
                    f"`deltact-fab calibrate {kind} RUN`"
                )
        if isinstance(self.features, Inverse) and {"force", "traction"} & set(include):
            _ = self.features.inverse
        if {"shape", "contacts"} & set(include):
            _ = self.finder

    @cached_property
    def finder(self) -> DepthFinder | None:
        """Depth finder of the depth calibration."""
        return None if self.depth is None else DepthFinder(self.view, self.depth)

    def health(self, unloaded: Array) -> Health | None:
        """Check an unloaded face (h, w[, 3]), as tracked; None without an image to compare with."""
        rest = self.view.rest
        return None if rest is None else Health.compare(rest, unloaded, self.view.camera)

    def outputs(
        self, include: Sequence[str], observation: FlowObservation, spacing_px: int
    ) -> dict[str, Any]:
        """Compute the requested outputs of an observation, by name.

        spacing_px: px between the points of "flow".
        """
        camera, requested = self.view.camera, set(include)
        results: dict[str, Any] = {"observation": observation} if "observation" in requested else {}
        if "flow" in requested:
            results["flow"] = FaceFlow.from_flow(observation, camera, spacing_px)
        if requested <= {"flow", "observation"}:
            return results
        face = fill_unknown(FaceFlow.from_flow(observation, camera, FaceFlow.SPACING_PX))
        depth = None
        if self.finder is not None and requested & {"shape", "contacts"}:
            depth = self.finder.find(face)
        if "shape" in requested:
            density = jacobian_density(face, camera.mm_per_px)
            relative = relative_depth(density, face)
            results["shape"] = Shape(density, relative, face.x_mm, face.y_mm, depth)
        if self.finder is not None and depth is not None and "contacts" in requested:
            press = self.finder.inverse.solve(face)  # cached by the depth
            results["contacts"] = find_contacts(depth, face, camera, press)
        if self.features is not None and self.force is not None:
            if "force" in requested:
                numbers, cover = self.features.compute(face), self.features.cover(face)
                results["force"] = self.force.wrench(numbers, cover)
            if "traction" in requested:
                results["traction"] = self.features.traction(face, self.force)
        return results


def _load(path: Path, view: SensorModel) -> ForceCalibration | DepthModel:
    """Load a calibration file, which must be this sensor's."""
    head, _ = read_calibration(path)
    require_same_sensor(head, view.id, str(path))
    return load_force(path) if head.kind == "force" else DepthModel.load(path)[1]
