"""A sensor as its calibrations know it, and the stages that the asked outputs need, each once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from ...aliases import Array
from ...errors import InputError, did_you_mean
from ...optics import CameraModel
from ...shapes import SkinDimensions
from ..face import FaceFlow, whole
from ..force import Features, ForceModel, LocalFeatures, features_of
from ..force.calibration import ForceCalibration, load_force
from ..force.inverse import Inverse
from ..force.press import inverse_for
from ..health import Health, health
from ..sensor_id import Head, SensorId, read_calibration, require_same
from ..shape import Density, Depth, DepthFinder, DepthModel, by_jacobian, contacts, relative_depth
from ..view import SensorView
from .result import Output, Shape

SHAPE_EVERY = 8
"""Pixels between the points on which shape is found. Depth and contacts rest on cells of a
millimetre and say no more on finer ones; the relative depth is smoothed over more than that."""
OUTPUTS: tuple[Output, ...] = get_args(Output)


Calibration = ForceModel | ForceCalibration | DepthModel | Path | str


@dataclass(frozen=True)
class Calibrated:
    """view: with the calibration's skin where only a camera was given. rest: the face untouched."""

    view: SensorView
    force: ForceModel | None = None
    depth: DepthModel | None = None
    rest: Array | None = None

    @classmethod
    def of(
        cls,
        view: SensorView | CameraModel,
        calibrations: Sequence[Calibration],
        rest: Array | None = None,
    ) -> Calibrated:
        """Of a sensor and its calibrations, at most one a kind.

        rest: where no calibration keeps one. Raises InputError for a file that is none, another
        sensor's, and a second one of a kind.
        """
        camera = view.camera if isinstance(view, SensorView) else view
        whole = view if isinstance(view, SensorView) else None
        found: dict[str, Any] = {"rest": rest}
        for given in calibrations:
            name = str(given) if isinstance(given, Path | str) else "calibration"
            held = _read(Path(given)) if isinstance(given, Path | str) else given
            head, model = held if isinstance(held, tuple) else (None, held)
            if isinstance(model, ForceCalibration):
                kept = model.rest_image()
                head, found["rest"] = model.head, rest if kept is None else kept
                whole, model = whole or model.view(camera), model.model
            if head is not None:
                require_same(head, SensorId.of(camera), name)
            kind = "force" if isinstance(model, ForceModel) else "depth"
            if kind in found:
                raise InputError(f"{name}: a second calibration of {kind}; one is needed")
            found[kind] = model
        return cls(whole or SensorView(camera, SkinDimensions()), **found)

    def health(self, unloaded: Array) -> Health | None:
        """Of an unloaded face (h, w[, 3]) as it is tracked; None with no image to compare."""
        return None if self.rest is None else health(self.rest, unloaded, self.view.camera)


def _read(path: Path) -> ForceCalibration | tuple[Head, DepthModel]:
    head, _ = read_calibration(path)
    return load_force(path) if head.kind == "force" else DepthModel.load(path)


class Plan:
    """The stages after the tracker; "observation" is the tracker's observation.

    stages: by what each makes, what it is called with, in this order, and the call.
    every: px between the points of the flow that is given out.

    Raises InputError for an output that is unknown or whose calibration is missing.
    """

    def __init__(self, include: Sequence[str], setup: Calibrated, every: int) -> None:
        self.stages: dict[str, tuple[tuple[str, ...], Callable[..., Any]]] = {}
        self._setup, self._every = setup, every
        self._made: Features | None = None
        self.sources: dict[str, str] = {}
        for output in include:
            if output not in OUTPUTS:
                raise InputError(f"output {output!r}: unknown; {did_you_mean(output, OUTPUTS)}")
            self.sources[output] = self._makers()[output]()

    def run(self, seen: Any) -> Mapping[str, Any]:
        """What each stage makes of the tracker's observation, by name."""
        made: dict[str, Any] = {"observation": seen}
        for name, (needs, run) in self.stages.items():
            made[name] = run(*(made[need] for need in needs))
        return made

    def _add(self, name: str, needs: tuple[str, ...], run: Callable[..., Any]) -> str:
        self.stages.setdefault(name, (needs, run))
        return name

    def _makers(self) -> dict[Output, Callable[[], str]]:
        return {
            "flow": lambda: self._face(self._every),
            "observation": lambda: "observation",
            "shape": self._shape,
            "contacts": self._contacts,
            "force": self._force,
            "traction": self._traction,
        }

    def _force(self) -> str:
        model, features = self._features("force")
        face = self._whole(features.every)
        numbers = self._add(f"{features.name} features", (face,), features.of)
        return self._add(
            "force", (face, numbers), lambda flow, x: model.wrench(x, features.cover(flow))
        )

    def _traction(self) -> str:
        model, features = self._features("traction")
        if not isinstance(features, LocalFeatures):
            raise InputError(
                f"output 'traction': the force model's features {features.name!r} do not say where"
            )
        face = self._whole(features.every)
        return self._add("traction", (face,), lambda flow: features.traction(flow, model))

    def _shape(self) -> str:
        camera, face = self._setup.view.camera, self._whole(SHAPE_EVERY)
        density = self._add("density", (face,), lambda flow: by_jacobian(flow, camera.mm_per_px))
        relative = self._add("relative depth", (density, face), relative_depth)
        needs: tuple[str, ...] = (face, density, relative)
        if self._setup.depth is not None:
            needs = (*needs, self._depth("shape"))
        return self._add("shape", needs, _shape)

    def _contacts(self) -> str:
        camera = self._setup.view.camera
        depth = self._depth("contacts")
        needs = (depth, self._whole(SHAPE_EVERY), self.stages[depth][0][1])
        return self._add(
            "contacts", needs, lambda depth, flow, press: contacts(depth, flow, camera, press)
        )

    def _depth(self, output: str) -> str:
        if self._setup.depth is None:
            raise InputError(
                f"output {output!r}: a calibration of depth is needed; `deltact-fab "
                "calibrate depth RUN` makes one"
            )
        finder = DepthFinder(self._setup.view, self._setup.depth)
        # Once for force and shape, where they were calibrated with the same gel: it is kept.
        press = self._add("press", (self._whole(Inverse.every),), finder.inverse.of)
        return self._add("depth", (self._whole(SHAPE_EVERY), press), finder.of)

    def _features(self, output: Output) -> tuple[ForceModel, Features]:
        model = self._setup.force
        if model is None:
            raise InputError(
                f"output {output!r}: a calibration of force is needed; `deltact-fab calibrate "
                "force RUN` makes one"
            )
        if self._made is None:
            self._made = features_of(model, self._setup.view, f"output {output!r}: force model")
            if isinstance(self._made, Inverse):
                inverse_for(self._setup.view)  # now, and not at the first image
        return model, self._made

    def _face(self, every: int) -> str:
        camera = self._setup.view.camera
        return self._add(
            f"face at {every} px", ("observation",), lambda seen: FaceFlow.of(seen, camera, every)
        )

    def _whole(self, every: int) -> str:
        """For those that ask for a flow without holes, made so once."""
        return self._add(f"whole face at {every} px", (self._face(every),), whole)


def _shape(flow: FaceFlow, density: Density, relative: Any, depth: Depth | None = None) -> Shape:
    return Shape(density, relative, flow.x_mm, flow.y_mm, depth)
