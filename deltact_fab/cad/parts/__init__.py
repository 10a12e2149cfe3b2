"""A part is in one file, everything of it in `PARTS` (see part.py); a file without them helps others."""
