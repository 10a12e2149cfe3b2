"""What a frame says of the force on the sensor: features, and a regression from them to the wrench.

What is not linear happens in the features, so a fit is a small least squares and a cross-validation
costs nothing on features that were kept.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from deltact_fab.common import Array, InputError

from ..face import FaceFlow
from ..regression import RegressionFit, least_squares, relative_leverage

WRENCH_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Order of a wrench (6,): N on the sensor, and N mm about the centre of its resting face."""


@dataclass(frozen=True)
class Wrench:
    """Force and torque on the sensor about the centre of its resting face; a press has Fz < 0.

    force_n, torque_nmm (3,) float64, nan where it was not calibrated. cover: share of the points
    it rests on whose motion is known; where it is 0 nothing was seen and the wrench is 0.
    extrapolated: a feature lies beyond what the model was trained on, so no error that was measured
    then holds.
    """

    force_n: Array
    torque_nmm: Array
    cover: float
    extrapolated: bool


@dataclass(frozen=True)
class TractionField:
    """Traction on the sensor at points of the resting face, (ny, nx, 3) float64, MPa = N / mm2.

    x_mm (nx,), y_mm (ny,): the points, equally spaced, each standing for its cell. cover: as of a
    Wrench.
    """

    traction_mpa: Array
    x_mm: Array
    y_mm: Array
    cover: float

    @property
    def cell_mm2(self) -> float:
        """Area that a point stands for."""
        return float((self.x_mm[1] - self.x_mm[0]) * (self.y_mm[1] - self.y_mm[0]))

    @property
    def pressed(self) -> bool:
        return bool(self.traction_mpa[..., 2].any())

    def centre_mm(self) -> Array:
        """Centre of the pressure on the resting face, (2,); its middle where nothing presses."""
        pressure = self.traction_mpa[..., 2]
        total = pressure.sum() or 1.0
        return np.array([(pressure @ self.x_mm).sum(), (self.y_mm @ pressure).sum()]) / total

    @property
    def force_n(self) -> Array:
        """Its integral, (3,)."""
        return np.asarray(self.traction_mpa.sum(axis=(0, 1), dtype=float) * self.cell_mm2)

    @property
    def torque_nmm(self) -> Array:
        """Its moment about the centre of the resting face, (3,), taken on the resting face."""
        tx, ty, tz = np.moveaxis(self.traction_mpa, -1, 0)
        x, y = self.x_mm, self.y_mm[:, None]
        moments = [(y * tz).sum(), -(x * tz).sum(), (x * ty - y * tx).sum()]
        return np.array(moments) * self.cell_mm2


MAX_LEVERAGE_RATIO = (
    2.0  # times the largest leverage in training, beyond which a frame is extrapolated
)


class Features(ABC):
    """A few numbers of a frame that the force on the sensor is linear in.

    name: as registered. names: a label for each of the k numbers, unit included. explains: the
    labels that each of COMPONENTS is fitted by. held: labels whose coefficients few presses could
    not tell: this times the size of the component's first feature is the prior of `least_squares`.
    rests_on_gel: whether more of the view than its camera matters. local: they say where on the
    face the force is.
    """

    name: str
    names: tuple[str, ...]
    explains: Mapping[str, tuple[str, ...]]
    prior_scales: Mapping[str, float] = MappingProxyType({})
    rests_on_gel = False
    local = False

    @abstractmethod
    def compute(self, flow: FaceFlow) -> Array:
        """Of a flow at EVERY_PX, (k,) float64: finite, 0 at rest or where nothing is known."""

    def cover(self, flow: FaceFlow) -> float:
        """Share of what the numbers rest on whose motion is known."""
        return flow.cover

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """The force's distribution by a model that was fitted to these; of `local` ones."""
        raise NotImplementedError(self.name)


