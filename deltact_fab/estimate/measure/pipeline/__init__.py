"""The measurement as a robot calls it: images in; flow, shape, force and contact out."""
