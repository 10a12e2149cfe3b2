"""Long measurements, run from a checkout and never shipped: `make evidence`, `make peers`."""
