"""Files made before, found again in the user's cache by everything they were made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ... import cache, digest
from ..dimensions import Design
from ..drafting.title import TitleBlock
from ..part import Part
from ..provenance import libraries, plain
from .part_files import DRAWN, MESHED, FileBytes

KIND = "cad"
# About ten designs at 0.01 mm; the longest unused go first.
LIMIT_BYTES = 512 * 2**20


class Store:
    """The cache as one export sees it. A folder that refuses is tried once and then left alone."""

    def __init__(self, design: Design, tolerance_mm: float, in_use: bool) -> None:
        self._design = design
        self._tolerance_mm = tolerance_mm
        self._reading = self._writing = in_use
        self._grown = False

    def get(self, parts: Sequence[Part], kind: str) -> FileBytes | None:
        """The file of a part, or of an assembly of several, as it was made before; else None."""
        if not self._reading:
            return None
        held = cache.get_file(KIND, self._key(parts, kind))
        if held is None:
            return None
        data, note = held
        low, high = (tuple(corner) for corner in note["box_mm"])
        return FileBytes(kind, data, note["volume_mm3"], (low, high), note["deviation_mm"])

    def put(self, parts: Sequence[Part], made: FileBytes) -> None:
        """Keep a file for the next time."""
        if self._writing:
            note = {
                "volume_mm3": made.volume_mm3,
                "box_mm": made.box_mm,
                "deviation_mm": made.deviation_mm,
            }
            self._writing = cache.put_file(KIND, self._key(parts, made.format), made.data, note)
            self._grown = True

    def trim(self) -> None:
        """Keep the folder within LIMIT_BYTES, if this export made it grow."""
        if self._grown:
            cache.trim(KIND, LIMIT_BYTES)

    def _key(self, parts: Sequence[Part], kind: str) -> dict[str, Any]:
        # What the title block says changes drawings only.
        untitled = replace(self._design, drawing=TitleBlock())
        design = self._design if kind in DRAWN else untitled
        # An indenter is made from its own numbers; its drawing may quote the design's.
        alone = kind not in DRAWN and all(part.indenter is not None for part in parts)
        return {
            "parts": [plain(part) for part in parts],
            "design": None if alone else plain(design),
            "format": kind,
            "tolerance_mm": self._tolerance_mm if kind in MESHED else None,
            "sources": sources(parts),
            "made_by": libraries(),
        }


def sources(parts: Sequence[Part]) -> str:
    """The digest of what makes these parts' solids and files; a Design brings no part's file."""
    builders = {part.build.__module__.removeprefix("deltact_fab.") for part in parts}
    return digest.of("cad.export.part_files", *builders)
