"""Images in, results out: one after another, or with their parts side by side over cores."""

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
from ..flow.fused import Sampled, to_gray, to_half
from ..flow.tracker import FlowTracker
from ..health import Health
from ..sensor_id import SensorModel
from .outputs import OUTPUTS, Calibration, Estimators, MeasurementResult


class Rectifier:
    """Takes images of one camera, as its lens makes them or rectified already; maps made once."""

    def __init__(self, camera: CameraModel) -> None:
        raw = camera.lens if isinstance(camera, Rectified) else camera
        self._raw_px, self._maps = (raw.width_px, raw.height_px), camera.maps()
        self._view_px = camera.width_px, camera.height_px
        if self._maps is not None:
            self._nodes_px = to_half(np.stack(self._maps, axis=-1))

    def view(self, image: Array) -> Array:
        """The whole rectified image (h, w[, 3]). Raises InputError for a size that is neither."""
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

    def sampled(self, image: Array) -> Array | Sampled:
        """What the tracker reads: a raw colour image's luma, and all channels at the nodes alone.

        It saves half of the rectification. Raises as `view`.
        """
        raw = self._maps is not None and image.shape[1::-1] == self._raw_px
        if not raw or self._maps is None or image.ndim != 3 or image.dtype != np.uint8:
            return self.view(image)
        luma = cv2.remap(to_gray(image), *self._maps, cv2.INTER_CUBIC)
        return Sampled(luma, sample(image, self._nodes_px))


TRUSTED_SHARE = 0.5
"""Of the first image's markers, that must be held: as many as `DotTracker` asks of its first."""
Step = Callable[["ImageTask"], None]


@dataclass
class Since:
    """What goes on from one reference image to the next; markers, count: of `MarkerMeasurement`."""

    tracker: FlowTracker
    health: Health | None = None
    markers: DotTracker | None = None
    count: int = 0


@dataclass
class ImageTask:
    """One image on its way. made: what the steps so far made of it."""

    since: Since
    t_s: float
    made: tuple[Any, ...]
    result: MeasurementResult | None = None
    error: Exception | None = None


class Measurement:
    """Measures a sequence of images of one sensor.

    view: of the sensor; for the output "flow" its rectified camera does, and a calibration of force
    brings its own gel. include: outputs, see `OUTPUTS`, None: all that the calibrations allow; only
    what they need is run. calibrations: what the outputs need of them, at most one a kind. every:
    px between the points of the flow that is given out, 2, 4, 8 ... Raises InputError for unknown
    names and for a calibration that is missing, given twice or another sensor's.

    The first image is the reference that all motion is counted from.
    """

    OUTPUTS: ClassVar = OUTPUTS

    def __init__(
        self,
        view: SensorModel | CameraModel,
        include: Sequence[str] | None = ("flow",),
        calibrations: Sequence[Calibration] = (),
        *,
        every: int = 2,
    ) -> None:
        self._estimators = Estimators(view, calibrations)
        self.view, self.include = self._estimators.view, tuple(include or ())
        if include is None:
            self.include = self._estimators.allowed
        self._every = every
        self._estimators.prepare(self.include)
        self._rectify = Rectifier(self.view.camera)
        self._lock = Lock()
        self._busy = False
        self.reset()

    @staticmethod
    def of_markers(camera: CameraModel) -> Measurement:
        """Measurement of a skin of markers instead of a dense pattern, in images of this camera."""
        return MarkerMeasurement(camera)

    def rectified(self, image: Array) -> Array:
        """The whole of an image as it is tracked. Raises InputError for another size."""
        return self._rectify.view(image)

    def reset(self, reference: Array | None = None) -> None:
        """A new reference: this image, or the next one that is given.

        May be called at any time and from any thread. Images given before are finished with the
        reference that they were given under. Raises as `update`, and then changes nothing.
        """
        since = Since(FlowTracker(full=False))
        if reference is not None:
            self._ready(since, reference)
        self._since = since

    def update(self, image: Array, t_s: float | None = None) -> MeasurementResult:
        """Measure one image, (h, w, 3) BGR or (h, w) grey, uint8, raw or rectified.

        From one thread at a time; `Pipeline` takes images while others are still measured.
        t_s: when it was taken, on the clock of `time.monotonic`; by default now. Raises InputError
        for an image of another size or type than the view's, the lens's or the reference's,
        SensorError for a reference without texture.
        """
        if self._busy:
            raise RuntimeError("a pipeline has this measurement; give it the images")
        job = self.job(image, t_s)
        for step in self.steps():
            step(job)
        assert job.result is not None, "the last step makes it"
        return job.result

    def job(self, image: Array, t_s: float | None = None) -> ImageTask:
        """An image to be measured against the reference of now."""
        return ImageTask(self._since, time.monotonic() if t_s is None else t_s, (image,))

    def steps(self) -> tuple[Step, ...]:
        """The parts that may run side by side, each taking the jobs in their order."""
        return (self._prepare, self._follow, self._finish)

    def take(self, busy: bool) -> None:
        """For the one pipeline that runs this measurement. Raises RuntimeError for a second one."""
        with self._lock:
            if busy and self._busy:
                raise RuntimeError("another pipeline has this measurement")
            self._busy = busy

    def _prepare(self, job: ImageTask) -> None:
        (image,) = job.made
        job.made = (self._ready(job.since, image),)

    def _ready(self, since: Since, image: Array) -> PreparedImage:
        ready = since.tracker.prepare(self._rectify.sampled(image))
        if ready.frame == 0:
            since.health = self._estimators.health(self._rectify.view(image))
        return ready

    def _follow(self, job: ImageTask) -> None:
        (ready,) = job.made
        job.made = (ready, job.since.tracker.follow(ready))

    def _finish(self, job: ImageTask) -> None:
        seen = job.since.tracker.judge(*job.made)
        job.made = ()
        outputs = self._estimators.outputs(self.include, seen, self._every)
        job.result = MeasurementResult(
            seen.diagnostics.frame,
            job.t_s,
            (time.monotonic() - job.t_s) * 1e3,
            float(np.mean(seen.visible & (seen.state > 0))),
            seen.diagnostics.trusted,
            job.since.health,
            **outputs,
        )


