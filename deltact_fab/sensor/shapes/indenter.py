"""Indenters by name: one definition for height field, footprint and CAD solid.

`sphere:10` is a sphere of 10 mm diameter, `star` the paper's star. `NAME:SIZE` scales an indenter
to another longest side; radii given by the printer (edges, corners, noses) stay. Modules in
`indenters` and a lab's cad/indenters.toml add names.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from typing import Any

from deltact_fab.common import InputError, validate

from .indenters import SHAPE_FACTORIES
from .own import MIN_SHANK_MM, OwnShape, own_shapes
from .rigid import DEFAULT_REACH_MM, Indenter
from .tips import SphereTip

DEFAULT_SIZE_MM = 9.0  # by hand: longest side of a footprint, see `indenters.paper`


def sphere(diameter_mm: float) -> Indenter:
    """Sphere, as in the paper's force calibration (10, 12, 15, 18 and 22 mm)."""
    radius_mm = diameter_mm / 2
    reach_mm = max(DEFAULT_REACH_MM, radius_mm + MIN_SHANK_MM)
    tip = SphereTip(0.0, 0.0, radius_mm)
    return Indenter(f"sphere:{diameter_mm:g}", (tip,), reach_mm=reach_mm)


INDENTER_KINDS = ("sphere", *SHAPE_FACTORIES)


def parse_indenter(name: str) -> Indenter:
    """Parse an indenter's name: `sphere:DIAMETER`, one of INDENTER_KINDS with optional `:SIZE`, or
    a shape of the lab.

    SIZE is the longest side of the footprint in mm, 9 by default. Raises InputError with the
    nearest name or the valid sizes.
    """
    kind, colon, size = name.strip().partition(":")
    if kind == "sphere":
        diameter_mm = _size(size)
        if not 0.5 <= diameter_mm <= 30.0:
            raise InputError(
                f"indenter {name!r}: a sphere takes a diameter of 0.5 to 30 mm, as in 'sphere:10'"
            )
        return sphere(diameter_mm)
    if kind not in SHAPE_FACTORIES:
        lab_shapes = own_shapes()
        if kind in lab_shapes and not colon:
            return lab_shapes[kind].indenter(kind)
        near = difflib.get_close_matches(kind, [*INDENTER_KINDS, *lab_shapes], n=1)
        valid = f"valid: sphere:DIAMETER_MM or (:SIZE_MM optional) {', '.join(SHAPE_FACTORIES)}"
        hint = f"did you mean {near[0]!r}?" if near else valid
        raise InputError(f"indenter {name!r}: unknown; {hint}")
    if not colon:
        return SHAPE_FACTORIES[kind](1.0)
    size_mm = _size(size)
    if not 5.0 <= size_mm <= 20.0:
        raise InputError(
            f"indenter {name!r}: the longest side of its footprint is 5 to 20 mm, as in "
            f"'{kind}:{DEFAULT_SIZE_MM:g}'"
        )
    scaled = SHAPE_FACTORIES[kind](size_mm / DEFAULT_SIZE_MM)
    return scaled if size_mm == DEFAULT_SIZE_MM else replace(scaled, name=f"{kind}:{size_mm:g}")


def describe_indenters(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Describe the lab's own shapes among these, by name, to be stored with a run."""
    custom = [name for name in names if name.partition(":")[0] not in INDENTER_KINDS]
    lab_shapes = own_shapes() if custom else {}
    return {name: asdict(lab_shapes[name]) for name in custom}


def restore_indenter(name: str, lab_shapes: Mapping[str, Any], source: str) -> Indenter:
    """Restore an indenter of a run. lab_shapes: stored with the run, in the file `source`.

    Raises InputError as `parse_indenter`, or naming source.
    """
    if name in lab_shapes:
        return validate(OwnShape, lab_shapes[name], f"{source}: {name}").indenter(name)
    return parse_indenter(name)


def _size(text: str) -> float:
    """Parse a size, rounded as in names, so one name is one shape; NaN if invalid."""
    try:
        return float(f"{float(text):g}")
    except ValueError:
        return math.nan
