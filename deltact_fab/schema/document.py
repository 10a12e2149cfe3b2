"""JSON Schema of a kind of file, with the meaning of each key, for editors and other programs."""

from __future__ import annotations

from typing import Any

from .kinds import Kind
from .meanings import meanings, metadata, models
from .units import unit_of

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def document(kind: Kind) -> dict[str, Any]:
    """The JSON Schema of a kind. A key that a model lets be None is one that may be left out."""
    schema = _without_null(described(kind))
    return {"$schema": DIALECT, **schema, "title": f"deltact-fab: {kind.about}"}


def described(kind: Kind) -> dict[str, Any]:
    """What pydantic makes of the model, with meanings and with the limits that records check."""
    from pydantic import TypeAdapter

    model = kind.model()
    schema: dict[str, Any] = TypeAdapter(model).json_schema()
    classes = models(model)
    _describe(schema, model)
    for name, part in schema.get("$defs", {}).items():
        _describe(part, classes[name])
    if kind.name == "design":  # `load_design` takes it away before the model sees the file
        base = {"type": "string", "examples": ["deltact"], "description": _BASE}
        schema["properties"] = {"base": base, **schema["properties"]}
    return schema


_BASE = "The design, a name or a path, from which this one takes what it does not give itself."


def _describe(node: dict[str, Any], model: type) -> None:
    said, extra = meanings(model), metadata(model)
    if "description" in node:
        node["description"] = node["description"].partition("\n\n")[0].replace("\n", " ")
    for name, key in node["properties"].items():
        key.pop("title", None)
        limits = extra.get(name, {})
        if "low" in limits:
            key |= {"minimum": limits["low"], "maximum": limits["high"]}
        if limits.get("choices"):
            key["enum"] = list(limits["choices"])
        if name not in said:
            continue
        unit = unit_of(name)
        assumed = " Assumed, not measured." if limits.get("unverified") else ""
        key["description"] = said[name].rstrip(".") + (f" [{unit}]." if unit else ".") + assumed
        key["x-meaning"] = said[name].rstrip(".") + "." + assumed


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
    node = {name: value for name, value in node.items() if name not in ("anyOf", "x-meaning")}
    if node.get("default", 0) is None:
        del node["default"]
    if isinstance(node.get("default"), dict):  # the keys inside say theirs
        del node["default"]
    if len(real) == 1:
        node = {**real[0], **node}
    elif real:
        node["anyOf"] = real
    return {name: _without_null(value) for name, value in node.items()}
