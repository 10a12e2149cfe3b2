"""Features of a frame's flow, and the linear regression from them to the wrench on the sensor.

All nonlinearity is in the features, so a fit is a small least-squares problem, and cross-validation
on stored features is fast.
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

    force_n, torque_nmm (3,) float64, nan where not calibrated. cover: share of the underlying
    points whose motion is known; 0: nothing was tracked and the wrench is 0. extrapolated: the
    calibration's errors do not apply, as the features lie outside the training data or the cover is
    below MIN_COVER.
    """

    force_n: Array
    torque_nmm: Array
    cover: float
    extrapolated: bool


@dataclass(frozen=True)
class TractionField:
    """Traction on the sensor at points of the resting face, (ny, nx, 3) float64, MPa = N / mm2.

    x_mm (nx,), y_mm (ny,): the points, equally spaced, at the centres of cells. cover: as in
    `Wrench`.
    """

    traction_mpa: Array
    x_mm: Array
    y_mm: Array
    cover: float

    @property
    def cell_mm2(self) -> float:
        """Area of a point's cell."""
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
        """Integral of the traction, (3,)."""
        return np.asarray(self.traction_mpa.sum(axis=(0, 1), dtype=float) * self.cell_mm2)

    @property
    def torque_nmm(self) -> Array:
        """Moment (3,) of the traction about the centre of the resting face, acting in its plane."""
        tx, ty, tz = np.moveaxis(self.traction_mpa, -1, 0)
        x, y = self.x_mm, self.y_mm[:, None]
        moments = [(y * tz).sum(), -(x * tz).sum(), (x * ty - y * tx).sum()]
        return np.array(moments) * self.cell_mm2


MIN_COVER = 0.9  # of the points underlying a force or depth; by hand: below, errors pass 5 %
MAX_LEVERAGE_RATIO = 2.0  # over the largest in training; measured in docs/evidence/force.md


class Features(ABC):
    """Features of a frame, in which the force on the sensor is linear.

    name: as registered. names: labels of the k features, with units. explains: the labels that
    each of WRENCH_AXES is fitted by. prior_scales: by label, for coefficients that few presses do
    not determine: times the size of the component's first feature, the prior of `least_squares`.
    rests_on_gel: they depend on the view's gel, not only on its camera. local: they give the
    distribution of the force over the face.
    """

    name: str
    names: tuple[str, ...]
    explains: Mapping[str, tuple[str, ...]]
    prior_scales: Mapping[str, float] = MappingProxyType({})
    rests_on_gel = False
    local = False

    @abstractmethod
    def compute(self, flow: FaceFlow) -> Array:
        """Features (k,) float64 of a flow at SPACING_PX: finite, 0 at rest or where unknown."""

    def cover(self, flow: FaceFlow) -> float:
        """Share of the points underlying the features whose motion is known."""
        return flow.cover

    def traction(self, flow: FaceFlow, model: ForceModel) -> TractionField:
        """Distribution of the force by a model fitted to these features; only if `local`."""
        raise NotImplementedError(self.name)


@dataclass(frozen=True)
class ForceModel:
    """Linear model: wrench = coefficients x features, with the extent of its training data.

    features: name of the set; names: its k labels. coefficients (6, k): of WRENCH_AXES, 0 where a
    component does not use a feature. reach (6, k, m): for each component, a matrix whose product
    with a frame's features has as squared norm its leverage over the largest in training.
    """

    features: str
    names: tuple[str, ...]
    coefficients: Array
    reach: Array

    @classmethod
    def fit(
        cls, features: Features, X: Array, wrench: Array, presses: Sequence[str] = ()
    ) -> tuple[ForceModel, dict[str, RegressionFit]]:
        """Fit to features X (n, k) and wrenches (n, 6) in N and N mm; with the six regressions.

        presses (n,): for the regressions' intervals. Raises InputError as `least_squares`, with
        the component's name.
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
            prior = {x: size * s for x, s in features.prior_scales.items() if x in labels}
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
        """Mask (6,) of WRENCH_AXES that were ever other than 0 in training."""
        return np.asarray(self.coefficients.any(axis=1))

    def predict(self, X: Array) -> Array:
        """Wrenches (n, 6), N and N mm, of features (n, k)."""
        return np.asarray(X, float) @ self.coefficients.T

    def is_extrapolated(self, X: Array) -> Array:
        """Mask (n,) of frames whose features are unlike the training data of some component.

        Uses leverage, so that features each within their range but of an unseen combination are
        detected, such as a light touch after training on deep presses only.
        """
        leverage_terms = np.einsum("nk,ckm->ncm", np.asarray(X, float), self.reach)
        return np.asarray(~((leverage_terms**2).sum(axis=-1) <= MAX_LEVERAGE_RATIO).all(axis=-1))

    def wrench(self, x: Array, cover: float) -> Wrench:
        """Wrench of one frame's features (k,), with their cover; nan: not calibrated."""
        six = np.where(self.calibrated, self.predict(x[None])[0], np.nan)
        extrapolated = cover < MIN_COVER or bool(self.is_extrapolated(x[None])[0])
        return Wrench(six[:3], six[3:], cover, extrapolated)

    def as_dict(self) -> dict[str, Any]:
        return {
            "features": self.features,
            "names": list(self.names),
            "coefficients": dict(zip(WRENCH_AXES, self.coefficients.tolist(), strict=True)),
            "reach": dict(zip(WRENCH_AXES, self.reach.tolist(), strict=True)),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ForceModel:
        """Read the output of `as_dict`. Raises InputError, with the key, for invalid data."""
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
            raise InputError(f"force model: bad numbers, or too few or many: {error}") from error
        shape = (len(WRENCH_AXES), len(names))
        for key, part, dimensions in (("coefficients", coefficients, 2), ("reach", reach, 3)):
            if part.ndim != dimensions or part.shape[:2] != shape or not np.isfinite(part).all():
                raise InputError(f"force model: {key}: needs {len(names)} finite, one per name")
        return model
