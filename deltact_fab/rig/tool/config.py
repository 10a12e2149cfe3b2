"""Tools and touch-off of a rig file."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...configuration import Place, Table
from ...errors import InputError
from ...shapes.indenter import parse

Tilt = Annotated[float, Field(ge=-5, le=5)]  # degrees
Millimetres = Annotated[float, Field(ge=-100, le=100)]


class ToolConfig(Table):
    """What is known of one indenter before it is mounted."""

    length_mm: Millimetres = Field(examples=[0.0])
    """How much longer it is than the one that `[stage] origin_machine_mm` was measured with.
    MEASURE with a caliper; a touch-off corrects it within search_mm."""


class TouchConfig(Table):
    """How the face is found after each change of indenter, and when a run goes on.

    Heights count from where the face is expected: `[stage] origin_machine_mm`, and the length of
    the indenter.
    """

    by: Literal["force"] = "force"
    """What tells the contact: the force sensor."""
    at_mm: tuple[Millimetres, Millimetres] = (0.0, 0.0)
    """Where on the face."""
    force_n: float = Field(default=0.1, ge=0.005, le=5)
    """So much is a contact; at least five standard deviations of the sensor's noise, which `rig
    check` finds."""
    feed_mm_min: float = Field(default=30.0, ge=1, le=120)
    """Of the approach; the second one goes step by step."""
    clear_mm: float = Field(default=5.0, ge=0.5, le=50)
    """Height at which the approach begins."""
    search_mm: float = Field(default=3.0, ge=0.1, le=20)
    """The face is looked for within so much of the height expected, and never further down."""
    repeats: int = Field(default=3, ge=1, le=20)
    """How often the face is touched."""
    spread_mm: float = Field(default=0.03, ge=0.001, le=0.5)
    """Between the repeats; more is a loose tool."""
    moved_mm: float = Field(default=0.3, ge=0.01, le=5)
    """A resumed run may find the face at most so much from where the run had it."""

    @model_validator(mode="after")
    def _heights(self) -> Self:
        if self.clear_mm < self.search_mm:
            raise ValueError(
                f"clear_mm: {self.clear_mm:g} is below search_mm = {self.search_mm:g}; the "
                "approach begins above all heights at which the face may be"
            )
        return self


class RegisteredTouch(Table):
    """One touch of a registration."""

    at_mm: tuple[Millimetres, Millimetres]
    machine_mm: tuple[Place, Place, Place]
    spread_mm: float = Field(ge=0, le=10)


class RegistrationFile(Table):
    """What `rig register` wrote: where the face lies, and how that was found."""

    date: str = Field(max_length=64)
    rig: str = Field(max_length=4096)
    indenter: str = Field(max_length=64)
    by: str = Field(max_length=64)
    origin_machine_mm: tuple[Place, Place, Place]
    angle_deg: float = Field(ge=-360, le=360)
    tilt_deg: tuple[Tilt, Tilt]
    residual_mm: float = Field(ge=0, le=10)
    jig_off_mm: tuple[Millimetres, Millimetres] | None = None
    """Of a file that `rig register --jig` wrote."""
    touches: tuple[RegisteredTouch, ...] = Field(min_length=3, max_length=1000)


def named_tools(tools: dict[str, ToolConfig]) -> dict[str, ToolConfig]:
    """The same under the indenters' own names. Raises ValueError for a name that is none."""
    try:
        return {parse(name).name: tool for name, tool in tools.items()}
    except InputError as why:
        raise ValueError(str(why)) from why
