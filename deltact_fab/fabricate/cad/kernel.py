"""Access to the CAD kernel: its import, its exceptions as one line, primitives along z, and
the gate that every solid passes.

The kernel returns wrong shapes without an exception: an empty compound that calls itself valid, an
untouched box in place of a shell, two solids where a hole split the part.
"""

from __future__ import annotations

import importlib
import signal
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from deltact_fab.common import (
    DeltactFabError,
    MissingLibrary,
    Point,
    Point2,
    RunFailed,
    require_extra,
)

Shape: TypeAlias = Any  # cadquery's own; naming them by their class would import it
Workplane: TypeAlias = Any
Extent = tuple[tuple[float, float, float], tuple[float, float, float]]
BOX_TOLERANCE_MM = 1e-5  # by hand: above the kernel's rounding; larger hides a wrong dimension
VOLUME_TOLERANCE = 1e-6  # by hand, relative: above the kernel's rounding; larger hides a lost piece

SYSTEM_PACKAGES = "libgl1 libegl1 libx11-6"
KERNEL_LIBRARIES = ("cadquery", "cadquery-ocp", "ezdxf", "numpy", "scipy", "shapely")
"""Libraries whose versions affect the files and the checks; part of each cache key."""


def require() -> Any:
    """Import cadquery (4 to 6 s the first time) and return the module.

    Raises MissingLibrary naming what to install when a system library or the package is absent
    or broken.
    """
    require_extra("cad", "the CAD kernel", "cadquery")
    # Ctrl-C is raised after the import: the kernel's own modules swallow it meanwhile.
    interrupts: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    if main:
        handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    try:
        return importlib.import_module("cadquery")
    except ImportError as error:
        raise MissingLibrary(
            f"cadquery cannot be imported ({error}): apt-get install --reinstall "
            f"{SYSTEM_PACKAGES}, or pip install --force-reinstall cadquery"
        ) from error
    finally:
        if main:
            signal.signal(signal.SIGINT, handler)
        if interrupts:
            raise KeyboardInterrupt


@contextmanager
def guarded(part: str) -> Iterator[None]:
    """Turn whatever the kernel raises inside into RunFailed naming the part.

    The kernel's exceptions (StdFail_NotDone, Standard_DomainError...) share no base below
    Exception.
    """
    try:
        yield
    except DeltactFabError:
        raise
    except Exception as error:
        first = (str(error).splitlines() or [""])[0]
        kind = type(error).__name__
        raise RunFailed(f"{part}: the CAD kernel failed ({kind}: {first})") from error


def cylinders(
    centres_mm: Sequence[Point2], diameter_mm: float, low_mm: float, length_mm: float
) -> Workplane:
    """Equal cylinders along z from low_mm, upwards where length_mm is positive."""
    plan = require().Workplane().workplane(offset=low_mm).pushPoints(centres_mm)
    return plan.circle(diameter_mm / 2).extrude(length_mm)


def prism(outline_mm: Sequence[Point2], low_mm: float, length_mm: float) -> Workplane:
    """The polygon of these corners, extruded along z."""
    plan = require().Workplane().workplane(offset=low_mm).polyline(outline_mm).close()
    return plan.extrude(length_mm)


def cuboid(box: Extent) -> Workplane:
    """A box from corner to corner."""
    cq = require()
    low, high = box
    size = [b - a for a, b in zip(low, high, strict=True)]
    return cq.Workplane(cq.Solid.makeBox(*size, cq.Vector(*low)))


def without_corners(half_mm: Point2, inner_mm: Point2) -> list[Point2]:
    """Corners of the rectangle +-half_mm with notched corners, counter-clockwise.

    inner_mm: inner edges of the notches in x and y; beyond half_mm there is no notch.
    """
    (w, h), (x, y) = half_mm, inner_mm
    if x >= w or y >= h:
        return [(-w, -h), (w, -h), (w, h), (-w, h)]
    upper = [(w, y), (x, y), (x, h), (-x, h), (-x, y), (-w, y)]
    return upper + [(-a, -b) for a, b in upper]


def around(half_x_mm: float, half_y_mm: float, low_mm: float, high_mm: float) -> Extent:
    """The box about the z axis, from low to high."""
    return (-half_x_mm, -half_y_mm, low_mm), (half_x_mm, half_y_mm, high_mm)


def shifted(box: Extent, by_mm: Point) -> Extent:
    """The box moved."""
    low, high = ((x + by_mm[0], y + by_mm[1], z + by_mm[2]) for x, y, z in box)
    return low, high


def enclosing(boxes: Iterable[Extent]) -> Extent:
    """Return the bounding box of one or more boxes."""
    lows, highs = zip(*boxes, strict=True)
    (x0, y0, z0), (x1, y1, z1) = np.min(lows, axis=0).tolist(), np.max(highs, axis=0).tolist()
    return (x0, y0, z0), (x1, y1, z1)


@dataclass(frozen=True)
class SolidProperties:
    """Volume, area and bounding box of a solid, computed by the kernel."""

    volume_mm3: float
    area_mm2: float
    box_mm: Extent


def gate(part: str, shape: Any, box_mm: Extent) -> tuple[Any, SolidProperties]:
    """Check a shape and return its one Solid with its properties.

    Raises RunFailed naming part and flaw unless the shape is exactly one valid solid with one
    closed shell, and its box within 1e-5 mm of that of its dimensions. The tests compare volumes
    with closed forms.
    """
    if flaw := flaw_of(shape):
        raise RunFailed(f"{part}: {flaw}")
    (solid,) = shape.Solids()
    properties = SolidProperties(float(solid.Volume()), float(solid.Area()), bounding_box(solid))
    if not np.allclose(properties.box_mm, box_mm, rtol=0, atol=BOX_TOLERANCE_MM):
        raise RunFailed(f"{part}: bounding box {properties.box_mm}, expected {box_mm}")
    if not properties.volume_mm3 > 0:
        raise RunFailed(f"{part}: volume {properties.volume_mm3:.6f} mm3; the solid is inside out")
    return solid, properties


def flaw_of(shape: Any) -> str:
    """Describe why a shape is not one valid solid with one closed shell; empty if it is."""
    solids = shape.Solids()
    if len(solids) != 1:
        return f"{len(solids)} solids, expected one"
    if not solids[0].isValid():
        return "invalid (CAD kernel)"
    shells = solids[0].Shells()
    if len(shells) != 1:
        return f"{len(shells)} shells, expected one"
    return "" if shells[0].wrapped.Closed() else "open shell"


def bounding_box(solid: Any) -> Extent:
    """Tight box of the exact surfaces, without the mesh and without the shape's tolerance."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(solid.wrapped, box, False, False)
    box.SetGap(0.0)
    x0, y0, z0, x1, y1, z1 = box.Get()
    return (x0, y0, z0), (x1, y1, z1)
