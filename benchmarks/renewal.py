"""Whether the renewal of the paper's reference can fire: what it can see on each pattern.

    python -m benchmarks.renewal              # the paper's 17 patterns, in a minute
    python -m benchmarks.renewal PRESS        # and errors by three shares under a press of
                                              # pattern-selection, as 4dots/p1: minutes a pattern

The most that the rule can see is the difference of two prints of a pattern, of other seeds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from deltact_fab.common.aliases import Image
from deltact_fab.estimate.analysis.tracking_error.tally import off_dots
from deltact_fab.estimate.measure.flow.fused import to_gray
from deltact_fab.estimate.measure.flow.renewed import (
    FlowMethod,
    photometric_error,
    unrelated_difference,
)
from deltact_fab.estimate.measure.flow.tracker import FlowReference, FlowTracker
from deltact_fab.fabricate.patterns.recipe import PatternRecipe
from deltact_fab.fabricate.patterns.series import list_series
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.virtual.picture import FrameRenderer, PictureGeometry
from deltact_fab.studies.study.pattern_selection import Selection
from deltact_fab.studies.study.registry import StudyRequest, load_virtual_rig
from deltact_fab.studies.study.stream import PressStream

SHARES = (0.25, 0.5, 0.75)
SHOWN = ("d0p05-r0p5", "d0p075-r0p6", "d0p1-r0p5", "d0p15-r0p3", "d0p2-r0p1")


def seen() -> Iterator[tuple[str, float, float]]:
    """Of each pattern of the paper: the rule's threshold, and the most that it can see, in grey
    levels of the virtual rig's camera.
    """
    config, geometry = load_virtual_rig("virtual")[0], PictureGeometry.resting(SensorDimensions())

    def at_rest_of(recipe: PatternRecipe, seed: int) -> Image:
        picture = FrameRenderer.printed(geometry, config.virtual, recipe, seed)
        return to_gray(picture.render(None, FrameRenderer.noise(seed, "")))

    for entry in list_series():
        own = at_rest_of(entry.recipe, 1)
        other = at_rest_of(entry.recipe.model_copy(update={"seed": entry.recipe.seed + 1}), 2)
        still = np.zeros((*own.shape, 2), np.float32)
        most = photometric_error(own, other, still)
        yield entry.name, FlowTracker.RENEW_SHARE * unrelated_difference(own), most


def by_share(press: str) -> Iterator[str]:
    """Rows of markdown: mean error of moving pixels, mm, and renewals, by share and sum."""
    scene = Selection.from_request(StudyRequest())
    of = scene.scene
    stream = PressStream(scene.protocol, press, of.sensor, of.rig, of.source)
    totals: tuple[FlowReference, ...] = ("summed", "composed")
    ways = [(share, total) for share in SHARES for total in totals]
    yield "| pattern | " + " | ".join(f"{share:g}, {total}" for share, total in ways) + " |"
    yield "|---" * (len(ways) + 1) + "|"
    for entry in (e for e in scene.entries if e.name in SHOWN):
        picture, noise = stream.picture(entry.recipe, 0), stream.noise(0)
        marks = stream.marks(entry.recipe)
        off = off_dots(stream.view, marks.dots_mm, marks.diameter_mm)
        method = FlowMethod("farneback-paper")
        trackers = [FlowTracker(method, total, renew_share=share)
                    for share, total in ways]  # fmt: skip
        sums, pixels, switches = np.zeros(len(ways)), 0, [0] * len(ways)
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
    print(f"| pattern | threshold, {FlowTracker.RENEW_SHARE:g} of its own | most it can see |",
          "|---|---|---|", sep="\n")  # fmt: skip
    for name, threshold, most in seen():
        print(f"| {name} | {threshold:.1f} | {most:.1f}{' never' if most <= threshold else ''} |",
              flush=True)  # fmt: skip
    for press in words:
        print(f"\n{press}: mean error, mm (renewals), by share and sum; simulated\n")
        for line in by_share(press):
            print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