class MarkerMeasurement(Measurement):
    """As Measurement, of the markers that the first image after each `reset` shows.

    camera: of the images. `update` raises as `DotTracker.from_image` does of a first image.
    """

    def __init__(self, camera: CameraModel) -> None:
        super().__init__(camera, ())

    def steps(self) -> tuple[Step, ...]:
        return (self._measure,)

    def _ready(self, since: Since, image: Array) -> Array:  # type: ignore[override]
        seen = self.rectified(image)
        if since.markers is None:
            since.markers = DotTracker.from_image(seen)
            since.markers.update(seen)  # now, for a reference is given once
        return seen

    def _measure(self, job: ImageTask) -> None:
        (image,), since = job.made, job.since
        ready = self._ready(since, image)
        assert since.markers is not None, "made ready"
        seen = since.markers.update(ready)
        held = float(seen.located.mean())
        job.made = ()
        age_ms = (time.monotonic() - job.t_s) * 1e3
        job.result = MeasurementResult(
            since.count, job.t_s, age_ms, held, held >= TRUSTED_SHARE, markers=seen
        )
        since.count += 1


Policy = Literal["every", "newest"]
_Belt = Queue[ImageTask | None]  # None: nothing more will come
_KEPT = 64  # results of a live source that wait to be read


class Pipeline:
    """Runs the parts of one measurement in a thread each.

    policy: "every" image is measured, `submit` waits for room: for files. "newest": an image that
    waits gives way to a newer one, and so does a result that no one reads: for cameras; `dropped`
    counts both. While it is open the measurement's own `update` is refused; `reset` works.

        with Pipeline(measurement) as p:
            for image in images:
                p.submit(image)
        for result in p.results():
            ...
    """

    def __init__(self, measurement: Measurement, policy: Policy = "every") -> None:
        measurement.take(True)
        self.measurement, self.policy = measurement, policy
        self._giving, self._closed, self._fell = Lock(), False, {0: 0, -1: 0}
        steps = measurement.steps()
        self._belts: list[_Belt] = [*(Queue(1) for _ in steps), Queue()]
        self._threads = [
            Thread(target=self._work, args=(step, *ends), daemon=True)
            for step, *ends in zip(steps, self._belts, self._belts[1:], strict=False)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def dropped(self) -> int:
        """Images and results that gave way so far."""
        return sum(self._fell.values())

    def submit(self, image: Array, t_s: float | None = None) -> None:
        """Give one image, as to `Measurement.update`; it must not be changed afterwards.

        What is wrong with it is raised where its result is asked for. Raises RuntimeError when the
        pipeline is closed.
        """
        job = self.measurement.job(image, t_s)
        with self._giving:
            if self._closed:
                raise RuntimeError("the pipeline is closed")
            self._make_room(0, 1)
            self._belts[0].put(job)

    def result(self, timeout_s: float | None = None) -> MeasurementResult | None:
        """The next result, in the order of the images; None when closed and none is left.

        Raises what the stages raise of its image, TimeoutError when none came in time.
        """
        try:
            job = self._belts[-1].get(timeout=timeout_s)
        except Empty:
            raise TimeoutError from None
        if job is None:
            self._belts[-1].put(None)  # for whoever asks again
            return None
        if job.error is not None:
            raise job.error
        return job.result

    def results(self) -> Iterator[MeasurementResult]:
        """All results until the pipeline closes. Raises as `result`; may then be called again."""
        while (result := self.result()) is not None:
            yield result

    def close(self) -> None:
        """Finish what was given and let the measurement go; results can still be read.

        From any thread, and more than once.
        """
        with self._giving:
            first, self._closed = not self._closed, True
            if first:
                self._belts[0].put(None)
        for thread in self._threads:
            thread.join()
        if first:
            self.measurement.take(False)

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _make_room(self, which: int, size: int) -> None:
        """On a belt of a live source: what waits longest falls off."""
        while self.policy == "newest" and self._belts[which].qsize() >= size:
            try:
                self._belts[which].get_nowait()
            except Empty:  # taken meanwhile
                return
            self._fell[which] += 1

    def _work(self, step: Step, before: _Belt, after: _Belt) -> None:
        while (job := before.get()) is not None:
            if job.error is None:
                try:
                    step(job)
                except Exception as why:  # whoever asks for the result gets it
                    job.error = why
            if after is self._belts[-1]:
                self._make_room(-1, _KEPT)
            after.put(job)
        after.put(None)
