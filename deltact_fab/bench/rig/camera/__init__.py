"""Cameras behind `bench.rig.interface.Camera`."""
