"""A mesh of a cylinder, for comparison with solutions that have its symmetry."""

from __future__ import annotations

import numpy as np

from deltact_fab.gel.finite.mesh import HexMesh, extruded


def disc_mesh(radius_mm: float, thickness_mm: float, spacing_mm: float) -> HexMesh:
    """An upright cylinder: a square core in a ring whose cells turn from it to a circle."""
    n = max(1, round(0.55 * radius_mm / spacing_mm))
    rings = max(1, round(0.5 * radius_mm / spacing_mm))
    core = np.linspace(-1.0, 1.0, 2 * n + 1)
    cy, cx = (c.ravel() for c in np.meshgrid(core, core, indexing="ij"))
    # Bulged towards a circle, so that the cells at the core's corners are not flattened.
    bulge = 0.5 * radius_mm * (1 + 0.12 * (1 - cx**2) * cy**2 + 0.12 * (1 - cy**2) * cx**2)
    plane = [np.stack([cx * bulge, cy * bulge], axis=1)]
    width = 2 * n + 1
    rim = [*range(width), *(width * k - 1 for k in range(2, width + 1))]
    rim += [*range(width**2 - 2, width * (width - 1) - 1, -1)]
    rim += [width * k for k in range(width - 2, 0, -1)]
    edge = plane[0][rim]
    angle = np.arctan2(cy[rim], cx[rim])
    # Between the corners the angle follows the core's own spacing in angle, as equal as it can be.
    circle = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for k in range(1, rings + 1):
        plane.append(edge + (circle - edge) * (k / rings))
    row, column = np.meshgrid(np.arange(width - 1), np.arange(width - 1), indexing="ij")
    corner = (row * width + column).ravel()
    quads = [np.stack([corner, corner + 1, corner + 1 + width, corner + width], axis=1)]
    inner = np.array(rim)
    count, start = len(rim), width**2
    for k in range(rings):
        outer = start + count * k + np.arange(count)
        # The core's edge runs counterclockwise; outwards is to the right of it.
        quads.append(np.stack([inner, outer, np.roll(outer, -1), np.roll(inner, -1)], axis=1))
        inner = outer
    z = np.linspace(-thickness_mm, 0.0, max(1, round(thickness_mm / spacing_mm)) + 1)
    return extruded(np.concatenate(plane), np.concatenate(quads), z)
