"""Recipe of a sticker: law, size and seed of its patches, and dots on top.

A recipe is a value: frozen, validated once, written into every file made from it.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from deltact_fab.common import (
    InputError,
    Table,
    did_you_mean,
    find_file,
    read_toml,
    toml_text,
    validate,
)

from .laws import PATTERN_LAWS, check_key, octave
from .laws.law import LAW_KEYS

MAX_PATCHES = 2000
"""Patches along a side, by hand: the random numbers of more would need over 100 MB."""

StickerLength = Annotated[float, Field(gt=0, le=1000)]
Offset = Annotated[float, Field(ge=-150, le=150)]
DotCount = Annotated[int, Field(ge=1, le=200)]
Weight = Annotated[float, Field(ge=octave.WEIGHT_RANGE[0], le=octave.WEIGHT_RANGE[1])]


class DotGrid(Table, strict=True):
    """A grid of round dots, centred or offset (paper, Pattern Selection: 169 white dots).

    The pitches keep all 13 x 13 dots inside the camera's 30.2 x 22.2 mm view; spread over 35 mm
    the outer ones would leave it.
    """

    columns: DotCount = 13
    """Dots along x."""
    rows: DotCount = 13
    """Dots along y."""
    pitch_x_mm: StickerLength = 2.2
    """Between the centres of two dots along x."""
    pitch_y_mm: StickerLength = 1.6
    """Between the centres of two dots along y."""
    diameter_mm: StickerLength = 0.6
    """Diameter of a dot; below the pitch."""
    offset_x_mm: Offset = 0.0
    """Centre of the grid in the sensor frame, along x."""
    offset_y_mm: Offset = 0.0
    """Centre of the grid in the sensor frame, along y."""
    colour: Annotated[str, Field(pattern=r"^#[0-9a-f]{6}$")] = "#ffffff"
    """`#rrggbb` as sent to the printer. White is no ink: the white layer behind shows through."""

    @model_validator(mode="after")
    def _check_pitch(self) -> DotGrid:
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
        """Colour as three 8-bit values."""
        red, green, blue = bytes.fromhex(self.colour[1:])
        return red, green, blue

    @property
    def offset_mm(self) -> tuple[float, float]:
        """Centre of the grid in the sensor frame (x, y)."""
        return (self.offset_x_mm, self.offset_y_mm)

    @property
    def half_mm(self) -> tuple[float, float]:
        """Half sides (x, y) of the box around all discs, centred at `offset_mm`."""
        return (
            ((self.columns - 1) * self.pitch_x_mm + self.diameter_mm) / 2,
            ((self.rows - 1) * self.pitch_y_mm + self.diameter_mm) / 2,
        )

    def centres_mm(self) -> NDArray[np.float64]:
        """Dot centres in the sensor frame, (rows * columns, 2) mm, about the grid's offset.

        Row by row: index = row * columns + column; row 0 at -y, column 0 at -x.
        """
        x_mm = (np.arange(self.columns) - (self.columns - 1) / 2) * self.pitch_x_mm
        y_mm = (np.arange(self.rows) - (self.rows - 1) / 2) * self.pitch_y_mm
        centred_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
        return centred_mm + np.array(self.offset_mm)


class PatternRecipe(Table, strict=True):
    """A square sticker. Only keys that its law uses are allowed (table in `laws`)."""

    law: Annotated[str, Field(json_schema_extra={"enum": list(PATTERN_LAWS)})]
    """How the patches are coloured: algorithm1 (the paper's), iid, binary, octave, chessboard,
    dot-matrix or transparent."""
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """Random seed: the same seed makes the same pattern."""
    size_mm: Annotated[float, Field(ge=1, le=300)] = 35.0
    """Requested side of the sticker; printed up to a patch smaller, in whole patches."""
    patch_mm: Annotated[
        Annotated[float, Field(gt=0, le=300)] | None, Field(validate_default=True, examples=[0.4])
    ] = None
    """Side of a patch, d of the paper."""
    r: Annotated[
        Annotated[float, Field(ge=0, lt=1)] | None, Field(validate_default=True, examples=[0.6])
    ] = None
    """Randomness regulation factor of the paper: least squared difference, values in 0..1."""
    channels: Literal[1, 3] = 3
    """3 draws red, green and blue independently; 1 draws a grey."""
    scales_mm: Annotated[
        Annotated[tuple[float, ...], Field(min_length=1, max_length=octave.MAX_SCALES)] | None,
        Field(validate_default=True, examples=[[0.4, 0.8, 1.6, 3.2]]),
    ] = None
    """Sides of the blocks that law `octave` adds, whole multiples of patch_mm, rising."""
    weights: Annotated[
        tuple[Weight, ...] | None, Field(validate_default=True, examples=[[1.0, 1.0, 1.0, 1.0]])
    ] = None
    """Weight of each scale, 0.01 to 100; equal if not set."""
    dots: Annotated[DotGrid | None, Field(validate_default=True)] = None

    # info.data holds the valid fields above, so that each fault names its own key

    @field_validator("law")
    @classmethod
    def _law(cls, law: str) -> str:
        if law not in PATTERN_LAWS:
            raise ValueError(f"no such law; {did_you_mean(law, PATTERN_LAWS)}")
        return law

    @field_validator(*LAW_KEYS)
    @classmethod
    def _check_law_key(cls, value: Any, info: ValidationInfo) -> Any:
        # Files of every recipe contain the default of channels: only another value is an error.
        if "law" in info.data:
            default = 3 if info.field_name == "channels" else None
            check_key(info.data["law"], str(info.field_name), value != default)
        return value

    @field_validator("patch_mm")
    @classmethod
    def _patch(cls, patch_mm: float | None, info: ValidationInfo) -> float | None:
        if patch_mm is None:
            return None
        size_mm = info.data.get("size_mm", patch_mm)
        if patch_mm > size_mm:
            raise ValueError(f"the patch size d must be at most the side, {size_mm:g} mm")
        if size_mm / patch_mm >= MAX_PATCHES + 1:
            raise ValueError(
                f"makes {size_mm / patch_mm:.4g} patches per side; at most {MAX_PATCHES}, "
                f"so at least {size_mm / MAX_PATCHES:g} mm"
            )
        return patch_mm

    @field_validator("scales_mm")
    @classmethod
    def _scales(
        cls, scales_mm: tuple[float, ...] | None, info: ValidationInfo
    ) -> tuple[float, ...] | None:
        patch_mm, size_mm = info.data.get("patch_mm"), info.data.get("size_mm")
        if scales_mm is None or patch_mm is None or size_mm is None:
            return scales_mm
        for scale_mm in scales_mm:
            if not patch_mm <= scale_mm * (1 + 1e-9) <= size_mm * (1 + 1e-9):  # NaN fails too
                raise ValueError(
                    f"{scale_mm:g} mm must lie between the patch size, {patch_mm:g} mm, and the "
                    f"side, {size_mm:g} mm"
                )
            blocks = round(scale_mm / patch_mm)
            if abs(scale_mm / patch_mm - blocks) > 1e-6:
                raise ValueError(
                    f"{scale_mm:g} mm is {scale_mm / patch_mm:.4g} patches; a whole number is "
                    f"needed, as in {blocks * patch_mm:g}"
                )
        if any(b <= a for a, b in itertools.pairwise(scales_mm)):
            raise ValueError("the scales must rise, as in [0.1, 0.2, 0.4]")
        return scales_mm

    @field_validator("weights")
    @classmethod
    def _weights(
        cls, weights: tuple[float, ...] | None, info: ValidationInfo
    ) -> tuple[float, ...] | None:
        scales_mm = info.data.get("scales_mm")
        if weights is None or scales_mm is None:
            return weights
        if len(weights) != len(scales_mm):
            raise ValueError(f"one weight per scale: {len(weights)} for {len(scales_mm)} scales")
        return weights

    @field_validator("dots")
    @classmethod
    def _dots(cls, dots: DotGrid | None, info: ValidationInfo) -> DotGrid | None:
        if dots is None:
            return None
        law = info.data.get("law")
        if law in PATTERN_LAWS and not PATTERN_LAWS[law].has_patches and dots.colour == "#ffffff":
            raise ValueError("white dots are invisible on a clear sticker: choose another colour")
        if "size_mm" in info.data and "patch_mm" in info.data:
            printed_mm = _printed_mm(info.data["size_mm"], info.data["patch_mm"])
            width_mm, height_mm = (2 * half_mm for half_mm in dots.half_mm)
            reach_mm = max(h + abs(o) for h, o in zip(dots.half_mm, dots.offset_mm, strict=True))
            if 2 * reach_mm > printed_mm + 1e-9:
                x_mm, y_mm = dots.offset_mm
                centre = f" about ({x_mm:g}, {y_mm:g}) mm" if x_mm or y_mm else ""
                raise ValueError(
                    f"the grid covers {width_mm:g} x {height_mm:g} mm{centre} and must fit on the "
                    f"printed {printed_mm:g} mm"
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

    def fitted(self, view_mm: tuple[float, float], face_mm: tuple[float, float]) -> PatternRecipe:
        """Return the recipe in the size for a sensor: at least its view, at most its face.

        The recipe itself if its size is right. Raises InputError if the dots do not fit.
        """
        patch_mm, printed_mm = self.patch_mm or 1.0, self.printed_mm
        least_mm, most_mm = max(view_mm), max(face_mm)
        if least_mm <= printed_mm <= most_mm:
            return self
        squares = math.ceil((least_mm + STICKER_SPARE_MM) / patch_mm - 1e-9)
        if printed_mm > most_mm:
            squares = max(squares, _whole_patches(most_mm, patch_mm))
        if squares * patch_mm >= printed_mm > most_mm:
            return self
        data = {**self.model_dump(exclude_none=True), "size_mm": round(squares * patch_mm, 6)}
        return validate(PatternRecipe, data, f"recipe of {data['size_mm']:g} mm")

    def file_text(self) -> str:
        """Return the recipe as a file."""
        return toml_text(self.model_dump(mode="json", exclude_none=True))

    def as_record(self) -> dict[str, Any]:
        """Recipe and dot centres as plain data, for analysis without this package."""
        dots = self.dots
        return {
            "recipe": self.model_dump(mode="json"),
            "dots_mm": dots.centres_mm().tolist() if dots is not None else [],
            "dot_diameter_mm": dots.diameter_mm if dots is not None else 0.0,
        }

    def patches(self) -> NDArray[np.uint8]:
        """Draw the patches, (n, n, 3) uint8 RGB; row 0, column 0 is the corner at (-x, -y).

        Clear film is one white patch: no ink, the white layer behind shows.
        """
        patches = PATTERN_LAWS[self.law].draw(self)
        return np.ascontiguousarray(np.broadcast_to(patches, (self.n, self.n, 3)))


def _whole_patches(size_mm: float, patch_mm: float) -> int:
    # 1e-9 keeps a side that is a whole number of patches (34.95 / 0.075) from losing one
    return math.floor(size_mm / patch_mm + 1e-9)


def _printed_mm(size_mm: float, patch_mm: float | None) -> float:
    # Rounded, so that 466 x 0.075 is written as 34.95
    return size_mm if patch_mm is None else round(_whole_patches(size_mm, patch_mm) * patch_mm, 9)


STICKER_SPARE_MM = 1.0  # by hand, sticker beyond the view: room for misplacing it
DEFAULT_SEED = 7  # by hand; a change would change every default pattern
RECOMMENDED_RECIPE = "recommended"
"""Default pattern to print; its file names the printer and the camera it suits."""


def load_recipe(name: str = RECOMMENDED_RECIPE) -> PatternRecipe:
    """Load a recipe by path or catalogue name. Raises InputError naming file and key."""
    path = find_file("patterns", name)
    return validate(PatternRecipe, read_toml(path), str(path))


def choose_recipe(
    name: str | None,
    patch_mm: float | None = None,
    r: float | None = None,
    size_mm: float | None = None,
    seed: int | None = None,
    with_dots: bool = False,
) -> PatternRecipe:
    """Build a recipe from options: a name or path, or d and r; then size, seed, dots.

    with_dots: add the default grid to a recipe without dots. Raises InputError if both or neither
    of name and (d, r) are given, or a value is out of range.
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
    return validate(PatternRecipe, data, source)
