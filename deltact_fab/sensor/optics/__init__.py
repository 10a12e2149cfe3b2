"""Frames: the only package that converts between image, sensor and stage.

A camera looks along +z at the inside of the pattern: image x = +x, image y = +y, no flip. What
draws, records and analyses knows a `CameraModel`. `Pinhole` is the simple one. `Fisheye` is the
lens as it is, behind air, acrylic and gel, and `Rectified` the view of the face out of its image.
"""
