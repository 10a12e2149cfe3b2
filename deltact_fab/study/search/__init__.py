"""Which pattern to print for a printer and a camera: candidates, their figures, and a ranking."""
