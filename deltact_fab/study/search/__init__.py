"""Which pattern to print for a printer and a camera: candidates, their errors, the best few."""
