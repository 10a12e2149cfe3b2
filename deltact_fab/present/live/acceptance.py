"""Acceptance: check of a finished sensor's images against its design, before the first press.

The recipe is rendered as the camera should see it and matched to the mean of the images at rest,
tile by tile: the tiles' positions give place, rotation, scale and tilt, their content blur and
light, and mismatches film damage, bubbles and dust. Rest and step are checked by the tracker and
the state of health of every measurement.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import SensorLedger, encode_png
from deltact_fab.common import (
    Check,
    Field,
    Image,
    InputError,
    Point,
    SensorError,
    disk_errors,
    graded,
    write_files,
)
from deltact_fab.estimate import (
    FaceFlow,
    FlowTracker,
    Health,
    Rectifier,
    SensorModel,
    format_acceptance,
)
from deltact_fab.fabricate import (
    EVEN_LIGHT_SHARE,
    Design,
    FaceFindings,
    PatternRecipe,
    PrintInView,
    illuminance,
    measure_fall,
)
from deltact_fab.sensor import CameraModel, FlatField

from .source import Source, images

# Limits by hand: wider ones accept a sensor that measures worse, narrower ones refuse good ones.
REST_FRAMES = 100
LEAST_FRAMES = 10  # fewest images to estimate noise
BLUR_PATCHES = 0.375  # of a patch: half of the neighbours' contrast remains (MTF50)
LEAST_BLUR_PX = 1.2  # a Bayer filter and its demosaicing alone blur by nearly a pixel
MIN_TILE_AGREEMENT = 0.5  # median correlation with the recipe; other patterns: about 0.3
MAX_TURNED_DEG, MAX_SCALE_ERROR, MAX_KEYSTONE = 3.0, 0.04, 0.06
MIN_WHITE, MAX_WHITE = 0.2, 0.98  # of full scale, linear


@dataclass(frozen=True)
class Acceptance:
    """Result of an acceptance; the worst of rows decides. findings: None for another pattern."""

    source: str
    images: int
    rows: tuple[Check, ...]
    findings: FaceFindings | None
    raw: Image
    """First raw image at rest, (h, w, 3) BGR."""

    @property
    def passed(self) -> bool:
        return not any(row.failed for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Return plain data for `rig accept --json`."""
        return {
            "passed": self.passed, "source": self.source, "images": self.images,
            "checks": [row.as_dict() for row in self.rows],
            "found": None if self.findings is None else asdict(self.findings),
        }  # fmt: skip

    def save(self, model: SensorModel, seed: int, out: Path) -> list[str]:
        """Save an accepted sensor, and its face at rest next to it; return lines of its ledger.

        seed: of a simulated one. Raises InputError for a sensor that was not accepted and for an
        existing file, RunFailed on disk errors.
        """
        if not self.passed:
            raise InputError(f"{self.source}: not accepted, so not saved")
        image, rest = out.with_suffix(".rest.png"), encode_png(self.raw)
        SensorLedger.require_not_accepted(out)
        if image.exists():
            raise InputError(f"{image}: exists; choose another file with -o, or remove it")
        rows = [[row.name, row.value, row.limit] for row in self.rows]
        text = format_acceptance(model, self.source, seed, (image.name, rest), rows)
        with disk_errors(out):
            out.parent.mkdir(exist_ok=True)
        if out.parent != SensorLedger.FOLDER:
            write_files({image: rest, out: text.encode()})
            return []
        write_files({image: rest})
        SensorLedger.add_acceptance(out, text)
        return SensorLedger.add_event(
            "accepted", [self.source], serial=out.stem, id=hashlib.sha256(rest).hexdigest()[:12],
            text=f"{len(rows)} checks", simulated=model.simulated is not None,
        )  # fmt: skip

    def picture(self, camera: CameraModel) -> bytes:
        """Draw the rectified face at rest with the findings on it; return PNG."""
        image = np.ascontiguousarray(Rectifier(camera).view(self.raw), np.uint8)
        findings = self.findings
        for x, y, long_mm in () if findings is None else (*findings.torn, *findings.places):
            centre = camera.rest_px(np.array([x, y])).round().astype(int).tolist()
            reach = round((long_mm / 2 + 0.5) / camera.mm_per_px)
            cv2.circle(image, centre, reach, (255, 255, 255), 5)
            cv2.circle(image, centre, reach, (0, 0, 220), 2)
        return encode_png(image)


