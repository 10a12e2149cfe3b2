"""Drawings (drawing.py) and the guide's pictures (picture.py) by hidden-line removal."""
