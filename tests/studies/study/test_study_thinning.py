"""The thinned pattern selection: fewer positions and shorter drags, never a longer step."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.studies.study.pattern_selection import (
    SELECTION_SCALE,
    covered_part,
    frames_per_indenter,
    longest_step_mm,
    thin_protocol,
)

SCALES = (0.001, 0.02, SELECTION_SCALE, 0.07, 0.13, 0.2499, 0.25, 0.2501, 0.37, 0.5, 0.61, 0.75,
          0.9, 0.999)  # fmt: skip


@pytest.fixture(scope="module")
def whole() -> Protocol:
    return plan.load_protocol("pattern-selection")[0]


def test_full_protocol_has_paper_frames(whole: Protocol) -> None:
    assert thin_protocol(whole, 1.0) == whole
    part = covered_part(whole, whole)
    assert (part.frames_an_indenter, part.positions) == (3600, 4)
    assert part.longest_step_mm <= 0.2


@pytest.mark.parametrize("scale", SCALES)
def test_scale_keeps_step_depths_axes(whole: Protocol, scale: float) -> None:
    fewer = thin_protocol(whole, scale)
    assert longest_step_mm(fewer) <= longest_step_mm(whole) + 1e-9
    assert fewer.depths_mm == whole.depths_mm
    assert fewer.indenters == whole.indenters
    assert fewer.shear is not None
    assert whole.shear is not None
    assert (fewer.shear.axes, fewer.shear.first) == (whole.shear.axes, whole.shear.first)
    assert 0 < (fewer.shear.amplitude_mm or 0) <= 10.0
    assert fewer.positions_mm == whole.positions_mm[: len(fewer.positions_mm)]
    assert (fewer.capture, fewer.motion, fewer.specimen) == (
        whole.capture,
        whole.motion,
        whole.specimen,
    )
    assert Protocol.model_validate(fewer.model_dump()) == fewer


def test_frames_follow_the_scale(whole: Protocol) -> None:
    frames = np.array([frames_per_indenter(thin_protocol(whole, scale)) for scale in SCALES])
    wanted = 3600 * np.array(SCALES)
    # Half a step more or less of each drag of a position: four of its twelve are of two steps.
    positions = np.ceil(4 * np.array(SCALES))
    assert (np.abs(frames - wanted)[1:] <= 12 * positions[1:]).all()
    assert frames[0] == 72
    assert (np.diff(frames) >= 0).all()
