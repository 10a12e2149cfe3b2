"""Drawings and pictures by hidden-line removal: drawing.py makes a sheet, picture.py the guide's
pictures; the rest lays out dimensions, says what is dimensioned on each part, and projects.
"""