def accept_sensor(
    source: Source, recipe: PatternRecipe, design: Design, frames: int = REST_FRAMES
) -> Acceptance:
    """Check a sensor by its images at rest.

    frames: most images used. Raises InputError for a recipe without patches, and the errors of
    `present.live.source.images`.
    """
    if recipe.patch_mm is None or recipe.law == "chessboard":
        raise InputError(f"{recipe.law}: not a dense pattern, so it cannot be recognised")
    camera = source.model.camera
    rest = _RestImages(camera, source.model.flat)
    for frame in islice(images(source, rest_only=True), frames):
        rest.add(frame.image)
    view = rest.mean[..., ::-1] / np.float32(255)
    sticker = PrintInView(recipe, camera)
    compared = sticker.compare(view)
    if compared is None or compared.agreement < MIN_TILE_AGREEMENT:
        row = Check(
            "recipe", "recipe", "", "pattern not recognised", "the recipe's pattern", "fail",
            remedy="check recipe and sensor; uncover the face; switch the light on: guide E, G",
        )  # fmt: skip
        return Acceptance(source.name, rest.count, (row,), None, rest.raw)
    findings = replace(
        compared.findings(design.skin), saturated=rest.saturated, noise_mm=rest.noise_mm,
        rest=rest.changes,
    )  # fmt: skip
    rows = _check_rows(findings, sticker, design, rest.count)
    return Acceptance(source.name, rest.count, rows, findings, rest.raw)


class _RestImages:
    """Images at rest: their mean, saturation and tracked motion."""

    def __init__(self, camera: CameraModel, flat: FlatField | None) -> None:
        self._camera, self._flat = camera, flat
        self._rectifier = Rectifier(camera)
        self._tracker = FlowTracker(full=False)
        self._sum: Field | None = None
        self._flows: list[NDArray[np.float32]] = []
        self._first: Image | None = None
        self.untrackable = ""
        self.count, self.saturated = 0, 0.0
        self.raw: Image = np.zeros((1, 1, 3), np.uint8)

    def add(self, raw: Image) -> None:
        """Add a raw image (h, w, 3) BGR."""
        view = np.asarray(self._rectifier.view(raw), np.uint8)
        full = (raw.max(axis=2) >= 254).astype(np.uint8)
        maps = self._camera.maps()
        if maps is not None and view is not raw:  # cubic interpolation overshoots
            full = np.asarray(cv2.remap(full, *maps, cv2.INTER_NEAREST), np.uint8)
        self.saturated = max(self.saturated, float(full.mean()))
        if self._sum is None:
            self._sum, self.raw = np.zeros(view.shape), raw
        self._sum += view
        self.count += 1
        even = view if self._flat is None else self._flat.apply(view)
        if not self.untrackable:
            try:
                flow = FaceFlow.from_flow(self._tracker.update(even), self._camera, 8)
            except SensorError as error:
                self.untrackable = str(error)
                return
            self._flows.append(np.where(flow.known[..., None], flow.shift_mm, np.nan))
        if self._first is None:
            self._first = even
        self._last = even

    @property
    def mean(self) -> NDArray[np.float32]:
        """Mean image without flat field correction, (h, w, 3) BGR, 0..255."""
        assert self._sum is not None, "a source without an image raises"
        return np.asarray(self._sum / self.count, np.float32)

    @property
    def noise_mm(self) -> float | None:
        """Noise of a point, median over the face; None with too few or untracked images."""
        if self.count < LEAST_FRAMES:
            return None
        spread = np.hypot(*np.moveaxis(np.stack(self._flows[1:]).std(axis=0), -1, 0))
        valid = np.isfinite(spread)
        return float(np.median(spread[valid])) if valid.any() else None

    @property
    def changes(self) -> tuple[str, ...]:
        """Reasons why the first and the last image differ."""
        if self.untrackable:
            return (self.untrackable,)
        if self._first is None or self.count < 2:
            return ()
        return Health.compare(self._first, self._last, self._camera).reasons


def _dark_cut_fall(design: Design) -> float:
    """Least relative fall of the light from side to side with one cut of LEDs dark."""
    x, y = np.meshgrid(*(np.linspace(-side / 2, side / 2, 15) for side in design.optics.view_mm))
    falls = []
    for cut in range(design.light.cuts):
        light = illuminance(design, x, y, dark=cut)
        falls.append(measure_fall(light.ravel() / light.mean(), x.ravel(), y.ravel()))
    return min(falls)


