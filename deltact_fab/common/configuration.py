"""Base class of the tables in a lab's files: protocols, rigs, recipes and lists.

Every number has a lower and an upper limit, to catch slips. Limits are in the annotation
(`Field(ge=, le=)`), the meaning of a key in the docstring below it. Error messages, `deltact-fab
schema`, new files and the reference are generated from `json_schema_of`. Dimensions used in
computations are plain records based on `sensor.shapes.bounded.Bounded`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

MapKey = TypeVar("MapKey")
MapValue = TypeVar("MapValue")
TAG_NAMES = ("(value)", "(table)")
"""Tags of a union of a value and a table; removed from key paths in messages."""
OneOrEach = Annotated[
    Annotated[MapValue, Tag(TAG_NAMES[0])]
    | Annotated[dict[MapKey, MapValue], Field(min_length=1), Tag(TAG_NAMES[1])],
    Discriminator(lambda value: TAG_NAMES[isinstance(value, dict)]),
]
"""One value for all keys, or a table of values by key."""


class Table(BaseModel):
    """Frozen table without unknown keys and NaN.

    A key with `json_schema_extra={"instead_of": KEY}` replaces KEY.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class _Schema(GenerateJsonSchema):
    """Schema of files: a key that may be None is optional.

    The default of a table is an empty one, since its keys have their own defaults.
    """

    def nullable_schema(self, schema: Any) -> dict[str, Any]:
        return self.generate_inner(schema["schema"])

    def tagged_union_schema(self, schema: Any) -> dict[str, Any]:
        return {"anyOf": [self.generate_inner(choice) for choice in schema["choices"].values()]}

    def default_schema(self, schema: Any) -> dict[str, Any]:
        inner = self.generate_inner(schema["schema"])
        default = schema.get("default")
        if "default_factory" in schema or hasattr(default, "__pydantic_fields__"):
            return {**inner, "default": {}}
        return inner if default is None else super().default_schema(schema)

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


@cache
def adapter(model: Any) -> TypeAdapter[Any]:
    """Return the cached validator of a model or a dataclass."""
    return TypeAdapter(model)


@cache
def json_schema_of(model: Any) -> dict[str, Any]:
    """Return the JSON Schema of a model or a dataclass; do not modify it."""
    return adapter(model).json_schema(schema_generator=_Schema)


def resolve_schema(key: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    """Resolve the `$ref` of a key's schema."""
    target = root["$defs"][key["$ref"].rpartition("/")[2]] if "$ref" in key else {}
    return {**target, **key}


def schema_at(model: Any, path: Sequence[str | int]) -> dict[str, Any]:
    """Return the schema at a key path; empty if there is none."""
    root = node = json_schema_of(model)
    for part in path:
        node = _merge_options(resolve_schema(node, root))
        if isinstance(part, int):
            node = (node.get("prefixItems", [])[part:] or [node.get("items", {})])[0]
        else:
            inside = node.get("properties", {}).get(part, node.get("additionalProperties"))
            node = inside if isinstance(inside, dict) else {}
    return _merge_options(resolve_schema(node, root))


def _merge_options(node: dict[str, Any]) -> dict[str, Any]:
    """Merge the schemas of a union: limits of the value, keys of the table."""
    return {k: v for option in node.get("anyOf", ()) for k, v in option.items()} | node
