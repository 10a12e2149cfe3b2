"""Acceptance: a finished sensor's own images against its design, before anything presses on it.

The recipe is drawn as the camera should see it and laid onto the mean of the images at rest, tile
by tile: where the tiles lie tells place, turn, scale and tilt, what they hold tells blur and light,
what they lack tells film, bubbles and dust. Rest and step are told by the tracker and the state of
health that every measurement uses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cad.check.arithmetic import EVEN_SHARE, lit
from ..cad.dimensions import Design
from ..errors import InputError, SensorError
from ..files import disk_errors, write_together
from ..imaging import GAMMA
from ..measure.face import FaceFlow
from ..measure.flow import FlowTracker
from ..measure.health import MAX_DEFORMATION_MM, health
from ..measure.pipeline.measurement import Rectifier
from ..measure.sensor_id import CalibrationSource, Head, SensorId, rest_table
from ..optics import CameraModel, FlatField
from ..optics.flat import FULL_SHARE
from ..patterns.recipe import PatternRecipe
from ..patterns.verify import Image, JudgedRow
from ..record import encode_png
from ..version import VERSION
from .print_in_view import RIM_PX, PrintInView, aligned, luma
from .source import KnownSensor, Source, images

FRAMES = 100
LEAST_FRAMES = 10  # of which noise can be told
TILE_MM = 1.5
BLURS_PX = np.geomspace(0.25, 6.0, 20)
BLUR_PATCHES = 0.375  # of a patch: there half of the contrast of neighbours is left (MTF50)
LEAST_BLUR_PX = 1.2  # a Bayer filter and its demosaicing alone take nearly a pixel
SURE = 0.5  # median correlation of tiles with the recipe; of unlike patterns it is about .3
TILE_FOUND = 0.3  # correlation of a tile with the recipe
TILE_GAIN = 0.15  # contrast of a tile, of the median one
TURN_DEG, SCALE_OFF, KEYSTONE = 3.0, 0.04, 0.06
DARKEST, BRIGHTEST = 0.2, 0.98  # of white, linear
PLACE_MM, PLACE_SIGMA, PLACE_LEAST = 0.25, 7.0, 0.6  # the last is a share of the contrast
LEAST_PLACE_MM = 0.2
WIDE_MM = 2.0  # what differs alike over more is light


@dataclass(frozen=True)
class Acceptance:
    """rows: the worst is the verdict. found: None where the pattern is not the recipe's.

    Of found, in mm of the sensor's frame: turned_deg: of the sticker from where the design has it,
    counter-clockwise as the camera sees it. scale: of the picture, over the camera's. keystone: by
    how much one side of the view is larger than the other. blur_px: standard deviation in each
    tile, rows of y, None where there is no pattern. level: of white, linear, 1 is full. evenness:
    least over mean; one_sided: by how much it falls from side to side, of its mean. edges: what of
    each side shows no pattern. torn, places: (x, y, length) of what lacks pattern at the rim, and
    of what lies before it. noise_mm: of a point of the face; None: not known. rest: what `health`
    says against it.
    """

    source: str
    images: int
    rows: tuple[JudgedRow, ...]
    found: dict[str, Any] | None
    raw: NDArray[np.uint8]
    """The first image at rest, as the camera gave it, (h, w, 3) BGR."""

    @property
    def passed(self) -> bool:
        return all(row.passed for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `rig accept --json` prints it."""
        return {
            "passed": self.passed, "source": self.source, "images": self.images,
            "rows": [asdict(row) for row in self.rows],
            "found": self.found,
        }  # fmt: skip


