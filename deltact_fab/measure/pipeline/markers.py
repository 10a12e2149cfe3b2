"""A skin of markers through the same pipeline: each is followed, and nothing between them."""

from __future__ import annotations

import time

from ...aliases import Array
from ...optics import CameraModel
from ..dots import DotTracker
from .measurement import ImageTask, Measurement, Since, Step
from .result import Result

TRUSTED_SHARE = 0.5
"""Of the first image's markers, that must be held: as many as `DotTracker` asks of its first."""


class MarkerMeasurement(Measurement):
    """As Measurement, of the markers that the first image after each `reset` shows.

    camera: of the images. `update` raises as `DotTracker.found_in` does of a first image.
    """

    def __init__(self, camera: CameraModel) -> None:
        super().__init__(camera, ())

    @property
    def stages(self) -> tuple[str, ...]:
        """As Measurement."""
        return ("markers",)

    def steps(self) -> tuple[Step, ...]:
        """As Measurement; one part, for it takes a few milliseconds."""
        return (self._measure,)

    def _ready(self, since: Since, image: Array) -> Array:  # type: ignore[override]
        seen = self.rectified(image)
        if since.markers is None:
            since.markers = DotTracker.found_in(seen)
            since.markers.update(seen)  # now, for a reference is given once
        return seen

    def _measure(self, job: ImageTask) -> None:
        (image,), since = job.made, job.since
        ready = self._ready(since, image)
        assert since.markers is not None, "made ready"
        seen = since.markers.update(ready)
        held = float(seen.found.mean())
        job.made = ()
        age_ms = (time.monotonic() - job.t_s) * 1e3
        job.result = Result(since.count, job.t_s, age_ms, held, held >= TRUSTED_SHARE, markers=seen)
        since.count += 1
