"""Whether the renewal of the paper's reference can fire: what it can see on each pattern.

    python -m benchmarks.renewal              # the paper's 17 patterns, in two minutes
    python -m benchmarks.renewal PRESS        # and errors by three shares, and as published, under
                                              # a press of pattern-selection, as 4dots/p1: minutes
                                              # a pattern

The most that a rule can see is the difference of two prints of a pattern, of other seeds: for the
published rule, after its coarse flow, with the dots in their places and half a pitch off.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from deltact_fab.bench import SimulatorConfig
from deltact_fab.common.aliases import Image
from deltact_fab.estimate.analysis.tracking_error.tally import off_dots
from deltact_fab.estimate.measure.compose import shrink
from deltact_fab.estimate.measure.flow.fused import to_gray
from deltact_fab.estimate.measure.flow.renewed import (
    RENEW_GREY,
    FlowMethod,
    coarse_difference,
    photometric_error,
    unrelated_difference,
)
from deltact_fab.estimate.measure.flow.tracker import FlowTracker
from deltact_fab.fabricate.patterns.recipe import PatternRecipe
from deltact_fab.fabricate.patterns.series import list_series
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.virtual.picture import FrameRenderer, PictureGeometry
from deltact_fab.studies.study.pattern_selection import Selection
from deltact_fab.studies.study.registry import StudyRequest, load_virtual_rig
from deltact_fab.studies.study.stream import PressStream

SHARES = (0.25, 0.5, 0.75)
SHOWN = ("d0p05-r0p5", "d0p075-r0p6", "d0p1-r0p5", "d0p15-r0p3", "d0p2-r0p1")


EDGES, MEAN_GREY = 3.0, 180.0
"""By hand: more of both than a picture bears, the rule's best case. The published camera enhances
edges and sets its exposure itself, by how much is not known."""


def seen() -> Iterator[tuple[str, float, float, list[float]]]:
    """Of each pattern of the paper: threshold by the share, the most that it can see, and the most
    that the published rule can, in grey levels: with the dots in place and moved, and both where
    edges and exposure are the camera's.
    """
    geometry, rig = PictureGeometry.resting(SensorDimensions()), load_virtual_rig("virtual")[0]
    camera = replace(rig.virtual.camera, sharpening=EDGES, auto_exposure_grey=MEAN_GREY)
    enhanced = rig.virtual.model_copy(update={"camera": camera})

    def at_rest_of(recipe: PatternRecipe, of: SimulatorConfig, seed: int) -> Image:
        recipe = recipe.model_copy(update={"seed": recipe.seed + seed - 1})
        picture = FrameRenderer.printed(geometry, of, recipe, seed)
        return to_gray(picture.render(None, FrameRenderer.noise(seed, "")))

    for entry in list_series():
        dots = entry.recipe.dots
        coarse: list[float] = []
        assert dots is not None, "the paper's patterns have dots"
        pitch_px = np.array([dots.pitch_y_mm, dots.pitch_x_mm]) / geometry.camera.mm_per_px
        for of in (enhanced, rig.virtual):
            own, other = (at_rest_of(entry.recipe, of, seed) for seed in (1, 2))
            moved = np.roll(other, np.rint(pitch_px / 2).astype(int), (0, 1))
            views = (shrink(view, 2) for view in (other, moved))
            coarse = [*(coarse_difference(shrink(own, 2), view)[0] for view in views), *coarse]
        threshold = FlowTracker.RENEW_SHARE * unrelated_difference(own)
        still = np.zeros((*own.shape, 2), np.float32)
        yield entry.name, threshold, photometric_error(own, other, still), coarse


def by_share(press: str) -> Iterator[str]:
    """Rows of markdown: mean error of moving pixels, mm, and renewals, by share and sum."""
    scene = Selection.from_request(StudyRequest())
    of = scene.scene
    stream = PressStream(scene.protocol, press, of.sensor, of.rig, of.source)
    ways = [(share, total) for share in SHARES for total in ("summed", "composed")]
    heads = ["pattern", *(f"{share:g}, {total}" for share, total in ways), "published"]
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for entry in (e for e in scene.entries if e.name in SHOWN):
        picture, noise = stream.picture(entry.recipe, 0), stream.noise(0)
        marks = stream.marks(entry.recipe)
        off = off_dots(stream.view, marks.dots_mm, marks.diameter_mm)
        shared: dict[str, FlowMethod] = {}
        trackers = [FlowTracker(f"farneback/{total}", renew_share=share, shared=shared)
                    for share, total in ways]  # fmt: skip
        trackers.append(FlowTracker(FlowTracker.PAPER))
        sums, pixels, switches = np.zeros(len(trackers)), 0, [0] * len(trackers)
        for frame in stream.frames():
            image = stream.tracker_image(picture.expose(frame.at_px, noise, frame.displacement_mm))
            true = frame.true
            moving = off & (true.moving if true else False)
            pixels += int(moving.sum())
            for k, tracker in enumerate(trackers):
                found = tracker.update(image)
                if true:
                    off_px = np.linalg.norm(found.flow_px[moving] - true.flow_px[moving], axis=-1)
                    sums[k] += off_px.sum() * stream.view.mm_per_px
                switches[k] = found.diagnostics.n_reference_switches
        cells = [f"{total / pixels:.3f} ({n})" for total, n in zip(sums, switches, strict=True)]
        yield f"| {entry.name} | {' | '.join(cells)} |"


def main(words: list[str]) -> None:
    """The table, and that of a press."""
    rig = f"edges x {1 + EDGES:g}, mean grey {MEAN_GREY:g}"
    print(f"| pattern | threshold, {FlowTracker.RENEW_SHARE:g} of its own | most it can see | "
          f"published, {RENEW_GREY:g} needed | dots moved | {rig} | dots moved |",
          "|---" * 7 + "|", sep="\n")  # fmt: skip
    for name, threshold, most, coarse in seen():
        pairs = [(most, threshold), *((value, RENEW_GREY) for value in coarse)]
        cells = [f"{value:.1f}{' never' if value <= limit else ''}" for value, limit in pairs]
        print(f"| {name} | {threshold:.1f} | {' | '.join(cells)} |", flush=True)
    for press in words:
        print(f"\n{press}: mean error, mm (renewals), by share and sum; simulated\n")
        for line in by_share(press):
            print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
