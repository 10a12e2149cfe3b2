"""Trackability of a pattern, as designed and after a model of printer and camera."""
