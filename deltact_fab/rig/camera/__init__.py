"""Cameras behind `rig.interface.Camera`."""
