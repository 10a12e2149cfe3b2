"""A source's images through a measurement, with what belongs together kept together."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..measure.pipeline import Measurement, Pipeline, Result
from ..measure.recognised import SeenPattern
from ..rig.interface import CameraFrame
from .motion import Motion
from .open import images
from .source import Source

RATE_S = 2.0
"""Over so long the rate of results is taken."""
PATIENCE_S = 2.0
"""So long the source may take to deliver its last image when nobody wants more."""


@dataclass(frozen=True)
class SourceImage:
    """An image on its way. frame: its number in the source. t_s: when it was taken, by the source's
    clock; given_s: the time that its result's age counts from, by `time.monotonic`."""

    frame: int
    t_s: float
    image: NDArray[np.uint8]
    given_s: float


@dataclass(frozen=True)
class MeasuredImage:
    """An image and its result; a gap in the numbers of the images is those that were dropped.

    hz: results a second. dropped: images and results that gave way to newer ones, so far, with
    the images that the camera lost. motion: of the pattern in the picture.
    """

    given: SourceImage
    result: Result
    hz: float
    dropped: int
    motion: Motion


class Session:
    """Measures all images of a source until it ends or its results are no longer read.

    going: False while nothing is to be measured; waits so many seconds for that to change.
    """

    def __init__(
        self,
        source: Source,
        measurement: Measurement,
        *,
        most_hz: float | None = None,
        frames: Iterator[CameraFrame] | None = None,
        pattern: SeenPattern | None = None,
    ) -> None:
        """most_hz: of a source that is not live, so many images a second are measured at most.

        frames: those of the source, where the first was looked at already. pattern: what it shows,
        where the source did not know.
        """
        self.source, self.measurement, self.pattern = source, measurement, pattern
        assert source.known.camera is not None, "open_source makes sure of it"
        self.view = source.known.camera
        """Of the images as they are tracked."""
        self._least_s = 0.0 if most_hz is None or source.live else 1 / most_hz
        self.going: Callable[[float], bool] = lambda timeout_s: True
        self._frames = images(source) if frames is None else frames
        self._stopped = False
        self._error: BaseException | None = None
        self._given: deque[SourceImage] = deque()
        self._lost = 0

    def results(self) -> Iterator[MeasuredImage]:
        """What was measured, in order. Raises what the source or the measurement raises."""
        times: deque[float] = deque()
        live = self.source.live
        with Pipeline(self.measurement, "newest" if live else "every") as pipeline:
            feeder = threading.Thread(target=self._feed, args=(pipeline,), daemon=True)
            feeder.start()
            try:
                for result in pipeline.results():
                    now_s = time.monotonic()
                    times.append(now_s)
                    while now_s - times[0] > RATE_S:
                        times.popleft()
                    hz = (len(times) - 1) / (now_s - times[0]) if len(times) > 1 else 0.0
                    given = self._given.popleft()
                    while given.given_s != result.t_s:  # those between were dropped
                        given = self._given.popleft()
                    motion = Motion.of(result, self.view, self.source.known.in_px)
                    yield MeasuredImage(given, result, hz, pipeline.dropped + self._lost, motion)
            finally:
                self._stopped = True
                feeder.join(PATIENCE_S)
        if self._error is not None:
            raise self._error

    def rectified(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """An image of the source as it is tracked."""
        return self.measurement.rectified(image)

    def _feed(self, pipeline: Pipeline) -> None:
        """Give every image to the pipeline, which drops those that it has no time for."""
        flat = self.source.known.flat
        try:
            for k, frame in enumerate(self._frames):
                began_s = time.monotonic()
                self._lost += frame.dropped
                while not self.going(0.1) and not self.source.live and not self._stopped:
                    pass
                if self._stopped:
                    break
                if not self.going(0.0):
                    continue
                image = frame.image if flat is None else flat.apply(self.rectified(frame.image))
                given = SourceImage(k, frame.t_s, image, frame.t_s if self.source.live else began_s)
                self._given.append(given)
                pipeline.submit(image, given.given_s)
                if self._least_s:
                    time.sleep(max(0.0, began_s + self._least_s - time.monotonic()))
        except Exception as why:  # raised where the results are read
            self._error = None if self._stopped else why
        finally:
            self.source.close()
            pipeline.close()