def _check_rows(
    findings: FaceFindings, sticker: PrintInView, design: Design, count: int
) -> tuple[Check, ...]:
    recipe, camera = sticker.recipe, sticker.camera
    x, y = findings.place_mm
    view_mm = np.array(design.optics.view_mm)
    room = (recipe.printed_mm - view_mm) / 2
    if (d := recipe.dots) is not None:
        spans = (d.columns - 1) * d.pitch_x_mm, (d.rows - 1) * d.pitch_y_mm
        room = np.minimum(room, (view_mm - spans - d.diameter_mm) / 2)
    blurs_px = [b for row in findings.blur_px for b in row if b is not None]
    most_px = max(LEAST_BLUR_PX, BLUR_PATCHES * sticker.patch_mm / camera.mm_per_px)
    worst_px, dark = float(np.percentile(blurs_px, 95)), _dark_cut_fall(design)
    edges = ", ".join(f"{mm:g} mm along {side}" for side, mm in findings.edges.items())
    noise, few = findings.noise_mm, count < LEAST_FRAMES
    noise_text = f"{count} images, {LEAST_FRAMES} needed" if few else "not tracked"
    if noise is not None:
        noise_text = f"{1000 * noise:.1f} um over {count} images"
    rows = (
        ("recipe", "recipe", f"found, agreement {findings.agreement:.2f}",
         f">= {MIN_TILE_AGREEMENT:g}", True, ""),
        ("mirror", "mirror", "mirrored" if findings.mirrored else "not mirrored",
         "not mirrored", not findings.mirrored,
         "the print was made for the other side of the film: guide E.1"),
        ("turn", "turn", f"{round(findings.turned_deg, 1) + 0.0:g} degrees",
         f"within {MAX_TURNED_DEG:g} of upright", abs(findings.turned_deg) <= MAX_TURNED_DEG,
         "lay the next sticker square to the frame, or turn the skin base: guide E.5, H.5"),
        ("place", "place", f"centre at ({x:.2f}, {y:.2f}) mm",
         f"within ({room[0]:.2f}, {room[1]:.2f})", abs(x) <= room[0] and abs(y) <= room[1],
         "the view exceeds the sticker or its dots: centre the next one, guide E.5"),
        ("scale", "scale", f"{findings.scale:.3f} of the camera's", f"1 +- {MAX_SCALE_ERROR:g}",
         abs(findings.scale - 1) <= MAX_SCALE_ERROR,
         "film stretched (E.5), skin of another thickness (D.7), or the lens off its height (H.1)"),
        ("tilt", "lens square to the face", f"{100 * findings.keystone:.1f} % larger on one side",
         f"<= {100 * MAX_KEYSTONE:g} %", findings.keystone <= MAX_KEYSTONE,
         "board or plate is tilted: guide H.1, H.3, H.5"),
        ("focus", "focus",
         f"blur {float(np.median(blurs_px)):.1f} px, worst {worst_px:.1f} px",
         f"<= {most_px:.1f} px, half of a patch's contrast", worst_px <= most_px,
         "turn the lens: guide H.5; worse on one side: the lens is tilted, H.1"),
        ("light.level", "light, level", f"white at {100 * findings.level:.0f} % of full scale",
         f"{100 * MIN_WHITE:g} to {100 * MAX_WHITE:g} %", MIN_WHITE <= findings.level <= MAX_WHITE,
         "adjust exposure and gain, or the light's current: guide G"),
        ("light.even", "light, even", f"least {findings.evenness:.2f} of the mean",
         f">= {EVEN_LIGHT_SHARE:g}", findings.evenness >= EVEN_LIGHT_SHARE,
         "check the LEDs and the diffuser: guide G, H.3"),
        ("light.leds", "light, all LEDs",
         f"falls by {100 * findings.one_sided:.0f} % from side to side",
         f"<= {50 * dark:.0f} %, half of one dark cut", findings.one_sided <= dark / 2,
         "LEDs are dark or hidden: guide G, H.3"),
        ("saturation", "saturation", f"{100 * findings.saturated:.2f} % of pixels saturated",
         f"<= {100 * FlatField.max_saturated:g} %", findings.saturated <= FlatField.max_saturated,
         "less exposure; lamp off, notch closed: guide H.7, H.8"),
        ("edges", "edges of the view",
         f"{edges or 'pattern on all four'}; {100 * findings.face_share:.0f} % of the face visible",
         "no frame or edge of the print", not findings.edges,
         "frame or film edge in view: centre the lens (H.1) or the sticker (E.5)"),
        ("film", "film", _list_places(findings.torn, "intact"), "intact", not findings.torn,
         "torn, loose or folded: guide E.6, E.7"),
        ("bubbles", "bubbles, lint, dust", _list_places(findings.places, "none"), "none",
         not findings.places,
         "in the gel: cast again (D.5, D.8); on lens or plate: open and clean (H.3, H.5)"),
        ("noise", "noise at rest", noise_text,
         "not checked" if few else f"<= {1000 * Health.MAX_DEFORMATION_MM:g} um",
         noise is not None and noise <= Health.MAX_DEFORMATION_MM,
         "fix exposure and gain, more light; no vibration or flicker"),
        ("rest", "at rest", "; ".join(findings.rest) or "unchanged", "`health` limits",
         not findings.rest,
         "keep the face untouched; lock exposure, gain and white balance"),
    )  # fmt: skip
    checks = (
        Check(id, name, "", value, limit, graded(passed), remedy=remedy)
        for id, name, value, limit, passed, remedy in rows
    )
    unjudged = {"noise"} if few else ()
    return tuple(replace(c, status="not run") if c.id in unjudged else c for c in checks)


def _list_places(places: Sequence[Point], none: str) -> str:
    """List the first places as text."""
    text = "; ".join(f"{long:g} mm at ({x:g}, {y:g})" for x, y, long in places[:3])
    return (text or none) + (f" and {len(places) - 3} more" if len(places) > 3 else "")
