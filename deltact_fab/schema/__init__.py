"""Every key that a lab can write: type, unit, default, limits and meaning, from the models."""

from .commented import commented
from .document import DIALECT, document
from .kinds import KINDS, Kind, kind_named
from .rows import Row, matching, rows

__all__ = [
    "DIALECT",
    "KINDS",
    "Kind",
    "Row",
    "commented",
    "document",
    "kind_named",
    "matching",
    "rows",
]
