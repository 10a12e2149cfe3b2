"""What a sticker is: the law of its patches, their size and seed, and the dots on top.

A recipe is a value: frozen, validated once, written into every file made from it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from .. import catalog
from ..errors import InputError

MAX_PATCHES = 2000
"""Patches along a side: the uniforms of a larger sticker would need more than 100 MB."""

Length = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=200)]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class DotGrid(_Strict):
    """A centred grid of round dots (paper, Pattern Selection: 169 white dots).

    The pitches keep all 13 x 13 dots inside the camera's 30.2 x 22.2 mm view; spread over 35 mm
    the outer ones would leave it.
    """

    columns: Count = 13
    """Dots along x."""
    rows: Count = 13
    """Dots along y."""
    pitch_x_mm: Length = 2.2
    pitch_y_mm: Length = 1.6
    diameter_mm: Length = 0.6
    colour: Annotated[str, Field(pattern=r"^#[0-9a-f]{6}$")] = "#ffffff"
    """`#rrggbb` as sent to the printer. White is no ink: the white layer behind shows through."""

    @model_validator(mode="after")
    def _apart(self) -> DotGrid:
        pitches_mm = [
            pitch_mm
            for pitch_mm, dots in ((self.pitch_x_mm, self.columns), (self.pitch_y_mm, self.rows))
            if dots > 1
        ]
        if pitches_mm and self.diameter_mm >= min(pitches_mm):
            raise ValueError(
                f"diameter_mm must be below the pitch: {self.diameter_mm:g} < "
                f"{min(pitches_mm):g} fails"
            )
        return self

    @property
    def rgb(self) -> tuple[int, int, int]:
        """The colour as three 8-bit values."""
        red, green, blue = bytes.fromhex(self.colour[1:])
        return red, green, blue

    @property
    def half_mm(self) -> tuple[float, float]:
        """Half sides (x, y) of the box around all discs."""
        return (
            ((self.columns - 1) * self.pitch_x_mm + self.diameter_mm) / 2,
            ((self.rows - 1) * self.pitch_y_mm + self.diameter_mm) / 2,
        )


class PatternRecipe(_Strict):
    """A square sticker.

    law `algorithm1` (paper, Algorithm 1) takes patch_mm (d) and r; `dot-matrix` is dots on clear
    film; `transparent` is clear film. Only what a law uses may be given.
    """

    law: Literal["algorithm1", "dot-matrix", "transparent"]
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    size_mm: float = 35.0
    """The side that is asked for; `printed_mm` is the side that whole patches make."""
    patch_mm: Annotated[float | None, Field(validate_default=True)] = None
    """d of the paper."""
    r: Annotated[float | None, Field(validate_default=True)] = None
    """Randomness regulation factor of the paper: least squared difference, values in 0..1."""
    channels: Literal[1, 3] = 3
    """3 draws red, green and blue independently; 1 draws a grey."""
    dots: Annotated[DotGrid | None, Field(validate_default=True)] = None

    # A field sees those above it in info.data, less any that failed: each fault names its own key

    @field_validator("size_mm")
    @classmethod
    def _size(cls, size_mm: float) -> float:
        if not 1 <= size_mm <= 300:  # NaN fails too
            raise ValueError("the side must be 1 to 300 mm")
        return size_mm

    @field_validator("patch_mm")
    @classmethod
    def _patch(cls, patch_mm: float | None, info: ValidationInfo) -> float | None:
        if not _law_uses(patch_mm, info) or patch_mm is None:
            return None
        if not (math.isfinite(patch_mm) and patch_mm > 0):
            raise ValueError("the patch size d must be above 0 mm, as in 0.15")
        size_mm = info.data.get("size_mm", patch_mm)
        if patch_mm > size_mm:
            raise ValueError(f"the patch size d must be at most the side, {size_mm:g} mm")
        if size_mm / patch_mm >= MAX_PATCHES + 1:
            raise ValueError(
                f"makes {size_mm / patch_mm:.4g} patches a side; at most {MAX_PATCHES}, "
                f"so at least {size_mm / MAX_PATCHES:g} mm"
            )
        return patch_mm

    @field_validator("r")
    @classmethod
    def _r(cls, r: float | None, info: ValidationInfo) -> float | None:
        if not _law_uses(r, info) or r is None:
            return None
        if not 0 <= r < 1:
            raise ValueError("the randomness factor must be 0 <= r < 1, as in 0.1")
        return r

    @field_validator("dots")
    @classmethod
    def _dots(cls, dots: DotGrid | None, info: ValidationInfo) -> DotGrid | None:
        law = info.data.get("law")
        if dots is None:
            if law == "dot-matrix":
                raise ValueError("law 'dot-matrix' needs a [dots] table")
            return None
        if law == "transparent":
            raise ValueError("law 'transparent' has no dots: remove them, or use law 'dot-matrix'")
        if law == "dot-matrix" and dots.colour == "#ffffff":
            raise ValueError("white dots cannot be seen on a clear sticker: give another colour")
        if "size_mm" in info.data and "patch_mm" in info.data:
            printed_mm = _printed_mm(info.data["size_mm"], info.data["patch_mm"])
            wide_mm, high_mm = (2 * half_mm for half_mm in dots.half_mm)
            if max(wide_mm, high_mm) > printed_mm:
                raise ValueError(
                    f"the grid takes {wide_mm:g} x {high_mm:g} mm and must fit on the printed "
                    f"{printed_mm:g} mm"
                )
        return dots

    @property
    def n(self) -> int:
        """Whole patches along a side, floor(size / d); 1 where the law has no patches."""
        return 1 if self.patch_mm is None else _whole_patches(self.size_mm, self.patch_mm)

    @property
    def printed_mm(self) -> float:
        """The side of the printed square, n d: 466 x 0.075 = 34.95 of 35 mm."""
        return _printed_mm(self.size_mm, self.patch_mm)


def _law_uses(value: float | None, info: ValidationInfo) -> bool:
    """Whether the law has patches; ValueError when value (d or r) lacks or is one too many."""
    if "law" not in info.data:
        return False
    law = info.data["law"]
    if law == "algorithm1" and value is None:
        raise ValueError("law 'algorithm1' needs it")
    if law != "algorithm1" and value is not None:
        raise ValueError(f"law {law!r} has no patches: remove it")
    return bool(law == "algorithm1")


def _whole_patches(size_mm: float, patch_mm: float) -> int:
    # 1e-9 keeps a side that is a whole number of patches (34.95 / 0.075) from losing one
    return math.floor(size_mm / patch_mm + 1e-9)


def _printed_mm(size_mm: float, patch_mm: float | None) -> float:
    # Rounded, so that 466 x 0.075 is written as 34.95
    return size_mm if patch_mm is None else round(_whole_patches(size_mm, patch_mm) * patch_mm, 9)


def recipe_from(data: dict[str, Any], source: str) -> PatternRecipe:
    """A recipe from plain data. Raises InputError of one line, `source: key: fault`."""
    return catalog.validate(PatternRecipe, data, source)


def load_recipe(name: str) -> PatternRecipe:
    """A recipe from a path or a name of the catalogue. Raises InputError naming file and key."""
    path = catalog.find("patterns", name)
    return recipe_from(catalog.read(path), str(path))


DEFAULT_SEED = 7


def recipe_from_options(
    name: str | None,
    patch_mm: float | None = None,
    r: float | None = None,
    size_mm: float | None = None,
    seed: int | None = None,
    with_dots: bool = False,
) -> PatternRecipe:
    """A recipe from what was typed: a name or path, or d and r; then size, seed, dots on top.

    with_dots adds the default grid to a recipe that has no dots of its own. Raises InputError when
    both or neither of name and (d, r) are given, or when a value is out of range.
    """
    data: dict[str, Any]
    if name is not None:
        if patch_mm is not None or r is not None:
            raise InputError(f"give a RECIPE ({name}) or -d and -r, not both")
        data = load_recipe(name).model_dump(exclude_none=True)
        source = name
    elif patch_mm is None or r is None:
        raise InputError("give a RECIPE, as in 'dense', or both -d and -r, as in -d 0.15 -r 0.1")
    else:
        data = {"law": "algorithm1", "seed": DEFAULT_SEED, "patch_mm": patch_mm, "r": r}
        source = "options"
    if size_mm is not None:
        data["size_mm"] = size_mm
    if seed is not None:
        data["seed"] = seed
    if with_dots:
        data.setdefault("dots", {})
    return recipe_from(data, source)
