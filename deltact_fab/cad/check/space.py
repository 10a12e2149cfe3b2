"""The sensor as a whole: the room it takes, and that no two parts take the same."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .built import BuiltDesign
from .pairs import PlacedSolid, pieces, shared
from .row import Row
from .screws import grips

SLACK_MM = 1e-5  # of the kernel's boxes
# Common volume that the kernel leaves between faces that only touch.
TOUCH_MM3 = 1e-3

INTERFERENCE, ENVELOPE = "interference", "envelope"
THREADED = {"screw": "skin-frame", "camera-screw": "camera-holder"}


def envelope(built: BuiltDesign) -> Iterator[Row]:
    """The box around all parts against design.envelope."""
    design = built.design
    boxes = np.array([piece.box(built) for piece in _sensor(built)])
    size = boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)
    limit = (design.envelope.width_mm, design.envelope.length_mm, design.envelope.height_mm)
    yield Row(
        ENVELOPE,
        "assembly",
        f"{_by(*size)} mm",
        f"<= {_by(*limit)} mm",
        bool(np.all(size <= np.add(limit, SLACK_MM))),
        ("camera.lens_height_mm", "mount.flange_width_mm", "mount.flange_height_mm"),
    )


def _sensor(built: BuiltDesign) -> list[PlacedSolid]:
    return pieces([part for part in built.parts if part.group == "sensor"], built)


def _by(*lengths_mm: float) -> str:
    return " x ".join(f"{v:.2f}".rstrip("0").rstrip(".") for v in lengths_mm)


def interference(built: BuiltDesign) -> Iterator[Row]:
    """Common volume of each pair of parts: none, and of a screw in its pilot the thread alone."""
    sensor = _sensor(built)
    pairs = len(sensor) * (len(sensor) - 1) // 2
    threads: dict[str, list[float]] = {screw: [] for screw in THREADED}
    clashes: list[tuple[float, str, str]] = []
    for first, second, common_mm3 in shared(built, "in common", sensor):
        screw = next((s for s, holder in THREADED.items() if {s, holder} == {first, second}), "")
        if screw:
            threads[screw].append(common_mm3)
        elif common_mm3 > TOUCH_MM3:
            text = f"{first} in {second}: {common_mm3:.3f} mm3"
            clashes.append((common_mm3, f"{first}, {second}", text))
    limit = f"<= {TOUCH_MM3:g} mm3 a pair"
    keys = ("camera.lens_diameter_mm", "camera.lens_height_mm", "mount.")
    for _, pair, text in sorted(clashes, reverse=True)[:4]:
        yield Row(INTERFERENCE, pair, text, limit, False, keys)
    if not clashes:
        yield Row(INTERFERENCE, "assembly", f"none in {pairs} pairs", limit, True, keys)
    for screw, frame in THREADED.items():
        yield _thread(built, screw, frame, threads[screw])


def _thread(built: BuiltDesign, screw: str, holder: str, found_mm3: list[float]) -> Row:
    """A thread cuts into its pilot: the ring between both diameters over the length that grips."""
    expected = [
        math.pi * (grip.shank_mm**2 - grip.pilot_mm**2) / 4 * grip.engagement_mm
        for grip in grips(built, screw, holder)
    ]
    found = sorted(v for v in found_mm3 if v > TOUCH_MM3)
    right = sorted(v for v in expected if v > TOUCH_MM3)
    passed = len(found) == len(right) > 0 and np.allclose(found, right, rtol=1e-5, atol=TOUCH_MM3)
    return Row(
        "thread in its pilot",
        f"{screw}, {holder}",
        f"{_range(found)} mm3 common, {len(found)} screws",
        f"{_range(right)} mm3, the ring of the thread, {len(right)} screws",
        bool(passed),
    )


def _range(values: list[float]) -> str:
    if not values:
        return "0"
    low, high = min(values), max(values)
    return f"{low:.3f}" if high - low < 5e-4 else f"{low:.3f} to {high:.3f}"
