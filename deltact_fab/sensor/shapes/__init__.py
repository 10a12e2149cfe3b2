"""Shapes as numbers: the sensor's dimensions and the indenters, from numpy alone.

The CAD solids, the gel's contact solver and the protocol's footprint checks all read these.
"""