def accept(
    source: Source, recipe: PatternRecipe, design: Design, frames: int = FRAMES
) -> Acceptance:
    """Judge a sensor by its images at rest.

    frames: so many are looked at, where the source has them. Raises InputError for a recipe without
    patches, and as `live.open.images`.
    """
    if recipe.patch_mm is None or recipe.law == "chessboard":
        raise InputError(f"{recipe.law}: no dense pattern: there is nothing to recognise")
    camera = source.known.camera
    assert camera is not None, "open_source makes sure of it"
    still = _Still(camera, source.known.flat)
    for frame in islice(images(source, rest_only=True), frames):
        still.add(frame.image)
    view = still.mean[..., ::-1] / np.float32(255)
    sticker = PrintInView(recipe, camera)
    placed = sticker.placed(view)
    compared = None if placed is None else _Compared(view, sticker, placed)
    if compared is None or compared.agreement < SURE:
        row = JudgedRow(
            "recipe", "not this recipe's pattern", "the recipe's pattern", False,
            "is it this recipe and sensor, its cover off the face, its light on? Guide E, G",
        )  # fmt: skip
        return Acceptance(source.name, still.count, (row,), None, still.raw)
    found = {**compared.found(design), **still.found()}
    rows = tuple(JudgedRow(*row) for row in _rows(found, sticker, design, still.count))
    return Acceptance(source.name, still.count, rows, found, still.raw)


def save(accepted: Acceptance, known: KnownSensor, seed: int, out: Path) -> None:
    """Keep a sensor that was accepted, and its face at rest beside it.

    seed: of a simulated one. Raises InputError for one that was not accepted and for a file that is
    there already, RunFailed when the disk refuses.
    """
    if not accepted.passed:
        raise InputError(f"{accepted.source}: not accepted: there is nothing to keep")
    head = Head(
        "acceptance", SensorId(known.design, known.serial),
        CalibrationSource((accepted.source,), known.simulated is not None, VERSION,
                          seed if known.simulated else None),
    )  # fmt: skip
    image, rest = out.with_suffix(".rest.png"), encode_png(accepted.raw)
    for file in (out, image):
        if file.exists():
            raise InputError(f"{file}: already there; name another file with -o, or remove it")
    rows = [[row.check, row.found, row.limit] for row in accepted.rows]
    tables = {"rest": rest_table(image.name, rest), "accepted": {"rows": rows}}
    with disk_errors(out):
        out.parent.mkdir(exist_ok=True)
    write_together({image: rest, out: head.toml(tables).encode()})


def picture(accepted: Acceptance, camera: CameraModel) -> bytes:
    """The face at rest as it is tracked, with what was found on it; PNG."""
    image = np.ascontiguousarray(Rectifier(camera).view(accepted.raw), np.uint8)
    found = accepted.found or {"torn": (), "places": ()}
    for x, y, long_mm in (*found["torn"], *found["places"]):
        at = camera.rest_px(np.array([x, y])).round().astype(int).tolist()
        reach = round((long_mm / 2 + 0.5) / camera.mm_per_px)
        cv2.circle(image, at, reach, (255, 255, 255), 5)
        cv2.circle(image, at, reach, (0, 0, 220), 2)
    return encode_png(image)


class _Still:
    """The images at rest: their mean, what is full in them, the motion that the tracker sees."""

    def __init__(self, camera: CameraModel, flat: FlatField | None) -> None:
        self._camera, self._flat = camera, flat
        self._rectifier = Rectifier(camera)
        self._tracker = FlowTracker(full=False)
        self._sum: NDArray[np.float64] | None = None
        self._flows: list[Image] = []
        self._first: NDArray[np.uint8] | None = None
        self.untrackable = ""
        self.count, self.saturated = 0, 0.0
        self.raw: NDArray[np.uint8] = np.zeros((1, 1, 3), np.uint8)

    def add(self, raw: NDArray[np.uint8]) -> None:
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
                flow = FaceFlow.of(self._tracker.update(even), self._camera, 8)
            except SensorError as why:
                self.untrackable = str(why)
                return
            self._flows.append(np.where(flow.known[..., None], flow.shift_mm, np.nan))
        if self._first is None:
            self._first = even
        self._last = even

    @property
    def mean(self) -> Image:
        """Of the images, as the camera's light has them (h, w, 3) BGR, 0..255."""
        assert self._sum is not None, "a source has an image, or it raises"
        return np.asarray(self._sum / self.count, np.float32)

    def found(self) -> dict[str, Any]:
        """What is full, the noise of a point, median over the face, and what moved meanwhile."""
        noise_mm, rest = None, tuple[str, ...]()
        if self.count >= LEAST_FRAMES:
            spread = np.hypot(*np.moveaxis(np.stack(self._flows[1:]).std(axis=0), -1, 0))
            known = np.isfinite(spread)
            noise_mm = float(np.median(spread[known])) if known.any() else None
        if self.untrackable:
            rest = (self.untrackable,)
        elif self._first is not None and self.count > 1:
            rest = health(self._first, self._last, self._camera).reasons
        return {"saturated": self.saturated, "noise_mm": noise_mm, "rest": rest}


