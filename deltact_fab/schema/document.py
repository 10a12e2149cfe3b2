"""JSON Schema of a kind of file, with the meaning of each key, for editors and other programs."""

from __future__ import annotations

from typing import Any

from .kinds import Kind
from .units import unit_of

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def document(kind: Kind) -> dict[str, Any]:
    """The JSON Schema of a kind. A key that a model lets be None is one that may be left out."""
    schema = described(kind)
    for node in (schema, *schema.get("$defs", {}).values()):
        for name, key in node["properties"].items():
            if (unit := unit_of(name)) and "description" in key:
                key["description"] += f" [{unit}]"
    schema = _without_null(schema)
    return {"$schema": DIALECT, **schema, "title": f"deltact-fab: {kind.about}"}


def described(kind: Kind) -> dict[str, Any]:
    """What pydantic makes of the model, each meaning one line that ends in a full stop."""
    from pydantic import TypeAdapter

    schema: dict[str, Any] = TypeAdapter(kind.model()).json_schema()
    for node in (schema, *schema.get("$defs", {}).values()):
        if "description" in node:
            node["description"] = _one_line(node["description"].partition("\n\n")[0])
        for key in node["properties"].values():
            key.pop("title", None)
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


_BASE = "The design, a name or a path, from which this one takes what it does not give itself."


def resolved(node: dict[str, Any], root: dict[str, Any]) -> tuple[dict[str, Any], bool]:
    """A key's own schema, its reference followed, without null; and whether it may be null."""
    choices = node.get("anyOf", [])
    real = [choice for choice in choices if choice.get("type") != "null"]
    may_be_null = len(real) < len(choices)
    if may_be_null:
        rest = {name: value for name, value in node.items() if name != "anyOf"}
        if rest.get("default", 0) is None:
            del rest["default"]
        node = {**(real[0] if len(real) == 1 else {"anyOf": real}), **rest}
    if "$ref" in node:
        target = root["$defs"][node["$ref"].rpartition("/")[2]]
        node = {**target, **{name: value for name, value in node.items() if name != "$ref"}}
    return node, may_be_null


def _without_null(node: Any) -> Any:
    if isinstance(node, list):
        return [_without_null(one) for one in node]
    if not isinstance(node, dict):
        return node
    choices = node.get("anyOf", [])
    real = [choice for choice in choices if choice.get("type") != "null"]
    node = {name: value for name, value in node.items() if name != "anyOf"}
    if node.get("default", 0) is None:
        del node["default"]
    if isinstance(node.get("default"), dict):  # the keys inside say theirs
        del node["default"]
    if len(real) == 1:
        node = {**real[0], **node}
    elif real:
        node["anyOf"] = real
    return {name: _without_null(value) for name, value in node.items()}
