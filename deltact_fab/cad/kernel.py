"""The way to the CAD kernel: its import, its exceptions turned into one line, and the solids along
z that parts are made of and cut with."""

from __future__ import annotations

import importlib
import re
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from .. import extras
from ..errors import DeltactFabError, MissingLibrary, RunFailed

if TYPE_CHECKING:
    from ..aliases import Point2
    from .solid_gate import Box

Shape: TypeAlias = Any  # cadquery's own; naming them by their class would import it
Workplane: TypeAlias = Any

SYSTEM_PACKAGES = "libgl1 libegl1 libx11-6"
LIBRARIES = ("cadquery", "cadquery-ocp", "ezdxf", "numpy", "scipy", "shapely")
"""Whose versions decide what is made and measured."""


def require() -> Any:
    """Import cadquery (4 to 6 s the first time) and return the module.

    Raises MissingLibrary naming what to install when a system library or the package is absent
    or broken.
    """
    extras.require("cad", "the CAD kernel", "cadquery")
    try:
        with _ctrl_c_after():
            return importlib.import_module("cadquery")
    except ImportError as why:
        raise MissingLibrary(_advice(str(why))) from why


@contextmanager
def _ctrl_c_after() -> Iterator[None]:
    """Ctrl-C comes when the import is over: the kernel's own modules swallow it in between."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    asked: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: asked.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if asked:
            raise KeyboardInterrupt


def _advice(reason: str) -> str:
    """What to install, from what the loader said of the import."""
    named = re.search(r"\blib[\w+-]+\.so[.\d]*", reason)
    broken = re.search(r"file too short|invalid ELF header", reason)
    # A library inside the package is the package's own: the system cannot bring it.
    if named and "site-packages" not in reason:
        if "No such file" in reason:
            return f"cadquery needs {named.group()}: apt-get install {SYSTEM_PACKAGES}"
        if broken:
            return (
                f"cadquery needs {named.group()}, and the one here is broken ({broken.group()}): "
                f"apt-get install --reinstall {SYSTEM_PACKAGES}"
            )
    return f"cadquery cannot be imported ({reason}): pip install --force-reinstall cadquery"


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
    except Exception as why:
        first = (str(why).splitlines() or [""])[0]
        raise RunFailed(f"{part}: the CAD kernel failed ({type(why).__name__}: {first})") from why


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


def cuboid(box: Box) -> Workplane:
    """A box from corner to corner."""
    cq = require()
    low, high = box
    size = [b - a for a, b in zip(low, high, strict=True)]
    return cq.Workplane(cq.Solid.makeBox(*size, cq.Vector(*low)))


def without_corners(half_mm: Point2, inner_mm: Point2) -> list[Point2]:
    """Corners of the rectangle +-half less what lies beyond both inner edges, counter-clockwise.

    The plain rectangle where nothing lies beyond one of them.
    """
    (w, h), (x, y) = half_mm, inner_mm
    if x >= w or y >= h:
        return [(-w, -h), (w, -h), (w, h), (-w, h)]
    upper = [(w, y), (x, y), (x, h), (-x, h), (-x, y), (-w, y)]
    return upper + [(-a, -b) for a, b in upper]
