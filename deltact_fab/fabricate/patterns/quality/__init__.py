"""How good a pattern is to track, as designed and after a model of printer and camera."""
