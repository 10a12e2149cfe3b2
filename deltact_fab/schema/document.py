"""JSON Schema of a kind of file, with the meaning of each key, for editors and other programs."""

from __future__ import annotations

import copy
from typing import Any

from ..configuration import schema_of
from .kinds import Kind

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_BASE = "The design, a name or a path, from which this one takes what it does not give itself."
# By the end of a key's name; the longest first: mm_min before min, nmm before mm.
_UNITS = {
    "mm_per_px": "mm/px", "per_m": "1/m", "mm_min": "mm/min", "mm_s2": "mm/s2",
    "electrons": "electrons", "nmm": "N mm", "mpa": "MPa", "ohm": "ohm", "deg": "degrees",
    "mm2": "mm2", "mm": "mm", "um": "um", "px": "px", "hz": "Hz", "ms": "ms", "s": "s", "n": "N",
    "k": "K", "v": "V", "baud": "baud", "dpi": "dots per inch",
}  # fmt: skip


def unit_of(key: str) -> str:
    """The unit of a key as a person writes it; empty for a key without one."""
    for end, unit in _UNITS.items():
        if key.endswith(f"_{end}") or (key == end and len(end) > 2):
            return unit
    return ""


def document(kind: Kind) -> dict[str, Any]:
    """The JSON Schema of a kind, each key's unit behind its meaning."""
    schema = described(kind)
    for node in (schema, *schema.get("$defs", {}).values()):
        for name, key in node["properties"].items():
            key.pop("instead_of", None)
            if (unit := unit_of(name)) and "description" in key:
                key["description"] += f" [{unit}]"
    return {"$schema": DIALECT, **schema, "title": f"deltact-fab: {kind.about}"}


def described(kind: Kind) -> dict[str, Any]:
    """The schema of a kind's model, each meaning one line that ends in a full stop."""
    schema = copy.deepcopy(schema_of(kind.model()))
    for node in (schema, *schema.get("$defs", {}).values()):
        if "description" in node:
            node["description"] = _one_line(node["description"].partition("\n\n")[0])
        for key in node["properties"].values():
            assumed = key.pop("unverified", False)
            if "description" in key:
                said = _one_line(key["description"]).rstrip(".") + "."
                key["description"] = f"{said} Assumed, not measured." if assumed else said
    if kind.name == "design":  # `load_design` takes it away before the model sees the file
        base = {"type": "string", "examples": ["deltact"], "description": _BASE}
        schema["properties"] = {"base": base, **schema["properties"]}
    return schema


def _one_line(text: str) -> str:
    plain = " ".join(text.split())
    return plain[:1].upper() + plain[1:]