class _Tiles:
    """Means over tiles of the view, and what they say of a drawn picture in a seen one."""

    def __init__(self, shape: tuple[int, ...], mm_per_px: float) -> None:
        self.ny, self.nx = (max(3, round(n * mm_per_px / TILE_MM)) for n in shape[:2])
        self._shape = shape
        self.mm = shape[1] * mm_per_px / self.nx, shape[0] * mm_per_px / self.ny
        x, y = ((np.arange(n) + 0.5 - n / 2) * side
                for n, side in zip((self.nx, self.ny), self.mm, strict=True))  # fmt: skip
        self.x_mm, self.y_mm = np.meshgrid(x, y)

    def mean(self, image: Any) -> NDArray[np.float64]:
        """(ny, nx)."""
        return np.asarray(
            cv2.resize(image, (self.nx, self.ny), interpolation=cv2.INTER_AREA), np.float64
        )

    def spread(self, values: NDArray[Any]) -> Image:
        """Values of tiles over the view's pixels."""
        size = (self._shape[1], self._shape[0])
        return np.asarray(cv2.resize(values.astype(np.float32), size), np.float32)

    def compared(self, seen: Image, drawn: Image) -> tuple[NDArray[np.float64], ...]:
        """Correlation, slope and offset of seen over drawn, each (ny, nx)."""
        s, d = self.mean(seen), self.mean(drawn)
        ss, dd, sd = self.mean(seen * seen), self.mean(drawn * drawn), self.mean(seen * drawn)
        var_s, var_d = np.maximum(ss - s * s, 1e-9), np.maximum(dd - d * d, 1e-9)
        slope = (sd - s * d) / var_d
        return (sd - s * d) / np.sqrt(var_s * var_d), slope, s - slope * d


class _Compared:
    """The recipe's print beside what is seen, at each of BLURS_PX: (blurs, ny, nx)."""

    def __init__(self, view: Image, sticker: PrintInView, to_px: NDArray[np.float64]) -> None:
        self.seen, self.sticker, self.to_px = luma(view), sticker, to_px
        self.tiles = tiles = _Tiles(self.seen.shape, sticker.camera.mm_per_px)
        self.drawn = aligned(self.seen, luma(sticker.seen(to_px, RIM_PX)))
        self.blurred = [
            np.asarray(cv2.GaussianBlur(self.drawn, (0, 0), s), np.float32) for s in BLURS_PX
        ]
        self.like, self.slope, self.offset = (
            np.stack(one)
            for one in zip(*(tiles.compared(self.seen, b) for b in self.blurred), strict=True)
        )
        self.agreement = float(np.median(self.like.max(axis=0)))

    def found(self, design: Design) -> dict[str, Any]:
        """What the print shows, by the names of `Acceptance`."""
        camera, tiles, like = self.sticker.camera, self.tiles, self.like
        best = like.argmax(axis=0)
        # Contrast is compared at one blur: a tile without pattern may be like anything very soft.
        usual = self.slope[int(np.median(best))]
        shown = (like.max(axis=0) >= TILE_FOUND) & (usual >= TILE_GAIN * np.median(usual))
        slope, offset = (
            np.take_along_axis(one, best[None], 0)[0] for one in (self.slope, self.offset)
        )
        white = np.clip(slope + offset, 0, None) ** GAMMA
        light = _smooth(white, shown)[shown]
        mean = float(light.mean())
        edges, torn, inside = _missing(~shown, tiles)
        index = tiles.spread(_smooth(best, shown)).round().astype(int)
        slope_px, offset_px = (tiles.spread(_smooth(one, shown)) for one in (slope, offset))
        drawn = np.take_along_axis(np.stack(self.blurred), index[None], 0)[0]
        off, wide = self.seen - (drawn * slope_px + offset_px), round(WIDE_MM / camera.mm_per_px)
        off = np.abs(off - cv2.blur(off, (wide, wide)))
        off = off / np.maximum(slope_px, 1e-3) / self.drawn.std()
        marked = cv2.dilate((~shown & ~inside).astype(np.uint8), np.ones((5, 5), np.uint8))
        # A dot is white beside any ink: its edge depends on light and code, not on dirt.
        without = (tiles.spread(marked) > 0.5) | (self.sticker.dots(self.to_px) > 0)
        way = np.linalg.inv(self.sticker.nominal) @ self.to_px
        half = np.array([camera.width_px, camera.height_px]) * camera.mm_per_px / 2
        scale, keystone = _scales(way, half)
        turn = math.degrees(math.atan2(way[1, 1], way[0, 1])) - 90
        face_mm2 = design.skin.width_mm * design.skin.length_mm
        return {
            "agreement": self.agreement,
            "mirrored": bool(np.linalg.det(way[:2, :2]) < 0),
            "turned_deg": (turn + 180) % 360 - 180,
            "place_mm": tuple(cv2.perspectiveTransform(np.zeros((1, 1, 2)), way)[0, 0].tolist()),
            "scale": scale,
            "keystone": keystone,
            "blur_px": [
                [round(float(b), 2) if there else None for b, there in zip(*row, strict=True)]
                for row in zip(_between(like, best), shown, strict=True)
            ],
            "level": float(np.median(white[shown])),
            "evenness": float(light.min()) / mean,
            "one_sided": _falls(light / mean, tiles.x_mm[shown], tiles.y_mm[shown]),
            "face_share": float(shown.mean() * 4 * half[0] * half[1] / face_mm2),
            "edges": edges,
            "torn": torn,
            "places": _places(off, without, camera.mm_per_px),
        }


