"""Indenters by name: a file each family, with SHAPES: names to functions of a scale factor."""

from __future__ import annotations

from collections.abc import Callable

from deltact_fab.common import collect_entries

from ..rigid import Indenter

SHAPE_FACTORIES: dict[str, Callable[[float], Indenter]] = collect_entries(__package__, "SHAPES")
"""Each takes the factor by which its default, 9 mm along its longest side, is scaled."""
