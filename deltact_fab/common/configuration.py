"""The one base of what stands in a lab's files: protocols, rigs, recipes and lists.

Every number of a table has a lowest and a highest value: what is further out is a slip of the pen.
Limits stand in the annotation (`Field(ge=, le=)`) and the meaning of a key in the docstring below
it. Error lines, `deltact-fab schema`, new files and the reference are all made from `schema_of`.
Dimensions that are computed with are plain records, whose base is `sensor.shapes.bounded.Bounded`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

K = TypeVar("K")
V = TypeVar("V")
TAG_NAMES = ("(value)", "(table)")
"""Tags of a union of a value and a table; a place in a file does not have them."""
OneOrEach = Annotated[
    Annotated[V, Tag(TAG_NAMES[0])] | Annotated[dict[K, V], Field(min_length=1), Tag(TAG_NAMES[1])],
    Discriminator(lambda value: TAG_NAMES[isinstance(value, dict)]),
]
"""One value for every key alike, or a table of values by key."""


class Table(BaseModel):
    """A table: no key but those that it names, no NaN, nothing changed afterwards.

    `json_schema_extra={"instead_of": KEY}` of a key: either it or KEY is given.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class _Schema(GenerateJsonSchema):
    """As a file has it: a key that may be None is one that may be left out.

    The default of a table is an empty one, since the keys inside say theirs.
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
    """What validates a model or a dataclass."""
    return TypeAdapter(model)


@cache
def json_schema_of(model: Any) -> dict[str, Any]:
    """Generate the JSON Schema of a model or a dataclass, to be read only."""
    return adapter(model).json_schema(schema_generator=_Schema)


def resolve_schema(key: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    """Follow the reference of a key to its own schema."""
    target = root["$defs"][key["$ref"].rpartition("/")[2]] if "$ref" in key else {}
    return {**target, **key}


def schema_at(model: Any, path: Sequence[str | int]) -> dict[str, Any]:
    """The schema of the table or value at a place in a file; empty where there is none."""
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
    """A value or a table: the limits of the one, the keys of the other."""
    return {k: v for option in node.get("anyOf", ()) for k, v in option.items()} | node
