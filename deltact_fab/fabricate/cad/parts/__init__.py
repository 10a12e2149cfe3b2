"""A part is in one file, whole, in `PARTS` (see part.py); a file without them helps others."""
