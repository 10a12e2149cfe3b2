"""Checks of one image at rest: kind of pattern, and the sensor's state of health.

State of health compares the unloaded pattern with the one at calibration. It finds a skin that
slipped or was changed, a camera that moved, gel with a permanent set, and failed lights before a
measurement relies on them. A contact at the start looks like a permanent set and is refused too.

On a skin of markers the dense flow is interpolated between them and still trusted, so dense
patterns, markers and blank skins are distinguished first.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, SensorError
from deltact_fab.sensor import CameraModel

from .dots.detect import DetectedDots, find_dots
from .face import FaceFlow, fit_rigid_motion
from .flow.confidence import FINE_PX, TEXTURED_SHARE
from .flow.fused import to_gray
from .flow.tracker import FlowTracker

# Beyond these a calibrated force exceeds its stated error (decision 0026).
MAX_SHIFT_MM = 0.3
MAX_TURN_DEG = 1.0
MIN_MATCHED = 0.9
MIN_BRIGHTNESS, MAX_BRIGHTNESS = 0.4, 1.6
MIN_CONTRAST_RATIO = 0.4
_BLOCK_PX = 32  # by hand: smaller blocks hold too few patches, larger ones average the shading
_RIM_NODES = 4  # by hand: never confident at the edge, as their windows are cut


@dataclass(frozen=True)
class Health:
    """Changes since the calibration, and whether they are within limits.

    shift_mm (x, y) and turn_deg: of the whole pattern, about the view's centre. deformation_mm:
    root mean square of the residual, deformation_peak_mm: its 99th percentile. brightness,
    contrast: current over calibration, medians over blocks. matched_share: fraction of the pattern
    matched. reasons: objections to use, a phrase each. All but light is None if the pattern was
    not matched at all.
    """

    MAX_DEFORMATION_MM: ClassVar[float] = 0.006  # decision 0026

    shift_mm: tuple[float, float] | None
    turn_deg: float | None
    deformation_mm: float | None
    deformation_peak_mm: float | None
    brightness: float
    contrast: float
    matched_share: float
    reasons: tuple[str, ...]

    @property
    def fit(self) -> bool:
        return not self.reasons

    @property
    def line(self) -> str:
        return "fit to use" if self.fit else f"calibrate again: {'; '.join(self.reasons)}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, including the verdict."""
        return {"fit": self.fit, "verdict": self.line, **asdict(self)}

    @classmethod
    def compare(cls, reference: Array, current: Array, camera: CameraModel) -> Health:
        """Compare an unloaded image with the calibration's, both as tracked.

        reference, current: (h, w, 3) BGR or (h, w) grey, uint8, of the camera's size. Raises
        InputError for another size, and for a reference without texture.
        """
        for name, image in (("the calibration's image", reference), ("the image", current)):
            if image.shape[:2] != (camera.height_px, camera.width_px):
                raise InputError(
                    f"health: {name} is {image.shape[1]} x {image.shape[0]} px, "
                    f"the camera {camera.width_px} x {camera.height_px}"
                )
        tracker = FlowTracker(full=False)
        try:
            first = tracker.update(reference)
        except SensorError as error:
            raise InputError(f"health: the calibration's image: {error}") from error
        observation = tracker.update(current)
        brightness, contrast = _light_ratios(to_gray(reference), to_gray(current))
        flow = FaceFlow.from_flow(observation, camera, spacing_px=FaceFlow.SPACING_PX)
        inner = (slice(_RIM_NODES, -_RIM_NODES), slice(_RIM_NODES, -_RIM_NODES))
        matched = float(np.sum(observation.confident[inner]) / np.sum(first.confident[inner]))
        if not observation.diagnostics.trusted or not flow.known.any():
            reason = "calibration pattern not found: another skin, covered, or dark"
            return cls(None, None, None, None, brightness, contrast, matched, (reason,))
        shift, turn_deg, residual = fit_rigid_motion(flow)
        size = np.linalg.norm(residual, axis=-1)
        rms, peak = float(np.sqrt(np.mean(size**2))), float(np.percentile(size, 99))
        shift_size_mm = float(np.hypot(*shift))
        reasons = []
        if shift_size_mm > MAX_SHIFT_MM:
            reasons.append(f"the pattern moved by {shift_size_mm:.2f} mm (limit {MAX_SHIFT_MM:g})")
        if abs(turn_deg) > MAX_TURN_DEG:
            reasons.append(f"the pattern turned by {turn_deg:.2f} degrees (limit {MAX_TURN_DEG:g})")
        if rms > cls.MAX_DEFORMATION_MM:
            limit = f"(limit {cls.MAX_DEFORMATION_MM:g}): touched, or a permanent set"
            reasons.append(f"the face is deformed by {rms:.3f} mm at rest {limit}")
        if matched < MIN_MATCHED:
            reasons.append(f"{matched:.0%} of the pattern was matched (limit {MIN_MATCHED:.0%})")
        if not MIN_BRIGHTNESS <= brightness <= MAX_BRIGHTNESS:
            limits = f"(limits {MIN_BRIGHTNESS:g} to {MAX_BRIGHTNESS:g})"
            reasons.append(f"brightness is {brightness:.2f} times the calibration's {limits}")
        if contrast < MIN_CONTRAST_RATIO:
            reasons.append(f"contrast fell to {contrast:.0%} (limit {MIN_CONTRAST_RATIO:.0%})")
        return cls(
            (float(shift[0]), float(shift[1])), turn_deg, rms, peak, brightness, contrast, matched,
            tuple(reasons),
        )  # fmt: skip


