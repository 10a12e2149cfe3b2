"""A sensor at its start: what changed since the calibration is named, what did not is not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.health import Health
from deltact_fab.sensor.optics.camera import Pinhole

W, H, SCALE = 400, 320, 0.0378
CAMERA = Pinhole(SCALE, W, H, 12.85)


@pytest.fixture(scope="module")
def look(make_scene: Callable[..., Any], make_bump: type) -> Callable[..., Health]:
    scene = make_scene(W, H, patch_mm=0.15)
    reference = scene.picture()

    def of(light: float = 1.0, **bump: Any) -> Health:
        moved = make_bump((200.0, 160.0), 60.0, **bump) if bump else None
        image = scene.picture(moved, noise_seed=1) * light
        return Health.compare(reference, np.clip(np.round(image), 0, 255).astype(np.uint8), CAMERA)

    return of


def test_unchanged_face_is_fit(look: Callable[..., Health]) -> None:
    found = look()
    assert found.fit
    assert found.line == "fit to use"
    assert found.deformation_mm is not None
    assert found.deformation_mm < 0.003
    assert found.matched_share > 0.98
    assert found.as_dict()["fit"] is True


def test_slipped_pattern_is_refused_beyond_limit(look: Callable[..., Health]) -> None:
    little = look(shift_px=(3.0, -2.0))
    assert little.fit
    assert little.shift_mm == pytest.approx((3 * SCALE, -2 * SCALE), abs=0.002)
    much = look(shift_px=(18.0, 0.0))
    assert not much.fit
    assert "the pattern moved by 0.68 mm (limit 0.3)" in much.line


def test_touched_face_is_refused(look: Callable[..., Health]) -> None:
    found = look(press_px=8.0)
    assert not found.fit
    assert "deformed" in found.line
    assert found.shift_mm == pytest.approx((0, 0), abs=0.01)


def test_light_loss_is_not_motion(look: Callable[..., Health]) -> None:
    found = look(light=0.3)
    assert found.brightness == pytest.approx(0.3, abs=0.02)
    assert found.contrast == pytest.approx(0.3, abs=0.03)
    assert len(found.reasons) == 2
    assert look(light=0.7).fit


def test_other_skin_or_size_is_refused(make_scene: Callable[..., Any]) -> None:
    one, other = (make_scene(W, H, patch_mm=0.15, seed=seed).picture() for seed in (1, 2))
    found = Health.compare(one, other, CAMERA)
    assert not found.fit
    assert "not found" in found.line
    assert found.shift_mm is None
    with pytest.raises(InputError, match="200 x 320 px, the camera 400 x 320"):
        Health.compare(one, other[:, :200], CAMERA)
    with pytest.raises(InputError, match=r"the calibration's image: .*no texture"):
        Health.compare(np.full_like(one, 90), other, CAMERA)
