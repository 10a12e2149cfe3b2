"""Frames as a stream: those that the virtual rig records, with nothing kept of them."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.record.files import truth_file
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.bench.rig import config as rig_config
from deltact_fab.bench.rig.config import VirtualConfig
from deltact_fab.estimate.analysis.tracking_error.follow import TrackingPlan, analyse_press
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns.recipe import PatternRecipe
from deltact_fab.studies.study.stream import FrameMoment, PressStream

PRESS = "sphere-10/p1"


@pytest.fixture(scope="module")
def run(mini_run: Path) -> Run:
    return open_run(mini_run)


@pytest.fixture(scope="module")
def stream(mini: tuple[Path, Path], run: Run) -> PressStream:
    """Of the press that was recorded, which the run has left in the store of gels."""
    config, source = rig_config.load_rig(str(mini[1]))
    assert isinstance(config, VirtualConfig)
    protocol = plan.load_protocol(str(mini[0]))[0]
    return PressStream(protocol, PRESS, load_design("deltact"), config, source)


@pytest.fixture(scope="module")
def recipe(run: Run) -> PatternRecipe:
    return PatternRecipe.model_validate(run.pattern["recipe"])


@pytest.fixture(scope="module")
def recorded(run: Run) -> list[FrameMoment]:
    """When the rig took its frames."""
    with np.load(run.folder / truth_file(PRESS)) as held:
        rows = zip(held["knots"].tolist(), held["fraction"].tolist(), strict=True)
        return [FrameMoment("", a, b, fraction) for (a, b), fraction in rows]


def test_plan_matches_rig_except_ramps(stream: PressStream, recorded: list[FrameMoment]) -> None:
    planned = stream.moments
    assert len(planned) == len(recorded)

    def tip_mm(look: FrameMoment) -> np.ndarray:
        poses = [(*stream.path.at_mm, 0.0), *(p.tip_mm for p in stream.solver.poses)]
        a, b = (np.array(poses[k]) for k in (look.a, look.b))
        return a + look.fraction * (b - a)

    for look, taken in zip(planned, recorded, strict=True):
        assert np.abs(tip_mm(look) - tip_mm(taken)).max() < 0.01
        if look.tip_mm[2] < 0:
            assert tip_mm(look) == pytest.approx(look.tip_mm, abs=1e-6)


@pytest.mark.slow
def test_memory_is_independent_of_frames(stream: PressStream, recipe: PatternRecipe) -> None:
    picture, noise, looks = stream.picture(recipe, 0), stream.noise(0), stream.moments
    held = []
    tracemalloc.start()
    try:
        for frame in stream.frames([*looks, *looks]):
            picture.expose(frame.at_px, noise)
            held.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    first, second = held[: len(looks)], held[len(looks) :]
    # An image of this camera has 1.4 MB, the geometry of a frame 3.8 MB.
    assert max(second) - max(first) < 2e5


@pytest.mark.slow
def test_stream_has_errors_of_record(
    stream: PressStream, run: Run, recipe: PatternRecipe, recorded: list[FrameMoment]
) -> None:
    from deltact_fab.estimate.analysis.tracking_error.follow import Follower

    scene = TrackingPlan(("fused",), True, ())
    kept = analyse_press(str(run.folder), PRESS, scene).tallies["fused"].figures()
    seed, marks = int(run.meta["seed"]), stream.marks(recipe)
    picture, noise = stream.picture(recipe, seed), stream.noise(seed)
    follower = Follower(scene, marks)
    for frame in stream.frames(recorded):
        image = stream.tracker_image(picture.expose(frame.at_px, noise))
        follower.track(image, frame.true)
    found = follower.tallies["fused"].figures()
    assert {**found, "ms_per_frame": 0} == {**kept, "ms_per_frame": 0}