def _between(like: NDArray[np.float64], best: NDArray[np.int64]) -> NDArray[np.float64]:
    """The blur in px at the top of the parabola through the best of BLURS_PX and its neighbours."""
    at = np.clip(best, 1, len(BLURS_PX) - 2)
    below, top, above = (np.take_along_axis(like, (at + k)[None], 0)[0] for k in (-1, 0, 1))
    bend = below - 2 * top + above
    move = np.where(bend < 0, 0.5 * (below - above) / np.minimum(bend, -1e-12), 0.0)
    index = at + np.clip(move, -1, 1)
    return np.exp(np.interp(index, np.arange(len(BLURS_PX)), np.log(BLURS_PX)))


def _smooth(values: NDArray[Any], known: NDArray[np.bool_]) -> Image:
    """Values of tiles, those that are not known as the nearest known one; medians of nine."""
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(cv2.medianBlur(values[tuple(nearest)].astype(np.float32), 3), np.float32)


def _falls(share: NDArray[Any], x_mm: NDArray[Any], y_mm: NDArray[Any]) -> float:
    """From one side of the view to the other, beside what falls off alike all round."""
    x, y = x_mm / np.abs(x_mm).max(), y_mm / np.abs(y_mm).max()
    table = np.stack((np.ones_like(x), x, y, x * x, y * y), axis=-1)
    fitted, *_ = np.linalg.lstsq(table, share, rcond=None)
    return float(2 * np.hypot(fitted[1], fitted[2]))


def _one_led_dark(design: Design) -> float:
    """By how much the light then falls from side to side, at the least, of its mean."""
    x, y = np.meshgrid(*(np.linspace(-side / 2, side / 2, 15) for side in design.optics.view_mm))
    falls = []
    for led in range(design.light.led_count):
        light = lit(design, x, y, dark=led)
        falls.append(_falls(light.ravel() / light.mean(), x.ravel(), y.ravel()))
    return min(falls)


