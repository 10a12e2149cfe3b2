"""The flow methods: endpoint error against exact truth, on frames that the virtual camera draws.

Two motions: a press with shear from the layer solver, and a larger analytic one. Both are drawn by
`virtual.picture`, noise included, and the truth is the displacement field that it drew from. All
of it is synthetic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...measure.flow import (
    DEFAULT_METHOD,
    FLOW_METHODS,
    FlowMethod,
    FlowObservation,
    FlowTracker,
    RenewalRule,
    to_gray,
)
from ...shapes import SensorDimensions
from ...virtual.picture import MARGIN_PX, TOLERANCE_PX
from ..engine import Case, Engine, Flagged, Setting, Work

Gray = NDArray[np.uint8]
Vectors = NDArray[np.float32]
Field = NDArray[np.float64]
SEED = 11
MM_PER_PX = SensorDimensions().optics.mm_per_px
MOVING_MM = 0.1  # as in the tracking error
OFF_MM = 0.1
MOTIONS = {
    "press": "sphere:10, 1.2 mm deep and 1.5 mm of shear",
    "slide": "an analytic motion of 3.3 mm",
    "leap": "an analytic motion of 8.8 mm",
}


class Frames(NamedTuple):
    """A pair and its truth: rest, moved (h, w, 3) BGR; truth_px (h, w, 2); seen: still in view."""

    rest: Gray
    moved: Gray
    truth_px: Vectors
    seen: NDArray[np.bool_]

    def error_mm(self, flow_px: Vectors) -> Vectors:
        """Endpoint error (h, w) in mm at rest."""
        return np.hypot(*np.moveaxis(flow_px - self.truth_px, -1, 0)) * np.float32(MM_PER_PX)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Pixels that are judged: a true motion of at least 0.1 mm that stays in view."""
        size = np.hypot(*np.moveaxis(self.truth_px, -1, 0)) * MM_PER_PX
        return np.asarray(self.seen & (size >= MOVING_MM))

    def mean_error_mm(self, flow_px: Vectors) -> float:
        """Mean endpoint error over the moving pixels."""
        return float(self.error_mm(flow_px)[self.moving].mean(dtype=np.float64))


def frames(scratch: Path, motion: str) -> Frames:
    """The pair of a motion, drawn once a scratch folder."""
    path = scratch / f"flow-{motion}.npz"
    if not path.exists():
        part = path.with_name(f".{path.name}")
        with part.open("wb") as out:
            np.savez(out, **_draw(motion)._asdict())
        part.replace(path)
    with np.load(path) as data:
        return Frames(**{name: data[name] for name in Frames._fields})


def _draw(motion: str) -> Frames:
    from ...gel.linear.layer import BondedLayer
    from ...gel.material import GelMaterial
    from ...imaging import Printer, Sensor
    from ...optics import Pinhole
    from ...patterns.raster import albedo
    from ...patterns.recipe import load_recipe
    from ...virtual.picture import Picture, Texture
    from ...virtual.scene import LatticeCrop

    cv2.setNumThreads(1)
    sensor = SensorDimensions()
    layer = BondedLayer.for_skin(sensor.skin, GelMaterial(), spacing_mm=0.25)
    margin_mm = MARGIN_PX * MM_PER_PX
    view = sensor.optics.view_mm
    crop = LatticeCrop(layer.x_mm, layer.y_mm, (view[0] / 2 + margin_mm, view[1] / 2 + margin_mm))
    xx, yy = np.meshgrid(layer.x_mm, layer.y_mm)
    if motion == "press":
        u = _pressed(layer)
    elif motion == "slide":
        u = _bump(xx, yy, (2.7, 1.35), 5.0)
    else:
        u = _bump(xx, yy, (7.2, 3.6), 8.0)
    on_lattice = crop(u).astype(np.float64)
    rng = np.random.default_rng(SEED)
    printer = Printer()
    printed = printer.print_(albedo(load_recipe("dense-with-dots"), printer.mm_per_dot), rng)
    camera = Pinhole.of(sensor)
    picture = Picture(camera, crop.lattice, Texture(printed, printer.mm_per_dot), Sensor())
    inner = slice(MARGIN_PX, -MARGIN_PX)
    truth = np.ascontiguousarray(picture.forward_px(on_lattice)[inner, inner])
    h, w = truth.shape[:2]
    x, y = (g + truth[..., i] for i, g in enumerate(np.meshgrid(np.arange(w), np.arange(h))))
    seen = (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1)
    return Frames(picture.render(None, rng), picture.render(on_lattice, rng), truth, seen)


def _pressed(layer: Any) -> Field:
    from ...gel.linear.contact import LayerContact
    from ...shapes.indenter import parse

    contact = LayerContact(layer, parse("sphere:10"))
    *_, pressed = contact.path(contact.rest(), (0.0, 0.0, 1.2), 0.3)
    *_, sheared = contact.path(pressed, (1.5, 0.0, 1.2), 0.3)
    return sheared.displacement_mm


