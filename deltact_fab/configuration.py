"""The one base of what stands in a lab's files: protocols, rigs, recipes and lists.

Every number of a table has a lowest and a highest value: what is further out is a slip of the pen.
Limits stand in the annotation (`Field(ge=, le=)`) and the meaning of a key in the docstring below
it; error lines, `deltact-fab schema`, new files and the reference are all made from these.
Dimensions that are computed with are plain records, whose base is `shapes.bounded.Bounded`.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Place = Annotated[float, Field(ge=-10_000, le=10_000)]  # mm, of a frame or a machine


class Table(BaseModel):
    """A table: no key but those that it names, no NaN, nothing changed afterwards."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )
