"""Measurement of images, sequentially or pipelined over cores."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from queue import Empty, Queue
from threading import Lock, Thread
from typing import Any, ClassVar, Literal

import cv2
import numpy as np

from deltact_fab.common import Array, InputError
from deltact_fab.sensor import CameraModel, Rectified

from ..compose import sample
from ..dots.tracker import DotTracker
from ..flow.confidence import PreparedImage
from ..flow.fused import SampledImage, to_gray, to_half
from ..flow.tracker import FlowTracker
from ..health import Health
from ..sensor_id import SensorModel
from .outputs import OUTPUT_NAMES, Calibration, Estimators, MeasurementResult


class Rectifier:
    """Rectifier of images of one camera, raw or already rectified; maps are computed once."""

    def __init__(self, camera: CameraModel) -> None:
        raw = camera.lens if isinstance(camera, Rectified) else camera
        self._raw_px, self._maps = (raw.width_px, raw.height_px), camera.maps()
        self._view_px = camera.width_px, camera.height_px
        if self._maps is not None:
            self._nodes_px = to_half(np.stack(self._maps, axis=-1))

    def view(self, image: Array) -> Array:
        """Return the full rectified image (h, w[, 3]). Raises InputError for another size."""
        size = image.shape[1::-1]
        if size not in (self._raw_px, self._view_px):
            w, h = self._raw_px
            lens = "" if self._maps is None else f", the lens makes {w} x {h} px"
            raise InputError(
                f"an image of {size[0]} x {size[1]} px; the view has {self._view_px[0]} x "
                f"{self._view_px[1]} px{lens}"
            )
        if self._maps is None or size != self._raw_px:
            return image
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_CUBIC))

    def sampled(self, image: Array) -> Array | SampledImage:
        """Rectify the input of the tracker: luma of a raw colour image, all channels at nodes only.

        Saves half of the rectification. Raises as `view`.
        """
        raw = self._maps is not None and image.shape[1::-1] == self._raw_px
        if not raw or self._maps is None or image.ndim != 3 or image.dtype != np.uint8:
            return self.view(image)
        luma = cv2.remap(to_gray(image), *self._maps, cv2.INTER_CUBIC)
        return SampledImage(luma, sample(image, self._nodes_px))


TRUSTED_MARKER_SHARE = 0.5
"""Fraction of the first image's markers to be tracked; by hand: as in `DotTracker`."""
Step = Callable[["ImageTask"], None]


@dataclass
class ReferenceState:
    """State since a reference image; markers, count: of `MarkerMeasurement`."""

    tracker: FlowTracker
    health: Health | None = None
    markers: DotTracker | None = None
    count: int = 0


@dataclass
class ImageTask:
    """Image in progress. data: results of the previous step."""

    reference: ReferenceState
    t_s: float
    data: tuple[Any, ...]
    result: MeasurementResult | None = None
    error: Exception | None = None


