"""Acceptance: a finished sensor's own images against its design, before anything presses on it.

The recipe is drawn as the camera should see it and laid onto the mean of the images at rest, tile
by tile: where the tiles lie tells place, turn, scale and tilt, what they hold tells blur and light,
what they lack tells film, bubbles and dust. Rest and step are told by the tracker and the state of
health that every measurement uses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import encode_png
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

FRAMES = 100
LEAST_FRAMES = 10  # of which noise can be told
BLUR_PATCHES = 0.375  # of a patch: there half of the contrast of neighbours is left (MTF50)
LEAST_BLUR_PX = 1.2  # a Bayer filter and its demosaicing alone take nearly a pixel
SURE = 0.5  # median correlation of tiles with the recipe; of unlike patterns it is about 0.3
TURN_DEG, SCALE_OFF, KEYSTONE = 3.0, 0.04, 0.06
DARKEST, BRIGHTEST = 0.2, 0.98  # of white, linear


@dataclass(frozen=True)
class Acceptance:
    """rows: the worst is the verdict. found: None where the pattern is not the recipe's."""

    source: str
    images: int
    rows: tuple[Check, ...]
    found: FaceFindings | None
    raw: Image
    """The first image at rest, as the camera gave it, (h, w, 3) BGR."""

    @property
    def passed(self) -> bool:
        return not any(row.failed for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `rig accept --json` prints it."""
        return {
            "passed": self.passed, "source": self.source, "images": self.images,
            "checks": [row.as_dict() for row in self.rows],
            "found": None if self.found is None else asdict(self.found),
        }  # fmt: skip

    def save(self, known: SensorModel, seed: int, out: Path) -> None:
        """Keep a sensor that was accepted, and its face at rest beside it.

        seed: of a simulated one. Raises InputError for one that was not accepted and for a file
        that is there already, RunFailed when the disk refuses.
        """
        if not self.passed:
            raise InputError(f"{self.source}: not accepted: there is nothing to keep")
        image, rest = out.with_suffix(".rest.png"), encode_png(self.raw)
        for file in (out, image):
            if file.exists():
                raise InputError(f"{file}: already there; name another file with -o, or remove it")
        rows = [[row.name, row.value, row.limit] for row in self.rows]
        text = format_acceptance(known, self.source, seed, (image.name, rest), rows)
        with disk_errors(out):
            out.parent.mkdir(exist_ok=True)
        write_files({image: rest, out: text.encode()})

    def picture(self, camera: CameraModel) -> bytes:
        """The face at rest as it is tracked, with what was found on it; PNG."""
        image = np.ascontiguousarray(Rectifier(camera).view(self.raw), np.uint8)
        found = self.found
        for x, y, long_mm in () if found is None else (*found.torn, *found.places):
            at = camera.rest_px(np.array([x, y])).round().astype(int).tolist()
            reach = round((long_mm / 2 + 0.5) / camera.mm_per_px)
            cv2.circle(image, at, reach, (255, 255, 255), 5)
            cv2.circle(image, at, reach, (0, 0, 220), 2)
        return encode_png(image)


def accept_sensor(
    source: Source, recipe: PatternRecipe, design: Design, frames: int = FRAMES
) -> Acceptance:
    """Judge a sensor by its images at rest.

    frames: so many are looked at, where the source has them. Raises InputError for a recipe without
    patches, and as `present.live.open.images`.
    """
    if recipe.patch_mm is None or recipe.law == "chessboard":
        raise InputError(f"{recipe.law}: no dense pattern: there is nothing to recognise")
    camera = source.known.camera
    still = _Still(camera, source.known.flat)
    for frame in islice(images(source, rest_only=True), frames):
        still.add(frame.image)
    view = still.mean[..., ::-1] / np.float32(255)
    sticker = PrintInView(recipe, camera)
    compared = sticker.compare(view)
    if compared is None or compared.agreement < SURE:
        row = Check(
            "recipe", "recipe", "", "not this recipe's pattern", "the recipe's pattern", "fail",
            remedy="is it this recipe and sensor, its cover off the face, its light on? Guide E, G",
        )  # fmt: skip
        return Acceptance(source.name, still.count, (row,), None, still.raw)
    found = replace(
        compared.findings(design.skin), saturated=still.saturated, noise_mm=still.noise_mm,
        rest=still.unrest,
    )  # fmt: skip
    rows = _rows(found, sticker, design, still.count)
    return Acceptance(source.name, still.count, rows, found, still.raw)


class _Still:
    """The images at rest: their mean, what is full in them, the motion that the tracker sees."""

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
        """One more image (h, w, 3) BGR as the camera gives it."""
        seen = np.asarray(self._rectifier.view(raw), np.uint8)
        full = (raw.max(axis=2) >= 254).astype(np.uint8)
        maps = self._camera.maps()
        if maps is not None and seen is not raw:  # a cubic overshoots, and tells full ones wrongly
            full = np.asarray(cv2.remap(full, *maps, cv2.INTER_NEAREST), np.uint8)
        self.saturated = max(self.saturated, float(full.mean()))
        if self._sum is None:
            self._sum, self.raw = np.zeros(seen.shape), raw
        self._sum += seen
        self.count += 1
        even = seen if self._flat is None else self._flat.apply(seen)
        if not self.untrackable:
            try:
                flow = FaceFlow.from_flow(self._tracker.update(even), self._camera, 8)
            except SensorError as why:
                self.untrackable = str(why)
                return
            self._flows.append(np.where(flow.known[..., None], flow.shift_mm, np.nan))
        if self._first is None:
            self._first = even
        self._last = even

    @property
    def mean(self) -> NDArray[np.float32]:
        """Of the images, as the camera's light has them (h, w, 3) BGR, 0..255."""
        assert self._sum is not None, "a source has an image, or it raises"
        return np.asarray(self._sum / self.count, np.float32)

    @property
    def noise_mm(self) -> float | None:
        """Noise of a point, median over the face; None of too few images, or untracked ones."""
        if self.count < LEAST_FRAMES:
            return None
        spread = np.hypot(*np.moveaxis(np.stack(self._flows[1:]).std(axis=0), -1, 0))
        known = np.isfinite(spread)
        return float(np.median(spread[known])) if known.any() else None

    @property
    def unrest(self) -> tuple[str, ...]:
        """What moved or changed from the first image to the last."""
        if self.untrackable:
            return (self.untrackable,)
        if self._first is None or self.count < 2:
            return ()
        return Health.compare(self._first, self._last, self._camera).reasons


def _one_led_dark(design: Design) -> float:
    """By how much the light then falls from side to side, at the least, of its mean."""
    x, y = np.meshgrid(*(np.linspace(-side / 2, side / 2, 15) for side in design.optics.view_mm))
    falls = []
    for led in range(design.light.led_count):
        light = illuminance(design, x, y, dark=led)
        falls.append(measure_fall(light.ravel() / light.mean(), x.ravel(), y.ravel()))
    return min(falls)


def _rows(
    found: FaceFindings, sticker: PrintInView, design: Design, count: int
) -> tuple[Check, ...]:
    recipe, camera = sticker.recipe, sticker.camera
    x, y = found.place_mm
    view_mm = np.array(design.optics.view_mm)
    room = (recipe.printed_mm - view_mm) / 2
    if (d := recipe.dots) is not None:
        spans = (d.columns - 1) * d.pitch_x_mm, (d.rows - 1) * d.pitch_y_mm
        room = np.minimum(room, (view_mm - spans - d.diameter_mm) / 2)
    known = [b for row in found.blur_px for b in row if b is not None]
    most_px = max(LEAST_BLUR_PX, BLUR_PATCHES * sticker.patch_mm / camera.mm_per_px)
    worst_px, dark = float(np.percentile(known, 95)), _one_led_dark(design)
    lost = ", ".join(f"{mm:g} mm along {side}" for side, mm in found.edges.items())
    noise, few = found.noise_mm, count < LEAST_FRAMES
    told = f"{count} images: give {LEAST_FRAMES} or more" if few else "not tracked"
    if noise is not None:
        told = f"{1000 * noise:.1f} um over {count} images"
    rows = (
        ("recipe", "recipe", f"found, agreement {found.agreement:.2f}", f">= {SURE:g}", True,
         ""),
        ("mirror", "mirror", "mirrored" if found.mirrored else "as it should be",
         "as the design has it", not found.mirrored,
         "the print was made for the other side of the film: guide E.1"),
        ("turn", "turn", f"{round(found.turned_deg, 1) + 0.0:g} degrees",
         f"within {TURN_DEG:g} of upright", abs(found.turned_deg) <= TURN_DEG,
         "lay the next sticker square to the frame, or turn the skin base: guide E.5, H.5"),
        ("place", "place", f"its middle at ({x:.2f}, {y:.2f}) mm",
         f"within ({room[0]:.2f}, {room[1]:.2f})", abs(x) <= room[0] and abs(y) <= room[1],
         "the view leaves the sticker or its dots: lay the next one in the middle, guide E.5"),
        ("scale", "scale", f"{found.scale:.3f} of the camera's", f"1 +- {SCALE_OFF:g}",
         abs(found.scale - 1) <= SCALE_OFF,
         "film stretched (E.5), skin of another thickness (D.7), or the lens off its height (H.1)"),
        ("tilt", "lens square to the face", f"{100 * found.keystone:.1f} % larger on one side",
         f"<= {100 * KEYSTONE:g} %", found.keystone <= KEYSTONE,
         "board or plate sits askew: guide H.1, H.3, H.5"),
        ("focus", "focus",
         f"blur {float(np.median(known)):.1f} px, worst of the face {worst_px:.1f}",
         f"<= {most_px:.1f} px, half of a patch's contrast", worst_px <= most_px,
         "turn the lens: guide H.5; worse on one side: the lens is tilted, H.1"),
        ("light.level", "light, level", f"white at {100 * found.level:.0f} % of full",
         f"{100 * DARKEST:g} to {100 * BRIGHTEST:g} %", DARKEST <= found.level <= BRIGHTEST,
         "exposure and gain of the camera; current of the light: guide G"),
        ("light.even", "light, even", f"least {found.evenness:.2f} of the mean",
         f">= {EVEN_LIGHT_SHARE:g}", found.evenness >= EVEN_LIGHT_SHARE,
         "look at the LEDs and the diffuser: guide G, H.3"),
        ("light.leds", "light, all LEDs",
         f"falls by {100 * found.one_sided:.0f} % from side to side",
         f"<= {50 * dark:.0f} %, half of what one dark LED does", found.one_sided <= dark / 2,
         "an LED is dark or hidden: guide G, H.3"),
        ("saturation", "saturation", f"{100 * found.saturated:.2f} % of pixels full",
         f"<= {100 * FlatField.max_saturated:g} %", found.saturated <= FlatField.max_saturated,
         "less exposure; lamp off, notch closed: guide H.7, H.8"),
        ("edges", "edges of the view",
         f"{lost or 'pattern on all four'}; {100 * found.face_share:.0f} % of the face seen",
         "no frame, no end of the print", not found.edges,
         "the frame or the film's end is in view: lens off the middle (H.1), sticker off it (E.5)"),
        ("film", "film", _named(found.torn, "whole"), "whole", not found.torn,
         "torn, loose or folded: guide E.6, E.7"),
        ("bubbles", "bubbles, lint, dust", _named(found.places, "none"), "none",
         not found.places,
         "in the gel: cast again (D.5, D.8); on lens or plate: open and clean (H.3, H.5)"),
        ("noise", "noise at rest", told,
         "not judged" if few else f"<= {1000 * Health.MAX_DEFORMATION_MM:g} um",
         noise is not None and noise <= Health.MAX_DEFORMATION_MM,
         "fix exposure and gain, more light; nothing may shake or flicker"),
        ("rest", "at rest", "; ".join(found.rest) or "nothing moved", "as `health` has it",
         not found.rest,
         "let nothing touch the face, and lock exposure, gain and white balance"),
    )  # fmt: skip
    checks = (
        Check(id, name, "", value, limit, graded(passed), remedy=remedy)
        for id, name, value, limit, passed, remedy in rows
    )
    unjudged = {"noise"} if few else ()
    return tuple(replace(c, status="not run") if c.id in unjudged else c for c in checks)


def _named(places: Sequence[Point], none: str) -> str:
    """The first places in words."""
    shown = "; ".join(f"{long:g} mm at ({x:g}, {y:g})" for x, y, long in places[:3])
    return (shown or none) + (f" and {len(places) - 3} more" if len(places) > 3 else "")
