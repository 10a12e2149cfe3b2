"""One press on the skin, with the discretisation error estimated by a coarser grid."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

from ..errors import DeltactFabError, InputError
from ..shapes import Indenter, SkinDimensions
from .contact import ContactState, LayerContact
from .layer import BondedLayer
from .material import GelMaterial

INCREMENT_MM = 0.1
COARSER = 1.6


def press(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    depth_mm: float,
    shear_mm: tuple[float, float] = (0.0, 0.0),
    spacing_mm: float = 0.2,
) -> dict[str, Any]:
    """Press to a depth, then shear; returns plain data with the keys of `gel press --json`.

    `error_estimate` is the change against a grid COARSER times as wide: discretisation only. What
    linear theory itself leaves out (free sides, large strain) is not in it.
    Raises InputError for values out of range; a refusal or a failure of the solver is in the
    result, `converged` False and `force_n` None.
    """
    if not (math.isfinite(depth_mm) and depth_mm >= 0):
        raise InputError(f"--depth {depth_mm}: a depth in mm, 0 or more, is needed")
    started = time.perf_counter()
    result: dict[str, Any] = {"depth_mm": depth_mm, "model": "layer", "max_stretch": None}
    try:
        fine = _solve(skin, material, indenter, at_mm, depth_mm, shear_mm, spacing_mm)
        coarse = _solve(skin, material, indenter, at_mm, depth_mm, shear_mm, spacing_mm * COARSER)
    except DeltactFabError as why:
        return {
            **result,
            "force_n": None,
            "contact_area_mm2": None,
            "converged": False,
            "error_estimate": None,
            "reason": str(why),
            "seconds": time.perf_counter() - started,
        }
    size = math.dist(fine.force_n, (0.0, 0.0, 0.0))
    change = math.dist(fine.force_n, coarse.force_n)
    peaks = [float(abs(s.displacement_mm).max()) for s in (fine, coarse)]
    return {
        **result,
        "force_n": list(fine.force_n),
        "contact_area_mm2": fine.contact_area_mm2,
        "peak_in_plane_mm": float(abs(fine.displacement_mm[..., :2]).max()),
        "converged": fine.converged,
        "beyond_small_strain": fine.beyond_small_strain,
        "error_estimate": {
            "force_rel": change / size if size else 0.0,
            "displacement_mm": abs(peaks[0] - peaks[1]),
        },
        "seconds": time.perf_counter() - started,
    }


def _solve(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    depth_mm: float,
    shear_mm: tuple[float, float],
    spacing_mm: float,
) -> ContactState:
    layer = BondedLayer.for_skin(skin, material, spacing_mm=spacing_mm)
    contact = LayerContact(layer, indenter, observe_shear=shear_mm != (0.0, 0.0))
    x, y = at_mm
    pressed = _last(contact.path(contact.rest((x, y, 0.0)), (x, y, depth_mm), INCREMENT_MM))
    if depth_mm == 0 or shear_mm == (0.0, 0.0):
        return pressed
    target = (x + shear_mm[0], y + shear_mm[1], depth_mm)
    return _last(contact.path(pressed, target, INCREMENT_MM))


def _last(states: Iterator[ContactState]) -> ContactState:
    """The end of a path; the states before it are not kept."""
    return deque(states, maxlen=1)[0]