class Measurement:
    """Measures a sequence of images of one sensor.

    view: the sensor; for the output "flow" its rectified camera suffices, and a force calibration
    contains its own gel. include: outputs, see `OUTPUTS`; None: all that the calibrations allow.
    Only required parts run. calibrations: at most one per kind. spacing_px: px between the points
    of the output "flow", 2, 4, 8 ... Raises InputError for unknown names and for a calibration
    that is missing, given twice or another sensor's.

    The first image is the reference of all motion.
    """

    OUTPUTS: ClassVar = OUTPUT_NAMES

    def __init__(
        self,
        view: SensorModel | CameraModel,
        include: Sequence[str] | None = ("flow",),
        calibrations: Sequence[Calibration] = (),
        *,
        spacing_px: int = 2,
    ) -> None:
        self._estimators = Estimators(view, calibrations)
        self.view, self.include = self._estimators.view, tuple(include or ())
        if include is None:
            self.include = self._estimators.allowed
        self._spacing_px = spacing_px
        self._estimators.prepare(self.include)
        self._rectify = Rectifier(self.view.camera)
        self._lock = Lock()
        self._busy = False
        self.reset()

    @staticmethod
    def of_markers(camera: CameraModel) -> Measurement:
        """Return a measurement of a skin of markers instead of a dense pattern."""
        return MarkerMeasurement(camera)

    def rectified(self, image: Array) -> Array:
        """Return the full image as it is tracked. Raises InputError for another size."""
        return self._rectify.view(image)

    def reset(self, reference: Array | None = None) -> None:
        """Set a new reference: this image, or the next one.

        May be called at any time and from any thread. Earlier images are still measured against
        the earlier reference. Raises as `update`, and then changes nothing.
        """
        since = ReferenceState(FlowTracker(full=False))
        if reference is not None:
            self._ready(since, reference)
        self._since = since

    def update(self, image: Array, t_s: float | None = None) -> MeasurementResult:
        """Measure one image, (h, w, 3) BGR or (h, w) grey, uint8, raw or rectified.

        From one thread at a time; `Pipeline` takes images while others are still measured.
        t_s: time of capture on the clock of `time.monotonic`; by default now. Raises InputError
        for an image of another size or type than that of the view, the lens or the reference,
        SensorError for a reference without texture.
        """
        if self._busy:
            raise RuntimeError("a pipeline runs this measurement; submit the images to it")
        job = self.job(image, t_s)
        for step in self.steps():
            step(job)
        assert job.result is not None, "the last step makes it"
        return job.result

    def job(self, image: Array, t_s: float | None = None) -> ImageTask:
        """Create the task of an image, to be measured against the current reference."""
        return ImageTask(self._since, time.monotonic() if t_s is None else t_s, (image,))

    def steps(self) -> tuple[Step, ...]:
        """Return the parts that may run in parallel, each taking the tasks in order."""
        return (self._prepare, self._follow, self._finish)

    def claim(self, busy: bool) -> None:
        """Claim or release this measurement for a pipeline. Raises RuntimeError if it has one."""
        with self._lock:
            if busy and self._busy:
                raise RuntimeError("another pipeline runs this measurement")
            self._busy = busy

    def _prepare(self, job: ImageTask) -> None:
        (image,) = job.data
        job.data = (self._ready(job.reference, image),)

    def _ready(self, since: ReferenceState, image: Array) -> PreparedImage:
        ready = since.tracker.prepare(self._rectify.sampled(image))
        if ready.frame == 0:
            since.health = self._estimators.health(self._rectify.view(image))
        return ready

    def _follow(self, job: ImageTask) -> None:
        (ready,) = job.data
        job.data = (ready, job.reference.tracker.follow(ready))

    def _finish(self, job: ImageTask) -> None:
        observation = job.reference.tracker.judge(*job.data)
        job.data = ()
        outputs = self._estimators.outputs(self.include, observation, self._spacing_px)
        job.result = MeasurementResult(
            observation.diagnostics.frame,
            job.t_s,
            (time.monotonic() - job.t_s) * 1e3,
            float(np.mean(observation.visible & (observation.state > 0))),
            observation.diagnostics.trusted,
            job.reference.health,
            **outputs,
        )


class MarkerMeasurement(Measurement):
    """Measurement of the markers in the first image after each `reset`.

    camera: of the images. `update` raises as `DotTracker.from_image` for the first image.
    """

    def __init__(self, camera: CameraModel) -> None:
        super().__init__(camera, ())

    def steps(self) -> tuple[Step, ...]:
        return (self._measure,)

    def _ready(self, since: ReferenceState, image: Array) -> Array:  # type: ignore[override]
        frame = self.rectified(image)
        if since.markers is None:
            since.markers = DotTracker.from_image(frame)
            since.markers.update(frame)  # the reference is processed only once
        return frame

    def _measure(self, job: ImageTask) -> None:
        (image,), since = job.data, job.reference
        ready = self._ready(since, image)
        assert since.markers is not None, "made ready"
        dots = since.markers.update(ready)
        share = float(dots.located.mean())
        job.data = ()
        age_ms = (time.monotonic() - job.t_s) * 1e3
        job.result = MeasurementResult(
            since.count, job.t_s, age_ms, share, share >= TRUSTED_MARKER_SHARE, markers=dots
        )
        since.count += 1


