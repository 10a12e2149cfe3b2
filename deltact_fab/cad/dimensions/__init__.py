"""Every dimension of the hardware: records of independent ones, a Design that derives the rest."""

from .design import ACRYLIC_FIT_MM, Design
from .records import (
    BOARD_KEYS,
    CameraDimensions,
    CouponDimensions,
    CoverDimensions,
    EnvelopeDimensions,
    HolderDimensions,
    LightDimensions,
    MoldDimensions,
    MountDimensions,
    Point2,
    ScrewDimensions,
    ShellDimensions,
    TableDimensions,
)

__all__ = [
    "ACRYLIC_FIT_MM",
    "BOARD_KEYS",
    "CameraDimensions",
    "CouponDimensions",
    "CoverDimensions",
    "Design",
    "EnvelopeDimensions",
    "HolderDimensions",
    "LightDimensions",
    "MoldDimensions",
    "MountDimensions",
    "Point2",
    "ScrewDimensions",
    "ShellDimensions",
    "TableDimensions",
]