def _missing(
    missing: NDArray[np.bool_], tiles: _Tiles
) -> tuple[dict[str, float], tuple[tuple[float, float, float], ...], NDArray[np.bool_]]:
    """Along whole sides, at the rim beside that, and which tiles lie inside."""
    depths, edges = [], {}
    for side, axis, flip in (("-x", 1, 1), ("+x", 1, -1), ("-y", 0, 1), ("+y", 0, -1)):
        lost = np.moveaxis(missing, axis, 0)[::flip].mean(axis=1) >= 0.5
        depths.append(int(np.argmin(np.append(lost, False))))
        if depths[-1]:
            edges[side] = round(depths[-1] * tiles.mm[1 - axis], 1)
    left = slice(depths[2], tiles.ny - depths[3]), slice(depths[0], tiles.nx - depths[1])
    count, labels = cv2.connectedComponents(missing[left].astype(np.uint8))
    rim = np.unique(np.concatenate((labels[[0, -1]].ravel(), labels[:, [0, -1]].ravel())))
    torn, inside = [], np.zeros_like(missing)
    for label in range(1, count):
        here = labels == label
        if label in rim:
            x, y = tiles.x_mm[left][here], tiles.y_mm[left][here]
            size = max(np.ptp(x) + tiles.mm[0], np.ptp(y) + tiles.mm[1])
            torn.append((round(float(x.mean()), 1), round(float(y.mean()), 1), round(size, 1)))
        else:
            inside[left] |= here
    return edges, tuple(torn), inside


def _places(
    off: Image, without: NDArray[np.bool_], mm_per_px: float
) -> tuple[tuple[float, float, float], ...]:
    """Where the view is not what the pattern would be: middle and length, mm; the largest first."""
    size = max(3, round(PLACE_MM / mm_per_px))
    mean = cv2.blur(off, (size, size))
    usual = mean[~without]
    middle = float(np.median(usual))
    limit = middle + PLACE_SIGMA * 1.4826 * float(np.median(np.abs(usual - middle)))
    limit = max(limit, PLACE_LEAST)
    found = (mean > limit) & ~without
    joined = cv2.dilate(found.astype(np.uint8), np.ones((size, size), np.uint8))
    count, _, stats, middles = cv2.connectedComponentsWithStats(joined)
    h, w = off.shape
    places = []
    for k in range(1, count):
        x, y = (middles[k] - ((w - 1) / 2, (h - 1) / 2)) * mm_per_px
        longest = (
            max(stats[k, cv2.CC_STAT_WIDTH], stats[k, cv2.CC_STAT_HEIGHT]) - size
        ) * mm_per_px
        if longest >= LEAST_PLACE_MM:
            places.append((round(float(x), 1), round(float(y), 1), round(float(longest), 1)))
    return tuple(sorted(places, key=lambda place: -place[2]))


def _scales(way: NDArray[np.float64], half_mm: NDArray[np.float64]) -> tuple[float, float]:
    """Of a map in the middle, and by how much one side's is larger than the other's, less 1."""

    def at(x: float, y: float) -> float:
        corners = np.array([[[x, y]], [[x + 0.1, y]], [[x, y + 0.1]]])
        a, b, c = cv2.perspectiveTransform(corners, way)[:, 0]
        return float(math.sqrt(abs(np.linalg.det(np.stack((b - a, c - a))))) / 0.1)

    x, y = half_mm
    ratios = [at(x, 0) / at(-x, 0), at(0, y) / at(0, -y)]
    return at(0, 0), max(max(r, 1 / r) for r in ratios) - 1