def _light_ratios(reference: Array, current: Array) -> tuple[float, float]:
    """Return median block ratios, current over reference: brightness, standard deviation."""
    ratios = []
    for image in (reference, current):
        grey = image.astype(np.float32)
        size = (grey.shape[1] // _BLOCK_PX, grey.shape[0] // _BLOCK_PX)
        mean, square = (
            np.asarray(cv2.resize(g, size, interpolation=cv2.INTER_AREA)) for g in (grey, grey**2)
        )
        ratios.append((mean, np.sqrt(np.maximum(square - mean**2, 0))))
    (mean0, std0), (mean1, std1) = ratios
    lit = (mean0 > 1) & (std0 > 1)
    return float(np.median(mean1[lit] / mean0[lit])), float(np.median(std1[lit] / std0[lit]))


PLAIN_GROUND_SHARE = 0.1
"""Detail between dots over their contrast; more is a dense pattern. Measured: three real marker
skins 0.012 to 0.050, the shipped dot pattern 0.004, the dense one with dots 0.26."""


@dataclass(frozen=True)
class RestPattern:
    """Kind of pattern in one image at rest.

    markers: number of dots of one size. between: detail between them over their contrast, infinite
    without dots. lacks: explanation if there is no dense pattern, else empty.
    """

    kind: Literal["dense", "markers", "nothing"]
    markers: int
    between: float
    lacks: str = ""

    @classmethod
    def recognise(cls, image: Array) -> RestPattern:
        """Classify an image (h, w, 3) BGR uint8. Raises InputError as the flow does.

        Markers are recognised here; a dense pattern is what the tracker trusts.
        """
        try:
            diagnostics = FlowTracker(full=False).update(image).diagnostics
            share, trusted = diagnostics.textured_share, diagnostics.trusted
        except SensorError:
            share, trusted = 0.0, False
        try:
            dots = find_dots(image)
            count = len(dots.position_px)
            between = _ground_detail(to_gray(image).astype(np.float32), dots)
        except SensorError:
            count, between = 0, np.inf
        if between <= PLAIN_GROUND_SHARE:
            return cls("markers", count, between, f"no dense pattern: {count} markers")
        if trusted:
            return cls("dense", count, between)
        return cls(
            "nothing",
            count,
            between,
            f"no pattern: {share:.0%} of the first image has texture, "
            f"{TEXTURED_SHARE:.0%} are needed; nothing is trusted",
        )


def _ground_detail(grey: Array, dots: DetectedDots) -> float:
    """Return the robust deviation of the ground from its local mean, over the dots' contrast."""
    ground, xy = np.ones(grey.shape, np.float32), np.round(dots.position_px).astype(int)
    for x, y in xy.tolist():
        cv2.circle(ground, (x, y), int(np.ceil(0.85 * dots.diameter_px)), (0,), -1)

    def spread(side_px: int) -> Array:
        blurred, weight = (cv2.blur(image, (side_px, side_px)) for image in (grey * ground, ground))
        return np.asarray(np.abs(grey - blurred / np.maximum(weight, np.float32(1e-3))))

    detail = spread(FINE_PX)[ground > 0]
    contrast = float(np.median(spread(2 * int(np.ceil(dots.diameter_px)) + 1)[xy[:, 1], xy[:, 0]]))
    return 1.4826 * float(np.median(detail)) / max(contrast, 1.0) if len(detail) else np.inf