def _bump(xx: Field, yy: Field, shift_mm: tuple[float, float], width_mm: float) -> Field:
    """A Gaussian shift with 1 mm of depth at its centre, (ny, nx, 3)."""
    b = np.exp(-(xx**2 + yy**2) / (2 * width_mm**2))
    return np.stack([shift_mm[0] * b, shift_mm[1] * b, -b], axis=-1)


def between(method: str, rest: Gray, moved: Gray, half: bool) -> Vectors:
    """Flow (h, w, 2) px of a grey pair from a cold start, at full or at half resolution."""
    flow = FlowMethod(method)
    if not half:
        return np.asarray(flow.between(rest, moved))
    h, w = rest.shape
    small = [cv2.resize(g, (w // 2, h // 2), interpolation=cv2.INTER_AREA) for g in (rest, moved)]
    wide = cv2.resize(flow.between(*small), (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(wide * np.array([w / (w // 2), h / (h // 2)], np.float32))


def _build(method: str, motion: str, half: bool, scratch: Path) -> Work:
    pair = frames(scratch, motion)
    rest, moved = to_gray(pair.rest), to_gray(pair.moved)
    return Work(lambda: between(method, rest, moved, half), pair.mean_error_mm)


def curves(quick: bool) -> Sequence[Setting]:
    """Every method at full and half resolution, and on two threads at full."""
    out = []
    for motion in ("press",) if quick else ("press", "slide"):
        for series, half, threads in (
            ("full resolution", False, 1),
            ("half resolution", True, 1),
            ("full resolution, two threads", False, 2),
        ):
            for method in ("dis-fast", "dis-medium") if quick else FLOW_METHODS:
                if quick and (half or threads > 1):
                    continue
                out.append(
                    Setting(
                        case=MOTIONS[motion],
                        series=series,
                        name=method,
                        unit="mm, mean over moving pixels",
                        reference="the field that the camera drew",
                        reference_error=TOLERANCE_PX * MM_PER_PX,
                        build=partial(_build, method, motion, half),
                        threads=threads,
                    )
                )
    return out


def _accuracy(method: str, motion: str, half: bool, scratch: Path) -> float:
    pair = frames(scratch, motion)
    return pair.mean_error_mm(between(method, to_gray(pair.rest), to_gray(pair.moved), half))


def _believed(seen: FlowObservation) -> FlowObservation:
    d = seen.diagnostics
    if not d.trusted:
        raise Flagged(f"flagged: {100 * d.bad_share:.0f} % of the blocks do not match")
    return seen


def _silently_off(method: str, motion: str, scratch: Path) -> tuple[float, str]:
    """Share of the pixels marked confident that are off; a frame that is flagged is a refusal."""
    pair = frames(scratch, motion)
    tracker = FlowTracker(method)
    tracker.update(pair.rest)
    seen = _believed(tracker.update(pair.moved))
    judged = seen.confident & seen.visible & pair.seen
    error = pair.error_mm(seen.flow_px)
    share = 100 * seen.diagnostics.confident_share
    return float((error[judged] > OFF_MM).mean()), f"{share:.0f} % of the view is marked confident"


def _unrelated(method: str, make: Callable[[Gray], Gray], scratch: Path) -> float:
    """Second image unrelated to the first: the flow that is believed, mm."""
    rest = frames(scratch, "press").rest
    tracker = FlowTracker(method)
    tracker.update(rest)
    seen = _believed(tracker.update(make(rest)))
    return float(np.hypot(*np.moveaxis(seen.flow_px, -1, 0)).mean() * MM_PER_PX)


def _noise(like: Gray) -> Gray:
    return np.random.default_rng(3).integers(0, 256, like.shape, np.uint8)


def _turned(like: Gray) -> Gray:
    """The same pattern upside down: equal statistics, no common point."""
    return np.ascontiguousarray(like[::-1, ::-1])


def _black(like: Gray) -> Gray:
    return np.zeros_like(like)


def _saturated(like: Gray) -> Gray:
    return np.full_like(like, 255)


def _first(value: int, scratch: Path) -> float:
    shape = frames(scratch, "press").rest.shape
    seen = FlowTracker().update(np.full(shape, value, np.uint8))
    return float(np.abs(seen.flow_px).max())


def _one_frame(scratch: Path) -> float:
    seen = FlowTracker().update(frames(scratch, "press").rest)
    return float(np.abs(seen.flow_px).max())


def _still(method: str, scratch: Path) -> float:
    rest = frames(scratch, "press").rest
    tracker = FlowTracker(method)
    tracker.update(rest)
    flow = _believed(tracker.update(rest)).flow_px
    return float(np.hypot(*np.moveaxis(flow, -1, 0)).max() * MM_PER_PX)


def _overexposed(method: str, scratch: Path) -> tuple[float, str]:
    """Three times the light: most of the pattern is clipped at white."""
    pair = frames(scratch, "press")
    bright = [
        np.clip(image.astype(np.float32) * 3, 0, 255).astype(np.uint8)
        for image in (pair.rest, pair.moved)
    ]
    tracker = FlowTracker(method)
    tracker.update(bright[0])
    flow = _believed(tracker.update(bright[1])).flow_px
    clipped = 100 * float((to_gray(bright[0]) == 255).mean())
    return pair.mean_error_mm(flow), f"{clipped:.0f} % of the pixels are white"


def _other_size(scratch: Path) -> float:
    rest = frames(scratch, "press").rest
    tracker = FlowTracker()
    tracker.update(rest)
    return float(np.abs(tracker.update(rest[:-40]).flow_px).max())


def _method(rest: Callable[[Gray], Any], moved: Callable[[Gray], Any], scratch: Path) -> float:
    gray = to_gray(frames(scratch, "press").rest)
    return float(np.abs(FlowMethod().between(rest(gray), moved(gray))).max())


def _same(gray: Gray) -> Gray:
    return gray


def _threads(method: str, scratch: Path) -> float:
    """Mean difference of the flows on one and on two threads over the moving pixels, mm."""
    pair = frames(scratch, "press")
    grays = to_gray(pair.rest), to_gray(pair.moved)
    cv2.setNumThreads(1)
    one = between(method, *grays, half=False)
    cv2.setNumThreads(2)
    two = between(method, *grays, half=False)
    cv2.setNumThreads(1)
    moved = np.hypot(*np.moveaxis(two - one, -1, 0))[pair.moving]
    return float(moved.mean(dtype=np.float64) * MM_PER_PX)


def cases(quick: bool) -> Sequence[Case]:
    """What no method may answer silently: no texture, no relation, too much motion."""
    out = [
        Case("a first image without texture", "refused", partial(_first, 90), says="texture"),
        Case("a first image all white", "refused", partial(_first, 255), says="texture"),
        Case("one frame alone", "right", _one_frame, 0.0, "px"),
        Case("another image size", "refused", _other_size, says="the first one was"),
        Case("a pair of two sizes", "refused", partial(_method, _same, lambda g: g[:-2]),
             says="one size is needed"),
        Case("an image of 40 px", "refused",
             partial(_method, lambda g: g[:40, :40], lambda g: g[:40, :40]), says="64 px or more"),
        Case("float images", "refused",
             partial(_method, lambda g: g.astype(float), lambda g: g.astype(float)), says="uint8"),
    ]  # fmt: skip
    for method in ("dis-fast",) if quick else FLOW_METHODS:
        out += [
            Case(f"{method}: noise after the pattern", "refused",
                 partial(_unrelated, method, _noise), says="flagged"),
            Case(f"{method}: the pattern upside down", "refused",
                 partial(_unrelated, method, _turned), says="flagged"),
            Case(f"{method}: a black image", "refused", partial(_unrelated, method, _black),
                 says="flagged"),
            Case(f"{method}: a white image", "refused", partial(_unrelated, method, _saturated),
                 says="flagged"),
            Case(f"{method}: nothing moves", "right", partial(_still, method), 0.01, "mm"),
            Case(f"{method}: press, full resolution", "right",
                 partial(_accuracy, method, "press", False), 0.03, "mm"),
            # Half the pixels may cost no more than a doubled error.
            Case(f"{method}: press, half resolution", "right",
                 partial(_accuracy, method, "press", True), 0.06, "mm"),
            Case(f"{method}: press, threefold light", "right or refused",
                 partial(_overexposed, method), 0.06, "mm", "flagged"),
        ]  # fmt: skip
        for motion in () if quick else ("slide", "leap"):
            # A block is believed from an NCC of .7 on, so three tenths of it may be off: that is
            # what the rule promises. The default method is held to a fifteenth of it.
            bound = 0.02 if method == DEFAULT_METHOD else 1 - RenewalRule().ncc_min
            out.append(
                Case(f"{method}: {MOTIONS[motion]}: believed pixels off by 0.1 mm",
                     "right or refused", partial(_silently_off, method, motion), bound,
                     "share off", "flagged")
            )  # fmt: skip
        if not quick:
            out.append(
                Case(f"{method}: two threads against one", "right", partial(_threads, method),
                     0.002, "mm")
            )  # fmt: skip
    return out


ENGINE = Engine(
    "flow",
    "Optical flow",
    "Farneback and Dense Inverse Search between two frames of the virtual camera (simulated), from "
    "a cold start.",
    curves,
    cases,
)
