"""The measurement: only what is asked for is run, and side by side gives what one by one does."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from deltact_fab.common.errors import InputError, SensorError
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.flow.confidence import FlowState
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.model import ForceModel
from deltact_fab.estimate.measure.pipeline import outputs
from deltact_fab.estimate.measure.pipeline.measurement import Measurement, Pipeline
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions

W, H = 200, 160
CAMERA = Pinhole(0.0378, W, H, 14.0)
VIEW = SensorModel(CAMERA, SkinDimensions())


@pytest.fixture(scope="module")
def images(make_scene: Any, make_bump: Any) -> list[np.ndarray]:
    """A press that grows and is sheared."""
    scene = make_scene(W, H)
    bump = make_bump((100, 80), 45, shear_px=(9, -4), press_px=6)
    return [scene.picture(bump.scaled(k / 9) if k else None, k) for k in range(10)]


@pytest.fixture(scope="module")
def model(images: list[np.ndarray]) -> ForceModel:
    """Of made-up forces: what is tested is the way to them."""
    features = make_features("sums", VIEW)
    measurement = Measurement(VIEW, ["flow"], spacing_px=FaceFlow.SPACING_PX)
    flows = [measurement.update(image).flow for image in images]
    x = np.array([features.compute(flow) for flow in flows if flow is not None])
    wrench = np.random.default_rng(3).normal(size=(len(x), 6))
    return ForceModel.fit(features, x, wrench)[0]


def same(a: Any, b: Any) -> bool:
    return (
        (a.cover, a.trusted) == (b.cover, b.trusted)
        and np.array_equal(a.flow.shift_mm, b.flow.shift_mm)
        and np.array_equal(a.flow.known, b.flow.known)
        and (a.force is None or np.array_equal(a.force.force_n, b.force.force_n))
    )


def test_only_required_parts_run(
    images: list[np.ndarray], model: ForceModel, monkeypatch: pytest.MonkeyPatch
):
    called = list[str]()
    for name in ("fill_unknown", "jacobian_density", "relative_depth", "find_contacts"):
        monkeypatch.setattr(outputs, name, lambda face, *_, name=name: called.append(name) or face)
    Measurement(VIEW, ["flow", "observation"], [model]).update(images[0])
    assert called == []
    Measurement(VIEW, ["force"], [model]).update(images[0])
    assert called == ["fill_unknown"]


@pytest.mark.parametrize(
    ("include", "says"),
    [
        (["force"], "calibrate force"),
        (["contacts"], "calibrate depth"),
        (["forces"], "did you mean 'force'"),
    ],
)
def test_impossible_output_is_refused(include: list[str], says: str):
    with pytest.raises(InputError, match=says):
        Measurement(VIEW, include)


def test_pipeline_equals_sequential_bitwise(images: list[np.ndarray], model: ForceModel):
    measurement = Measurement(VIEW, ["flow", "force"], [model])
    one_by_one = [measurement.update(image) for image in images]
    measurement.reset()
    with Pipeline(measurement) as pipeline:
        for image in images:
            pipeline.submit(image)
    side_by_side = list(pipeline.results())
    assert [result.frame for result in side_by_side] == list(range(len(images)))
    assert all(map(same, one_by_one, side_by_side))
    assert all(result.age_ms > 0 and result.trusted for result in side_by_side)


def test_reset_applies_to_later_images_only(images: list[np.ndarray]):
    measurement = Measurement(CAMERA)
    alone = [measurement.update(image) for image in images[4:]]
    whole = [measurement.update(image).frame for image in images[:1]]
    assert whole == [len(alone)]
    measurement.reset()
    with Pipeline(measurement) as pipeline:
        for k, image in enumerate(images):
            if k == 4:
                resetting = threading.Thread(target=measurement.reset)
                resetting.start()
                resetting.join()
            pipeline.submit(image)
        pipeline.close()
        results = list(pipeline.results())
    assert [result.frame for result in results] == [0, 1, 2, 3, *range(6)]
    assert all(map(same, results[4:], alone))


def test_reset_accepts_explicit_reference(images: list[np.ndarray]):
    measurement = Measurement(CAMERA)
    measurement.update(images[3])
    measurement.reset(images[0])
    result, known = measurement.update(images[9]), Measurement(CAMERA)
    known.update(images[0])
    expected = known.update(images[9])
    assert result.frame == 1
    assert same(result, expected)
    with pytest.raises(SensorError, match="no texture"):
        measurement.reset(np.full((H, W, 3), 90, np.uint8))
    assert measurement.update(images[9]).frame == 2  # as if it had not been asked


def test_image_error_raised_by_its_result(images: list[np.ndarray]):
    with Pipeline(Measurement(CAMERA)) as pipeline:
        for image in (images[0], images[1][:, :150], images[2]):
            pipeline.submit(image)
        first = pipeline.result()
        with pytest.raises(InputError, match="an image of 150 x 160 px; the view has 200 x 160"):
            pipeline.result()
        third = pipeline.result()
    assert [one.frame for one in (first, third) if one is not None] == [0, 1]


def test_newest_image_measured_and_drops_counted(images: list[np.ndarray]):
    with Pipeline(Measurement(CAMERA), "newest") as pipeline:
        for k in range(40):
            pipeline.submit(images[k % len(images)])
        pipeline.close()
        results = list(pipeline.results())
    assert len(results) + pipeline.dropped == 40
    assert pipeline.dropped > 0  # nothing was waited for
    assert results[-1].frame == len(results) - 1


@pytest.mark.parametrize("policy", ["every", "newest"])
def test_closed_pipeline_releases_measurement(images: list[np.ndarray], policy: Any):
    measurement = Measurement(CAMERA)
    pipeline = Pipeline(measurement, policy)
    pipeline.submit(images[0])
    with pytest.raises(RuntimeError, match="another pipeline"):
        Pipeline(measurement)
    with pytest.raises(RuntimeError, match="submit the images to it"):
        measurement.update(images[1])
    closers = [threading.Thread(target=pipeline.close) for _ in range(3)]
    for thread in closers:
        thread.start()
    for thread in closers:
        thread.join(30)
        assert not thread.is_alive()
    with pytest.raises(RuntimeError, match="is closed"):
        pipeline.submit(images[1])
    assert len(list(pipeline.results())) == 1
    assert pipeline.result() is None
    assert measurement.update(images[1]).frame == 1


def test_blank_image_is_untrusted_without_nan(
    images: list[np.ndarray], model: ForceModel, make_scene: Callable[..., Any]
):
    measurement = Measurement(VIEW, ["flow", "force"], [model])
    measurement.update(images[0])
    for lost in (np.zeros((H, W, 3), np.uint8), make_scene(W, H, seed=77).picture()):
        result: Any = measurement.update(lost)
        assert not result.trusted
        assert result.cover < 0.5
        assert result.force.cover < 0.5
        assert np.isfinite(result.flow.shift_mm).all()
        assert np.isfinite(result.force.force_n).all()
    assert measurement.update(images[2]).trusted


def test_cover_counts_points_visible_and_known(make_scene: Any, make_bump: Any):
    scene = make_scene(W, H)
    image = scene.picture(make_bump((100, 80), 45, shift_px=(5, 0), press_px=6), 1)
    image[40:150, 20:120] = 90  # hides the pattern
    measurement = Measurement(CAMERA, ["observation"])
    measurement.update(scene.picture())
    result: Any = measurement.update(image)
    visible, known = result.observation.visible, result.observation.state > FlowState.LOST
    assert (visible & ~known).any()
    assert not (known & ~visible).any()
    assert result.cover == np.mean(visible & known)
