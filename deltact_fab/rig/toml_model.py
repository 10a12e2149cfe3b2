"""What the tables of a rig file are made of: their base class, and numbers with limits.

Every number has a lowest and a highest value: what is further out is a slip of the pen.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Place = Annotated[float, Field(ge=-10_000, le=10_000)]  # mm
Tilt = Annotated[float, Field(ge=-5, le=5)]  # degrees
Travel = Annotated[float, Field(ge=1, le=10_000)]  # mm
Feed = Annotated[float, Field(ge=1, le=100_000)]  # mm/min
Acceleration = Annotated[float, Field(ge=0.1, le=100_000)]  # mm/s2
Force = Annotated[float, Field(gt=0, le=100_000)]  # N
Torque = Annotated[float, Field(gt=0, le=10_000_000)]  # N mm


class Strict(BaseModel):
    """A table: no key but those that it names, nothing changed afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True)
