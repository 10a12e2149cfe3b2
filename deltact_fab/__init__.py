"""Fabrication and experiment-design toolchain for the DelTact tactile sensor."""

__version__ = "0.2.0"
