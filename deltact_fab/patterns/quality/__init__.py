"""How good a pattern is to track, as designed and after a model of printer and camera."""

from .measure import Quality, measure

__all__ = ["Quality", "measure"]
