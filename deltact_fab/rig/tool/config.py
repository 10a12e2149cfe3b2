"""Tools and touch-off of a rig file."""

from __future__ import annotations

from ..strict import Strict


class TouchConfig(Strict):
    """How the face is found."""