@dataclass(frozen=True)
class ForceModel:
    """Linear model: wrench = coefficients x features, and how far its training reaches.

    features: name of the set; names: its k labels. coefficients (6, k): of COMPONENTS, 0 where a
    component does not use a feature. reach (6, k, m): of each component, what a frame's features
    are multiplied by for the squares to add up to its leverage over the largest in training.
    """

    features: str
    names: tuple[str, ...]
    coefficients: Array
    reach: Array

    @classmethod
    def fit(
        cls, features: Features, X: Array, wrench: Array, presses: Sequence[str] = ()
    ) -> tuple[ForceModel, dict[str, RegressionFit]]:
        """From features X (n, k) and wrenches (n, 6) in N and N mm; with the six regressions.

        presses (n,): for the regressions' intervals. Raises InputError where `least_squares` does,
        naming the component.
        """
        X, wrench = np.asarray(X, float), np.asarray(wrench, float)
        coefficients = np.zeros((len(WRENCH_AXES), X.shape[1]))
        width = max(map(len, features.explains.values()))
        reach = np.zeros((*coefficients.shape, width))
        fits = {}
        for i, component in enumerate(WRENCH_AXES):
            use = [features.names.index(name) for name in features.explains[component]]
            labels, columns = features.explains[component], X[:, use]
            size = float(np.sqrt(np.mean(columns[:, 0] ** 2)))
            prior = {
                label: size * features.prior_scales[label]
                for label in labels
                if label in features.prior_scales
            }
            try:
                fit = least_squares(columns, wrench[:, i], labels, presses, prior)
            except InputError as error:
                raise InputError(f"force model {features.name}: {component}: {error}") from error
            coefficients[i, use] = fit.coefficients
            reach[i, use, : len(use)] = relative_leverage(columns, fit)
            fits[component] = fit
        return cls(features.name, tuple(features.names), coefficients, reach), fits

    @property
    def calibrated(self) -> Array:
        """(6,) bool: of COMPONENTS, those that ever were other than 0 in training."""
        return np.asarray(self.coefficients.any(axis=1))

    def predict(self, X: Array) -> Array:
        """Wrenches (n, 6), N and N mm, of features (n, k)."""
        return np.asarray(X, float) @ self.coefficients.T

    def is_extrapolated(self, X: Array) -> Array:
        """(n,) bool: some component's features are not like those of its training.

        By their leverage, so that a frame is found whose features are each within their range and
        together unlike any: a light touch where only deep presses were trained, say.
        """
        leverage_terms = np.einsum("nk,ckm->ncm", np.asarray(X, float), self.reach)
        return np.asarray(~((leverage_terms**2).sum(axis=-1) <= MAX_LEVERAGE_RATIO).all(axis=-1))

    def wrench(self, x: Array, cover: float) -> Wrench:
        """Of one frame's features (k,), of which a share is known; nan: not calibrated."""
        six = np.where(self.calibrated, self.predict(x[None])[0], np.nan)
        return Wrench(six[:3], six[3:], cover, bool(self.is_extrapolated(x[None])[0]))

    def as_dict(self) -> dict[str, Any]:
        return {
            "features": self.features,
            "names": list(self.names),
            "coefficients": dict(zip(WRENCH_AXES, self.coefficients.tolist(), strict=True)),
            "reach": dict(zip(WRENCH_AXES, self.reach.tolist(), strict=True)),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ForceModel:
        """What `as_dict` gave. Raises InputError, with the key, for what cannot be one."""
        try:
            names = tuple(map(str, data["names"]))
            coefficients, reach = (
                np.array([data[key][component] for component in WRENCH_AXES], float)
                for key in ("coefficients", "reach")
            )
            model = cls(str(data["features"]), names, coefficients, reach)
        except KeyError as error:
            raise InputError(f"force model: {error.args[0]}: missing") from error
        except (TypeError, ValueError) as error:
            raise InputError(
                f"force model: not numbers, or not as many as names: {error}"
            ) from error
        shape = (len(WRENCH_AXES), len(names))
        for key, part, dimensions in (("coefficients", coefficients, 2), ("reach", reach, 3)):
            if part.ndim != dimensions or part.shape[:2] != shape or not np.isfinite(part).all():
                raise InputError(f"force model: {key}: {len(names)} finite, one a name, are needed")
        return model
