"""Parts, each defined in one file in `PARTS` (see part.py); files without PARTS are helpers."""
