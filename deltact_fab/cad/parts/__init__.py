"""One file a part, everything of it in `PARTS` (see part.py); a file without them helps others."""
