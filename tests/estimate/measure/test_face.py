"""The face's flow: millimetres on a regular grid, from a full or a half observation."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.estimate.measure.face import FaceFlow, fill_unknown, fit_rigid_motion
from deltact_fab.estimate.measure.flow.confidence import FlowDiagnostics, FlowObservation, FlowState
from deltact_fab.sensor.optics.camera import Pinhole

CAMERA = Pinhole(0.04, 102, 78, 14.0)


def _seen(
    flow: np.ndarray, state: np.ndarray | None = None, visible: np.ndarray | None = None
) -> FlowObservation:
    shape = flow.shape[:2]
    state = np.full(shape, FlowState.MATCHED, np.uint8) if state is None else state
    said = FlowDiagnostics(1, 0, 1.0, True, 1.0, 0.0)
    yes = np.ones(shape, bool)
    visible = yes if visible is None else visible
    return FlowObservation(flow.astype(np.float32), visible, yes, state, said)


def _linear(every: int) -> np.ndarray:
    """A flow that is linear in the pixels, at the middles of every x every of them."""
    rows, columns = np.mgrid[0 : 78 // every, 0 : 102 // every] * every + (every - 1) / 2
    return _at(columns, rows)


def _at(columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.stack([0.02 * columns - 0.01 * rows, 1 + 0.03 * rows], axis=-1)


@pytest.mark.parametrize(("have", "every"), [(1, 1), (1, 2), (1, 4), (2, 2), (2, 8)])
def test_linear_flow_stays_linear(have, every):
    face = FaceFlow.from_flow(_seen(_linear(have)), CAMERA, every)
    assert face.shift_mm.shape == (78 // every, 102 // every, 2)
    assert face.cell_mm == pytest.approx(every * 0.04)
    columns, rows = face.x_mm / 0.04 + 50.5, face.y_mm / 0.04 + 38.5
    assert np.allclose(face.shift_mm, _at(*np.meshgrid(columns, rows)) * 0.04, atol=1e-6)
    assert columns[0] % have == pytest.approx((every - 1) / 2 % have)
    assert face.cover == 1


def test_grid_is_centred_in_view():
    face = FaceFlow.from_flow(_seen(_linear(1)), CAMERA, 4)
    assert face.x_mm.mean() == pytest.approx(0)
    assert face.y_mm.mean() == pytest.approx(0)


def test_lost_pixels_enter_no_mean():
    flow = np.zeros((78, 102, 2))
    state = np.full((78, 102), FlowState.MATCHED, np.uint8)
    flow[:4, :8], state[:4, :8] = 50.0, FlowState.LOST
    flow[8, 8], state[8, 8] = 50.0, FlowState.LOST
    state[20:30, 20:30] = FlowState.PREDICTED
    face = FaceFlow.from_flow(_seen(flow, state), CAMERA, 4)
    assert not face.known[0, :2].any()
    assert face.known.sum() == face.known.size - 2
    assert np.abs(face.shift_mm[face.known]).max() == 0


def test_point_out_of_view_is_unknown():
    flow, visible = np.zeros((78, 102, 2)), np.ones((78, 102), bool)
    flow[:4, :8], visible[:4, :8] = 50.0, False
    face = FaceFlow.from_flow(_seen(flow, visible=visible), CAMERA, 4)
    assert not face.known[0, :2].any()
    assert face.known.sum() == face.known.size - 2
    assert np.abs(face.shift_mm[face.known]).max() == 0


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("far_mm", [9.0, -9.0, np.inf, np.nan])
def test_motion_beyond_view_is_filled(far_mm, axis):
    """The view is 7 x 3 mm."""
    shift = np.full((7, 15, 2), 0.1, np.float32)
    shift[3, 4, axis] = far_mm
    flow = FaceFlow(shift, np.ones((7, 15), bool), np.arange(15) * 0.5, np.arange(7) * 0.5)
    result = fill_unknown(flow)
    assert np.argwhere(~result.known).tolist() == [[3, 4]]
    assert result.shift_mm[3, 4] == pytest.approx([0.1, 0.1], abs=0.01)
    shift[3, 4, axis] = 6.0
    assert fill_unknown(flow) is flow


def test_rigid_motion_shift_and_turn_sign():
    x, y = np.arange(-6, 9) * 0.5, np.arange(-4, 3) * 0.5
    at, (c, s) = np.stack(np.meshgrid(x, y), -1), (np.cos(0.1), np.sin(0.1))
    shift = (at @ np.array([[c, s], [-s, c]]) + (0.3, -0.2) - at).astype(np.float32)
    moved, turn_deg, left = fit_rigid_motion(FaceFlow(shift, np.ones(shift.shape[:2], bool), x, y))
    assert moved == pytest.approx((0.3, -0.2), abs=1e-6)
    assert turn_deg == pytest.approx(np.degrees(0.1), abs=1e-4)  # from x towards y
    assert np.abs(left).max() < 1e-6


def test_half_observation_needs_even_spacing():
    with pytest.raises(ValueError, match="must be a multiple of 2"):
        FaceFlow.from_flow(_seen(_linear(2)), CAMERA, 1)
