"""What one image at rest says: what can be followed in it, and the sensor's state of health.

State of health is the unloaded pattern now, against the one that it was calibrated with. Skin that
slipped or was changed, a camera that moved, gel that took a set, and light that went are told
before a measurement rests on them. A contact at the start looks like a set, and is refused so.

Of a skin of markers the dense flow says what it filled in between them, and calls it trusted: so a
dense pattern, markers and nothing are told apart first.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal

import cv2
import numpy as np

from deltact_fab.common import Array, InputError, SensorError
from deltact_fab.sensor import CameraModel

from .dots.detect import DetectedDots, find_dots
from .face import FaceFlow, rigid
from .flow.confidence import FINE_PX, TEXTURED_SHARE
from .flow.fused import to_gray
from .flow.tracker import FlowTracker

# Beyond these a calibration no longer tells the force within its stated error (decision 0026).
MAX_SHIFT_MM = 0.3
MAX_TURN_DEG = 1.0
MIN_MATCHED = 0.9
MIN_BRIGHTNESS, MAX_BRIGHTNESS = 0.4, 1.6
MIN_CONTRAST = 0.4
_BLOCK_PX = 32
_RIM = 4  # nodes at the image's edge that are never confident: their windows are cut


@dataclass(frozen=True)
class Health:
    """State of health: what changed since the calibration, and whether that may be.

    shift_mm (x, y) and turn_deg: of the whole pattern, about the view's centre. deformation_mm:
    root mean square of what that leaves, deformation_peak_mm: its 99th percentile. brightness,
    contrast: now over then, medians over blocks. matched_share: of the pattern, found again.
    reasons: what speaks against use, a phrase each. All but light is None where the pattern was
    not found again at all.
    """

    MAX_DEFORMATION_MM: ClassVar[float] = 0.006

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
        """Plain data, the verdict in it."""
        return {"fit": self.fit, "verdict": self.line, **asdict(self)}

    @classmethod
    def compare(cls, reference: Array, now: Array, camera: CameraModel) -> Health:
        """Compare an unloaded image with the calibration's, both as they are tracked.

        reference, now: (h, w, 3) BGR or (h, w) grey, uint8, of the camera's size. Raises InputError
        for another size, and for a reference without texture.
        """
        for what, image in (("the calibration's image", reference), ("the image", now)):
            if image.shape[:2] != (camera.height_px, camera.width_px):
                raise InputError(
                    f"health: {what} is {image.shape[1]} x {image.shape[0]} px, "
                    f"the camera {camera.width_px} x {camera.height_px}"
                )
        tracker = FlowTracker(full=False)
        try:
            first = tracker.update(reference)
        except SensorError as why:
            raise InputError(f"health: the calibration's image: {why}") from why
        seen = tracker.update(now)
        brightness, contrast = _light(to_gray(reference), to_gray(now))
        flow = FaceFlow.of(seen, camera, every=FaceFlow.SPACING_PX)
        inner = (slice(_RIM, -_RIM), slice(_RIM, -_RIM))
        matched = float(np.sum(seen.confident[inner]) / np.sum(first.confident[inner]))
        if not seen.diagnostics.trusted or not flow.known.any():
            lost = "the pattern of the calibration was not found: another skin, or covered, or dark"
            return cls(None, None, None, None, brightness, contrast, matched, (lost,))
        shift, turn_deg, left = rigid(flow)
        size = np.linalg.norm(left, axis=-1)
        rms, peak = float(np.sqrt(np.mean(size**2))), float(np.percentile(size, 99))
        moved = float(np.hypot(*shift))
        reasons = []
        if moved > MAX_SHIFT_MM:
            reasons.append(f"the pattern moved by {moved:.2f} mm (limit {MAX_SHIFT_MM:g})")
        if abs(turn_deg) > MAX_TURN_DEG:
            reasons.append(f"the pattern turned by {turn_deg:.2f} degrees (limit {MAX_TURN_DEG:g})")
        if rms > cls.MAX_DEFORMATION_MM:
            limit = f"(limit {cls.MAX_DEFORMATION_MM:g}): touched, or it took a set"
            reasons.append(f"the face is deformed by {rms:.3f} mm at rest {limit}")
        if matched < MIN_MATCHED:
            reasons.append(f"{matched:.0%} of the pattern is found again (limit {MIN_MATCHED:.0%})")
        if not MIN_BRIGHTNESS <= brightness <= MAX_BRIGHTNESS:
            limits = f"(limits {MIN_BRIGHTNESS:g} to {MAX_BRIGHTNESS:g})"
            reasons.append(f"brightness is {brightness:.2f} of what it was {limits}")
        if contrast < MIN_CONTRAST:
            reasons.append(f"contrast is {contrast:.2f} of what it was (limit {MIN_CONTRAST:g})")
        return cls(
            (float(shift[0]), float(shift[1])), turn_deg, rms, peak, brightness, contrast, matched,
            tuple(reasons),
        )  # fmt: skip


def _light(reference: Array, now: Array) -> tuple[float, float]:
    """Medians over blocks of brightness and of standard deviation, now over then."""
    ratios = []
    for image in (reference, now):
        grey = image.astype(np.float32)
        size = (grey.shape[1] // _BLOCK_PX, grey.shape[0] // _BLOCK_PX)
        mean, square = (
            np.asarray(cv2.resize(g, size, interpolation=cv2.INTER_AREA)) for g in (grey, grey**2)
        )
        ratios.append((mean, np.sqrt(np.maximum(square - mean**2, 0))))
    (mean0, std0), (mean1, std1) = ratios
    lit = (mean0 > 1) & (std0 > 1)
    return float(np.median(mean1[lit] / mean0[lit])), float(np.median(std1[lit] / std0[lit]))


PLAIN = 0.1
"""Detail between dots, over their contrast, up to which they are markers. Images of three real
marker skins have 0.012 to 0.050, the shipped dot pattern 0.004, the dense one with dots 0.26."""


@dataclass(frozen=True)
class RestPattern:
    """Pattern that one image at rest shows.

    markers: dots of one size. between: detail between them over their contrast, infinite without
    any. lacks: what a reader who expects a dense pattern must know; empty where there is one.
    """

    kind: Literal["dense", "markers", "nothing"]
    markers: int
    between: float
    lacks: str = ""

    @classmethod
    def recognise(cls, image: Array) -> RestPattern:
        """Recognise it in an image (h, w, 3) BGR uint8. Raises InputError as the flow does.

        Whether there is a dense pattern is the tracker's word; markers are told from it here.
        """
        try:
            said = FlowTracker(full=False).update(image).diagnostics
            share, trusted = said.textured_share, said.trusted
        except SensorError:
            share, trusted = 0.0, False
        try:
            dots = find_dots(image)
            count = len(dots.position_px)
            between = _between(to_gray(image).astype(np.float32), dots)
        except SensorError:
            count, between = 0, np.inf
        if between <= PLAIN:
            return cls("markers", count, between, f"no dense pattern: {count} markers")
        if trusted:
            return cls("dense", count, between)
        return cls(
            "nothing",
            count,
            between,
            f"no pattern: {share:.0%} of the first image has detail to follow, "
            f"{TEXTURED_SHARE:.0%} are needed: nothing is trusted",
        )


def _between(grey: Array, dots: DetectedDots) -> float:
    """Robust deviation of the ground from its means, over the dots' contrast to it."""
    ground, at = np.ones(grey.shape, np.float32), np.round(dots.position_px).astype(int)
    for x, y in at.tolist():
        cv2.circle(ground, (x, y), int(np.ceil(0.85 * dots.diameter_px)), (0,), -1)

    def off(side_px: int) -> Array:
        seen, weight = (cv2.blur(one, (side_px, side_px)) for one in (grey * ground, ground))
        return np.asarray(np.abs(grey - seen / np.maximum(weight, np.float32(1e-3))))

    detail = off(FINE_PX)[ground > 0]
    contrast = float(np.median(off(2 * int(np.ceil(dots.diameter_px)) + 1)[at[:, 1], at[:, 0]]))
    return 1.4826 * float(np.median(detail)) / max(contrast, 1.0) if len(detail) else np.inf
