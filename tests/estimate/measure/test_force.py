"""Force from the flow: closed forms of the paper's two models, and what they do with holes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.face import FaceFlow, fill_unknown
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.model import WRENCH_AXES, ForceModel
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions

VIEW = SensorModel(Pinhole(0.04, 640, 480, 13.0), SkinDimensions())
SETS = ("sums", "paper")
MIRROR_X = np.array([-1.0, 1, 1, 1, -1, -1])  # of a wrench whose x is turned round


def _face(field, every: int = 8) -> FaceFlow:
    """The flow of field(x, y) -> two components, mm."""
    x, y = (0.04 * (np.arange(n // every) * every - (n - every) / 2) for n in (640, 480))
    shift = np.stack(np.broadcast_arrays(*field(x[None], y[:, None])), -1).astype(np.float32)
    return FaceFlow(shift, np.ones(shift.shape[:2], bool), x, y)


def _press(seed: int, every: int = 8) -> FaceFlow:
    """Like a ball that presses and shears somewhere: things spread, and are carried along."""
    rng = np.random.default_rng(seed)
    x0, y0 = rng.uniform(-4, 4, 2)
    depth, *shear = rng.uniform([0.1, -0.4, -0.4], [0.5, 0.4, 0.4])

    def field(x, y):
        bump = np.exp(-((x - x0) ** 2 + (y - y0) ** 2) / 18)
        return [
            (depth * (at - c) / 3 + s) * bump for at, c, s in ((x, x0, shear[0]), (y, y0, shear[1]))
        ]

    return _face(field, every)


def _mirrored(flow: FaceFlow) -> FaceFlow:
    flip = np.array([-1, 1], np.float32)
    return replace(flow, shift_mm=flow.shift_mm[:, ::-1] * flip, known=flow.known[:, ::-1])


FLOWS = [_press(seed) for seed in range(40)]
WRENCHES = np.random.default_rng(5).normal(size=(40, 6))  # any: symmetry is no matter of the truth


def _fitted(name: str, flows=FLOWS, wrenches=WRENCHES):
    features = make_features(name, VIEW)
    columns = np.stack([features.compute(flow) for flow in flows])
    return features, ForceModel.fit(features, columns, wrenches)[0], columns


def test_mirrored_face_gives_mirrored_wrench():
    features, model, columns = _fitted("sums")
    mirrored = np.stack([features.compute(_mirrored(flow)) for flow in FLOWS])
    assert np.allclose(model.predict(mirrored), model.predict(columns) * MIRROR_X, atol=1e-4)


def test_even_powers_break_shear_mirror_only():
    features, model, columns = _fitted("paper")
    mirrored = np.stack([features.compute(_mirrored(flow)) for flow in FLOWS])
    off = model.predict(mirrored) - model.predict(columns) * MIRROR_X
    broken = np.abs(off).max(axis=0) > 1e-3 * np.abs(model.predict(columns)).max(axis=0)
    assert broken.tolist() == [True, True, False, False, False, False]
    even = [i for i, name in enumerate(model.names) if name in ("a^2 mm4", "b^2 mm4")]
    assert np.allclose(mirrored[:, even], columns[:, even], rtol=1e-4)


def _twist(x, y):
    """Each ring turns as a whole, by an angle that ends inside the view: no area changes."""
    angle = 0.12 * np.exp(-(x**2 + y**2) / 8)
    c, s = np.cos(angle) - 1, np.sin(angle)
    return c * x - s * y, s * x + c * y


@pytest.mark.parametrize("name", SETS)
def test_pure_twist_gives_torque_only(name):
    features, model, columns = _fitted(name)
    seen = features.compute(_face(_twist))
    found = dict(zip(features.names, seen, strict=True))
    # The integral of rho^2 angle, all of it in r.
    assert found["x ry mm4"] - found["y rx mm4"] == pytest.approx(0.12 * np.pi * 64, rel=0.02)
    assert abs(found["x hy mm4"] - found["y hx mm4"]) < 0.01
    usual = np.sqrt(np.mean(model.predict(columns) ** 2, axis=0))
    share = np.abs(model.predict(seen[None])[0]) / usual
    assert (share[2:5] < 0.02).all()
    # The squares of the printed model see a shear force in any motion to both sides alike.
    assert (share[:2] < 0.02).all() == (name != "paper")


def test_paper_force_field_sums_to_force():
    features, model, columns = _fitted("paper")
    field = features.traction(FLOWS[3], model)
    assert field.traction_mpa.shape == (*FLOWS[3].known.shape, 3)
    assert field.force_n == pytest.approx(model.predict(columns[3:4])[0, :3], rel=1e-6)


@pytest.mark.parametrize("name", SETS)
def test_unknown_points_have_no_effect(name):
    features = make_features(name, VIEW)
    lost = FLOWS[2].known.copy()
    lost[20:30, 30:40] = False
    guesses = []
    for guess in (0.0, 1e9, np.nan):
        shift = FLOWS[2].shift_mm.copy()
        shift[~lost] = guess
        guesses.append(features.compute(replace(FLOWS[2], shift_mm=shift, known=lost)))
    assert np.isfinite(guesses[0]).all()
    assert np.array_equal(guesses[0], guesses[1])
    assert np.array_equal(guesses[0], guesses[2])
    nothing = replace(FLOWS[2], known=np.zeros_like(lost))
    assert not features.compute(nothing).any()


def test_hole_fill_stays_in_known_range():
    flow = _face(lambda x, y: (0.02 * x + 0 * y, 0.01 * y + 0 * x))
    known = flow.known.copy()
    known[20:26, 30:36] = False
    known[:, :9] = False
    shift = flow.shift_mm.copy()
    shift[5, 60] = np.nan  # called known, and is not
    mended = fill_unknown(replace(flow, shift_mm=shift, known=known))
    assert not mended.known[5, 60]
    assert mended.cover < np.mean(known)
    assert np.abs(mended.shift_mm - flow.shift_mm)[:, 9:].max() < 2e-3
    assert mended.shift_mm.min() >= flow.shift_mm[:, 9:].min()
    assert fill_unknown(flow) is flow


def test_model_range_survives_file():
    _, model, columns = _fitted("paper")
    again = ForceModel.from_dict(json.loads(json.dumps(model.as_dict())))
    assert np.array_equal(again.predict(columns), model.predict(columns))
    assert not again.is_extrapolated(columns).any()
    rest = again.wrench(np.zeros(columns.shape[1]), 1.0)
    assert not rest.extrapolated
    assert not rest.force_n.any()
    far = again.wrench(2 * columns[np.argmax(columns[:, 0])], 0.6)
    assert far.extrapolated
    assert far.cover == 0.6


def test_light_touch_is_extrapolated_within_range():
    features, _, columns = _fitted("paper")
    deep = columns[:, 0] > np.median(columns[:, 0])
    model, _ = ForceModel.fit(features, columns[deep], WRENCHES[deep])
    spread = features.names.index("D mm2")
    light = 0.2 * FLOWS[int(np.argmax(columns[:, spread]))].shift_mm
    seen = features.compute(replace(FLOWS[0], shift_mm=light))[None]
    assert seen[0, spread] < columns[deep][:, spread].min()
    assert model.is_extrapolated(seen).all()
    assert not model.is_extrapolated(np.zeros_like(seen)).any()
    assert model.is_extrapolated(np.full_like(seen, np.nan)).all()


def test_unknown_set_and_column_are_named():
    with pytest.raises(InputError, match="'papre': unknown; did you mean 'paper'"):
        make_features("papre", VIEW)
    features, _, columns = _fitted("sums")
    bad = columns.copy()
    bad[4, features.names.index("Vx mm3")] = np.nan
    with pytest.raises(InputError, match=r"force model sums: fx: .*Vx mm3: row 4"):
        ForceModel.fit(features, bad, WRENCHES)
    assert set(features.explains) == set(WRENCH_AXES)