Policy = Literal["every", "newest"]
_TaskQueue = Queue[ImageTask | None]  # None: end of the images
_MAX_WAITING = 64  # unread results of a live source; by hand: bounds memory and latency


class Pipeline:
    """Pipeline that runs each part of a measurement in its own thread.

    policy: "every" image is measured and `submit` blocks, for files. "newest": a waiting image is
    replaced by a newer one, and so is an unread result, for cameras; `dropped` counts both. While
    it is open, `Measurement.update` is refused; `reset` works.

        with Pipeline(measurement) as p:
            for image in images:
                p.submit(image)
        for result in p.results():
            ...
    """

    def __init__(self, measurement: Measurement, policy: Policy = "every") -> None:
        measurement.claim(True)
        self.measurement, self.policy = measurement, policy
        self._submit_lock, self._closed, self._dropped = Lock(), False, {0: 0, -1: 0}
        steps = measurement.steps()
        self._queues: list[_TaskQueue] = [*(Queue(1) for _ in steps), Queue()]
        self._threads = [
            Thread(target=self._work, args=(step, *ends), daemon=True)
            for step, *ends in zip(steps, self._queues, self._queues[1:], strict=False)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def dropped(self) -> int:
        """Number of images and results dropped so far."""
        return sum(self._dropped.values())

    def submit(self, image: Array, t_s: float | None = None) -> None:
        """Submit an image, as to `Measurement.update`; it must not be changed afterwards.

        Errors of the image are raised by `result`. Raises RuntimeError if the pipeline is closed.
        """
        job = self.measurement.job(image, t_s)
        with self._submit_lock:
            if self._closed:
                raise RuntimeError("the pipeline is closed")
            self._make_room(0, 1)
            self._queues[0].put(job)

    def result(self, timeout_s: float | None = None) -> MeasurementResult | None:
        """Return the next result, in the order of the images; None after the last one when closed.

        Raises the errors of its image, TimeoutError if there is no result in time.
        """
        try:
            job = self._queues[-1].get(timeout=timeout_s)
        except Empty:
            raise TimeoutError from None
        if job is None:
            self._queues[-1].put(None)  # for later calls
            return None
        if job.error is not None:
            raise job.error
        return job.result

    def results(self) -> Iterator[MeasurementResult]:
        """Yield all results until the pipeline closes. Raises as `result`; can be resumed then."""
        while (result := self.result()) is not None:
            yield result

    def close(self) -> None:
        """Finish the submitted images and release the measurement; results can still be read.

        May be called from any thread, and repeatedly.
        """
        with self._submit_lock:
            first, self._closed = not self._closed, True
            if first:
                self._queues[0].put(None)
        for thread in self._threads:
            thread.join()
        if first:
            self.measurement.claim(False)

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _make_room(self, index: int, size: int) -> None:
        """Drop the oldest entries of a queue of a live source."""
        while self.policy == "newest" and self._queues[index].qsize() >= size:
            try:
                self._queues[index].get_nowait()
            except Empty:  # taken meanwhile
                return
            self._dropped[index] += 1

    def _work(self, step: Step, source: _TaskQueue, target: _TaskQueue) -> None:
        while (job := source.get()) is not None:
            if job.error is None:
                try:
                    step(job)
                except Exception as error:  # raised by `result`
                    job.error = error
            if target is self._queues[-1]:
                self._make_room(-1, _MAX_WAITING)
            target.put(job)
        target.put(None)
