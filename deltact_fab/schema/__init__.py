"""Every key that a lab can write: type, unit, default, limits and meaning, from the models.

And every column that it gets."""

from .commented import commented
from .document import described, document
from .kinds import KINDS, OUTPUTS, Kind, kind_named
from .rows import matching, rows

__all__ = [
    "KINDS",
    "OUTPUTS",
    "Kind",
    "commented",
    "described",
    "document",
    "kind_named",
    "matching",
    "rows",
]
