"""The face's matrix on cells against the operator that contacts are solved with."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.sensor.elasticity.block import FaceCells, FreeBlock
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions(width_mm=20.0, length_mm=16.0, thickness_mm=7.0)


@pytest.fixture(scope="module")
def cells() -> FaceCells:
    return FaceCells.from_skin(SKIN, 0.49, 1.0)


def _windows(cells: FaceCells) -> tuple[slice, slice]:
    return slice(0, len(cells.y_mm)), slice(0, len(cells.x_mm))


def test_cell_response_matches_the_block(cells: FaceCells) -> None:
    block = FreeBlock(SKIN, GelMaterial(1.0, 0.49), 0.25)
    rows, columns = _windows(cells)
    shape = (len(cells.y_mm), len(cells.x_mm), 3)
    load = np.zeros(shape)
    load[0:3, 12:20] = np.random.default_rng(1).normal(size=(3, 8, 3))
    whole = cells.compliance((rows, columns), (rows, columns))
    moved = (whole.reshape(load.size, -1) @ load.ravel()).reshape(shape)
    fine = block.apply(load.repeat(4, axis=0).repeat(4, axis=1))
    means = fine.reshape(shape[0], 4, shape[1], 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(moved, means, atol=1e-9)


def test_matrix_is_symmetric_and_windows_match(cells: FaceCells) -> None:
    rows, columns = _windows(cells)
    whole = cells.compliance((rows, columns), (rows, columns))
    flat = whole.reshape(3 * len(whole), -1)
    np.testing.assert_allclose(flat, flat.T, atol=1e-12 * np.abs(flat).max())
    part = cells.compliance((slice(2, 5), slice(3, 9)), (rows, columns))
    grid = whole.reshape(len(cells.y_mm), len(cells.x_mm), 3, -1, 3)
    np.testing.assert_allclose(part.reshape(3, 6, 3, -1, 3), grid[2:5, 3:9], atol=1e-14)
