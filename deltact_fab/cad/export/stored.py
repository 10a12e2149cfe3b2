"""Files made before, found again in the user's cache by everything they were made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ... import cache
from ..build import made_by, part_key
from ..dimensions import Design
from ..part import Part
from .part_files import DRAWN, MESHED, FileBytes

KIND = "cad"
# What a drawing says beside its part: limits of its machine, the title block.
BESIDE_DRAWINGS = ("drawing", "resin_printer", "laser", "optics")
# About ten designs at 0.01 mm; the longest unused go first.
LIMIT_BYTES = 512 * 2**20


@dataclass(frozen=True)
class Store:
    """The cache as one export sees it; not in_use: nothing is looked for and nothing kept."""

    design: Design
    tolerance_mm: float
    in_use: bool

    def get(self, parts: Sequence[Part], kind: str) -> FileBytes | None:
        """The file of a part, or of an assembly of several, as it was made before; else None."""
        held = cache.get(KIND, self.key(parts, kind)) if self.in_use else None
        if held is None:
            return None
        low, high = map(tuple, held["box_mm"])
        return FileBytes(**{**held, "box_mm": (low, high)})

    def put(self, parts: Sequence[Part], made: FileBytes) -> None:
        """Keep a file for the next time."""
        if self.in_use:
            cache.put(KIND, self.key(parts, made.format), vars(made), LIMIT_BYTES)

    def key(self, parts: Sequence[Part], kind: str) -> dict[str, Any]:
        """Everything that a file is made from."""
        design, alone = self.design, len(parts) == 1
        beside: Any = None if alone else [part.places(design) for part in parts]
        if kind in DRAWN:
            # The wiring is drawn of the whole design.
            sections = {name: getattr(design, name) for name in BESIDE_DRAWINGS}
            beside = [sections, design.unverified()] if alone else design
        return made_by(
            "cad.export.part_files",
            parts=[part_key(part, design) for part in parts],
            beside=beside,
            format=kind,
            tolerance_mm=self.tolerance_mm if kind in MESHED else None,
        )
