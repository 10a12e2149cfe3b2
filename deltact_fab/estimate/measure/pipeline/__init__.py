"""Measurement for a robot: images in; flow, shape, force and contact out."""
