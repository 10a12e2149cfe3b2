"""The sensor as a whole: the room it takes, and that no two parts take the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..assembly import PartPlace, places
from .built import BuiltDesign
from .pairs import box_of, shared
from .row import Row

SLACK_MM = 1e-5  # of the kernel's boxes
# Common volume that the kernel leaves between faces that only touch.
TOUCH_MM3 = 1e-3

INTERFERENCE, ENVELOPE = "interference", "envelope"
THREADED = {"screw": "skin-frame", "camera-screw": "camera-holder"}


def envelope(built: BuiltDesign) -> Iterator[Row]:
    """The box around all parts against design.envelope."""
    design = built.design
    boxes = np.array([box_of(built, piece) for piece in _sensor(built)])
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


def _sensor(built: BuiltDesign) -> list[PartPlace]:
    return places(built.design, [part for part in built.parts if part.group == "sensor"])


def _by(*lengths_mm: float) -> str:
    return " x ".join(f"{v:.2f}".rstrip("0").rstrip(".") for v in lengths_mm)


def interference(built: BuiltDesign) -> Iterator[Row]:
    """Common volume of each pair of parts: none, and of a screw in its pilot the thread alone."""
    sensor = _sensor(built)
    pairs = len(sensor) * (len(sensor) - 1) // 2
    clashes: list[tuple[float, str, str]] = []
    for first, second, common_mm3 in shared(built, sensor):
        threaded = any({s, holder} == {first, second} for s, holder in THREADED.items())
        if common_mm3 > TOUCH_MM3 and not threaded:
            text = f"{first} in {second}: {common_mm3:.3f} mm3"
            clashes.append((common_mm3, f"{first}, {second}", text))
    limit = f"<= {TOUCH_MM3:g} mm3 a pair"
    keys = ("camera.lens_diameter_mm", "camera.lens_height_mm", "mount.")
    for _, pair, text in sorted(clashes, reverse=True)[:4]:
        yield Row(INTERFERENCE, pair, text, limit, False, keys)
    if not clashes:
        yield Row(INTERFERENCE, "assembly", f"none in {pairs} pairs", limit, True, keys)
