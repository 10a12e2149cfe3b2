"""Measurement from images alone: dense flow, dots, and the quantities derived from them.

Nothing here may import the simulation (virtual, gel, imaging): simulated truth cannot leak into an
estimate. Import the modules by name: `flow`, `dots`, `compose`.
"""
