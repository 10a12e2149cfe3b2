"""What a part is made from: its dimensions with their meaning and limits. No CAD kernel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

from .design import IndenterDimensions
from .dimensions import Design
from .part import Part


@dataclass(frozen=True)
class Dimension:
    """One independent value. low, high: what it accepts; None where it is no bounded number."""

    key: str
    value: Any
    meaning: str
    low: float | None = None
    high: float | None = None
    unverified: bool = False

    @property
    def row(self) -> tuple[str, str, str, str]:
        """Key, value, limits and meaning for a table; numbers with six digits."""
        key = self.key + (" (unverified)" if self.unverified else "")
        limits = "" if self.low is None else f"{self.low:g} to {self.high:g}"
        if isinstance(self.value, dict):
            lengths = ", ".join(f"{name} {number}" for name, number in self.value.items())
            return key, "", "", f"{self.meaning}: {lengths}"
        value = f"{self.value:.6g}" if isinstance(self.value, float) else str(self.value)
        return key, value, limits, self.meaning


def dimensions(part: Part, design: Design) -> Iterator[Dimension]:
    """Everything that the part is made from, also where a rule is broken: then one looks."""
    if part.indenter is not None:
        yield from _of_indenter(part.indenter)
        return
    unverified = design.unverified()
    for section in part.sections:
        record = getattr(design, section)
        for f in fields(record):
            key, meta = f"{section}.{f.name}", f.metadata
            about = (meta.get("description", ""), meta.get("ge"), meta.get("le"), key in unverified)
            yield Dimension(key, getattr(record, f.name), *about)


def _of_indenter(dims: IndenterDimensions) -> Iterator[Dimension]:
    shape = dims.indenter
    yield Dimension("plate_mm", dims.body.plate_mm, "back plate")
    yield Dimension("stem_diameter_mm", shape.stem_diameter_mm, "stem, for the tool holder")
    yield Dimension("stem_length_mm", shape.stem_length_mm, "stem above the plate")
    yield Dimension("reach_mm", shape.reach_mm, "free length of the tips below the plate")
    for number, tip in enumerate(shape.tips, 1):
        kind = type(tip).__name__.removesuffix("Tip").lower()
        yield Dimension(f"tip{number}", asdict(tip), kind)
