"""Flow to force and shape: closed-form fields, and inputs that must be flagged."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np

from deltact_fab.common import Array
from deltact_fab.estimate import (
    SIGMA_PX,
    FaceFlow,
    ForceModel,
    Hodge,
    SensorModel,
    jacobian_density,
    least_squares,
    make_features,
)
from deltact_fab.sensor import Pinhole, SensorDimensions, axes_mm

from ..engine import Case, CurveSetting, Engine, Flagged, Work

SMOOTH_SIGMA_MM, FINE_SIGMA_MM = 2.0, 0.5  # by hand: wide and narrow features
STRIDES_PX = (1, 2, 4, 8, 16)  # by hand: every pixel to every 16th, by doubling
DENT_PUSH = 0.3  # by hand: determinant from 1.7 to about 0.94, far from folding
DEFAULT_SENSOR = SensorDimensions()
DEFAULT_CAMERA = Pinhole.from_sensor(DEFAULT_SENSOR)
SENSOR_VIEW = SensorModel(DEFAULT_CAMERA, DEFAULT_SENSOR.skin)
VIEW_MM_PER_PX = DEFAULT_CAMERA.mm_per_px


# -- faces whose parts and density are known in closed form ---------------------------------------


@cache
def _pixels() -> tuple[Array, Array]:
    x, y = axes_mm(DEFAULT_CAMERA)
    return x[None], y[:, None]


def face(shift_mm: Array, stride: int) -> FaceFlow:
    """Flow of a shift (h, w, 2), mm, at every camera pixel, averaged by stride."""
    x, y = axes_mm(DEFAULT_CAMERA)
    w, h = len(x) // stride, len(y) // stride
    x, y = (axis[: n * stride].reshape(n, stride).mean(1) for axis, n in ((x, w), (y, h)))
    shift = block_means(shift_mm, stride).astype(np.float32)
    return FaceFlow(shift, np.ones((h, w), bool), x, y)


def block_means(values: Array, stride: int) -> Array:
    """Means of stride x stride blocks."""
    h, w = (side // stride for side in values.shape[:2])
    cells = values[: h * stride, : w * stride].reshape(h, stride, w, stride, *values.shape[2:])
    return np.asarray(cells.mean(axis=(1, 3)))


def _slope(x0: float, y0: float, sigma_mm: float) -> Array:
    """Minus the gradient of a Gaussian, times sigma: 0.6 at most."""
    x, y = _pixels()
    bump = np.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * sigma_mm**2))
    return np.stack(((x - x0) / sigma_mm * bump, (y - y0) / sigma_mm * bump), axis=-1)


@cache
def parts(sigma_mm: float) -> Array:
    """Three fields (3, h, w, 2), mm, for the decomposition: divergence, curl, shift with saddle.

    The first two decay inside the view (to 4e-4 of the peak at the nearest edge at 2 mm).
    """
    x, y = _pixels()
    ones = np.ones(np.broadcast_shapes(x.shape, y.shape))
    turned = _slope(-4.0, 1.0, sigma_mm)
    return np.stack((
        _slope(3.0, -1.0, sigma_mm),
        np.stack((-turned[..., 1], turned[..., 0]), axis=-1),
        np.stack((0.3 + 0.01 * x * ones, -0.2 - 0.01 * y * ones), axis=-1),
    ))  # fmt: skip


def dent(push: float) -> Array:
    """Diverging field (h, w, 2), mm; its determinant at the middle is (1 + push)^2.

    Folds below push = -1.
    """
    return push * SMOOTH_SIGMA_MM * _slope(0.0, 0.0, SMOOTH_SIGMA_MM)


def dent_density(push: float) -> Array:
    """1 / det(I + grad u) of `dent` under a Gaussian of SIGMA_PX, (h, w), in closed form."""
    wide2 = SMOOTH_SIGMA_MM**2 + (SIGMA_PX * VIEW_MM_PER_PX) ** 2  # Gaussians convolve to one
    x, y = _pixels()
    rho2 = x**2 + y**2
    gain = push * (SMOOTH_SIGMA_MM**2 / wide2) ** 2 * np.exp(-rho2 / (2 * wide2))
    return np.asarray(1 / ((1 + gain) * (1 + gain * (1 - rho2 / wide2))))


# -- curves and cases ------------------------------------------------------------------------------


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=float))))


def _parts(sigma_mm: float, stride: int, scratch: Path) -> Work:
    true_parts = parts(sigma_mm)
    field = face(true_parts.sum(axis=0), stride).shift_mm
    expected = np.stack([block_means(part, stride) for part in true_parts])

    def run() -> Array:
        hodge = Hodge(field)
        return np.stack((hodge.d, hodge.r, hodge.h))

    return Work(run, lambda measured: 100 * _rms(measured - expected) / _rms(field))


def _density(stride: int, scratch: Path) -> Work:
    flow = face(dent(DENT_PUSH), stride)
    exact = block_means(dent_density(DENT_PUSH), stride)
    return Work(
        lambda: jacobian_density(flow, VIEW_MM_PER_PX),
        lambda density: 100 * _rms(density.value - exact) / float(np.ptp(exact)),
    )


def curves() -> Sequence[CurveSetting]:
    """Errors over strides of 1 to 16 px."""
    exact = partial(CurveSetting, reference="closed form", reference_error=0.0)
    hodge = [
        exact(f"parts of a flow whose features have sigma {sigma_mm:g} mm", "d, r, h",
              f"every {stride} px", "% of the field, rms", build=partial(_parts, sigma_mm, stride),
              recommended=stride == FaceFlow.SPACING_PX)
        for sigma_mm in (SMOOTH_SIGMA_MM, FINE_SIGMA_MM) for stride in STRIDES_PX
    ]  # fmt: skip
    density = [
        exact("Gaussian density of a dent", "Jacobian", f"every {stride} px", "% of its range, rms",
              build=partial(_density, stride), recommended=stride == FaceFlow.SPACING_PX)
        for stride in STRIDES_PX
    ]  # fmt: skip
    return hodge + density


def _far_and_faint(scratch: Path) -> float:
    """Error of d of a 1e-3 mm dent on a 10 mm shift in float32, %."""
    d = block_means(parts(SMOOTH_SIGMA_MM)[0], 4) * 1e-3
    return 100 * float(np.abs(Hodge((d + 10).astype(np.float32)).d - d).max() / np.abs(d).max())


def _light_touch(scratch: Path) -> float:
    """Force of a light press by a model of deep ones. Raises Flagged if marked extrapolated."""
    rng = np.random.default_rng(0)
    features = make_features("paper", SENSOR_VIEW)
    deep = [features.compute(face(k * dent(DENT_PUSH) + k**2 * parts(SMOOTH_SIGMA_MM)[1], 8))
            for k in np.linspace(0.8, 1, 30)]  # fmt: skip
    model = ForceModel.fit(features, np.stack(deep), rng.normal(size=(30, 6)))[0]
    wrench = model.wrench(features.compute(face(0.3 * dent(DENT_PUSH), 8)), 1.0)
    if wrench.extrapolated:
        raise Flagged("flagged: extrapolated")
    return float(np.abs(wrench.force_n).max())


def _folded(scratch: Path) -> float:
    """Largest density of a folding map. Raises Flagged if marked unreliable."""
    density = jacobian_density(face(dent(-1.6), 2), VIEW_MM_PER_PX)
    if not density.reliable.all():
        raise Flagged(f"flagged: {100 * (1 - density.cover):.0f} % of the density is not reliable")
    return float(density.value.max())


def _wampler(scratch: Path) -> tuple[float, str]:
    """NIST's Wampler 1: y = 1 + x + ... + x^5 at 0 to 20, every coefficient 1."""
    powers = np.arange(21.0)[:, None] ** np.arange(6)
    fit = least_squares(powers, powers.sum(axis=1), [f"x{i}" for i in range(6)])
    max_error = float(np.abs(np.array(fit.coefficients) - 1).max())
    return max_error, f"condition {fit.condition_raw:.0e} raw, {fit.condition_scaled:.0e} scaled"


def cases(quick: bool) -> Sequence[Case]:
    """Inputs outside the models' range, and a NIST regression."""
    return [
        Case("1e-3 mm on a shift of 10 mm: d", "right", _far_and_faint, 2.0, "%"),
        Case("a light touch, deep presses trained on: wrench", "refused", _light_touch,
             says="extrapolated"),
        Case("a map that folds: density", "refused", _folded, says="flagged"),
        Case("regression: Wampler 1", "right", _wampler, 1e-7, "of a coefficient"),
    ]  # fmt: skip


ENGINE = Engine(
    "From flow to force and shape",
    "Hodge parts, Gaussian density, a force model's reach and regression against closed forms.",
    cases,
    curves,
)