def _rows(
    found: dict[str, Any], sticker: PrintInView, design: Design, count: int
) -> list[tuple[str, str, str, bool, str]]:
    recipe, camera = sticker.recipe, sticker.camera
    x, y = found["place_mm"]
    view_mm = np.array(design.optics.view_mm)
    room = (recipe.printed_mm - view_mm) / 2
    if (d := recipe.dots) is not None:
        spans = (d.columns - 1) * d.pitch_x_mm, (d.rows - 1) * d.pitch_y_mm
        room = np.minimum(room, (view_mm - spans - d.diameter_mm) / 2)
    known = [b for row in found["blur_px"] for b in row if b is not None]
    most_px = max(LEAST_BLUR_PX, BLUR_PATCHES * sticker.patch_mm / camera.mm_per_px)
    worst_px, dark = float(np.percentile(known, 95)), _one_led_dark(design)
    lost = ", ".join(f"{mm:g} mm along {side}" for side, mm in found["edges"].items())
    noise, few = found["noise_mm"], count < LEAST_FRAMES
    told = f"{count} images: give {LEAST_FRAMES} or more" if few else "not tracked"
    if noise is not None:
        told = f"{1000 * noise:.1f} um over {count} images"
    return [
        ("recipe", f"found, agreement {found['agreement']:.2f}", f">= {SURE:g}", True, ""),
        ("mirror", "mirrored" if found["mirrored"] else "as it should be", "as the design has it",
         not found["mirrored"], "the print was made for the other side of the film: guide E.1"),
        ("turn", f"{round(found['turned_deg'], 1) + 0.0:g} degrees",
         f"within {TURN_DEG:g} of upright", abs(found["turned_deg"]) <= TURN_DEG,
         "lay the next sticker square to the frame, or turn the skin base: guide E.5, H.5"),
        ("place", f"its middle at ({x:.2f}, {y:.2f}) mm", f"within ({room[0]:.2f}, {room[1]:.2f})",
         abs(x) <= room[0] and abs(y) <= room[1],
         "the view leaves the sticker or its dots: lay the next one in the middle, guide E.5"),
        ("scale", f"{found['scale']:.3f} of the camera's", f"1 +- {SCALE_OFF:g}",
         abs(found["scale"] - 1) <= SCALE_OFF,
         "film stretched (E.5), skin of another thickness (D.7), or the lens off its height (H.1)"),
        ("lens square to the face", f"{100 * found['keystone']:.1f} % larger on one side",
         f"<= {100 * KEYSTONE:g} %", found["keystone"] <= KEYSTONE,
         "board or plate sits askew: guide H.1, H.3, H.5"),
        ("focus", f"blur {float(np.median(known)):.1f} px, worst of the face {worst_px:.1f}",
         f"<= {most_px:.1f} px, half of a patch's contrast", worst_px <= most_px,
         "turn the lens: guide H.5; worse on one side: the lens is tilted, H.1"),
        ("light, level", f"white at {100 * found['level']:.0f} % of full",
         f"{100 * DARKEST:g} to {100 * BRIGHTEST:g} %", DARKEST <= found["level"] <= BRIGHTEST,
         "exposure and gain of the camera; current of the light: guide G"),
        ("light, even", f"least {found['evenness']:.2f} of the mean", f">= {EVEN_SHARE:g}",
         found["evenness"] >= EVEN_SHARE, "look at the LEDs and the diffuser: guide G, H.3"),
        ("light, all LEDs", f"falls by {100 * found['one_sided']:.0f} % from side to side",
         f"<= {50 * dark:.0f} %, half of what one dark LED does", found["one_sided"] <= dark / 2,
         "an LED is dark or hidden: guide G, H.3"),
        ("saturation", f"{100 * found['saturated']:.2f} % of pixels full",
         f"<= {100 * FULL_SHARE:g} %", found["saturated"] <= FULL_SHARE,
         "less exposure; lamp off, notch closed: guide H.7, H.8"),
        ("edges of the view",
         f"{lost or 'pattern on all four'}; {100 * found['face_share']:.0f} % of the face seen",
         "no frame, no end of the print", not found["edges"],
         "the frame or the film's end is in view: lens off the middle (H.1), sticker off it (E.5)"),
        ("film", _named(found["torn"], "whole"), "whole", not found["torn"],
         "torn, loose or folded: guide E.6, E.7"),
        ("bubbles, lint, dust", _named(found["places"], "none"), "none", not found["places"],
         "in the gel: cast again (D.5, D.8); on lens or plate: open and clean (H.3, H.5)"),
        ("noise at rest", told, "not judged" if few else f"<= {1000 * MAX_DEFORMATION_MM:g} um",
         few or (noise is not None and noise <= MAX_DEFORMATION_MM),
         "fix exposure and gain, more light; nothing may shake or flicker"),
        ("at rest", "; ".join(found["rest"]) or "nothing moved", "as `health` has it",
         not found["rest"],
         "let nothing touch the face, and lock exposure, gain and white balance"),
    ]  # fmt: skip


def _named(places: Sequence[tuple[float, float, float]], none: str) -> str:
    """The first places in words."""
    shown = "; ".join(f"{long:g} mm at ({x:g}, {y:g})" for x, y, long in places[:3])
    return (shown or none) + (f" and {len(places) - 3} more" if len(places) > 3 else "")
