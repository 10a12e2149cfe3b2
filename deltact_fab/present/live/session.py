"""Measurement session: images of a named source through a measurement to results.

The outputs are chosen by the known model of the source's sensor.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import CameraFrame
from deltact_fab.common import Array, InputError, did_you_mean
from deltact_fab.estimate import FaceFlow, Measurement, MeasurementResult, Pipeline, RestPattern
from deltact_fab.sensor import CameraModel, Pinhole

from .open import load_model, open_measurement, open_source
from .source import Source, images

RATE_WINDOW_S = 2.0  # averaging time of the result rate; by hand: steady against prompt
CLOSE_TIMEOUT_S = 2.0  # by hand: longest wait for a source's last image at the end


@dataclass(frozen=True)
class SourceImage:
    """Image of a source. frame: its number in the source. t_s: when it was taken, by the source's
    clock; age_from_s: start of its result's age, by `time.monotonic`."""

    frame: int
    t_s: float
    image: NDArray[np.uint8]
    age_from_s: float


@dataclass(frozen=True)
class Motion:
    """Motion since rest. largest_px, median_px: length where known, None if nowhere.

    largest_mm: largest_px on the face, None without a scale (in_px). markers, markers_held: number
    in the first image, and those of them found in this one; None of a dense pattern.
    """

    largest_px: float | None
    median_px: float | None
    largest_mm: float | None
    in_px: bool
    markers: int | None = None
    markers_held: int | None = None

    @classmethod
    def from_result(cls, result: MeasurementResult, camera: CameraModel, in_px: bool) -> Motion:
        """Summarise a result with "observation" or markers; camera: of the tracked images."""
        counts: tuple[int, ...] = ()
        if (dots := result.markers) is not None:
            shift_px = dots.displacement_px[dots.located]
            counts = len(dots.located), len(shift_px)
        else:
            assert result.observation is not None, "`open_measurement` includes it"
            flow = FaceFlow.from_flow(result.observation, camera, FaceFlow.SPACING_PX)
            shift_px = flow.shift_mm[flow.known] / np.float32(camera.mm_per_px)
        size = np.hypot(*shift_px.T)
        largest, median = (float(size.max()), float(np.median(size))) if len(size) else (None, None)
        mm = None if in_px or largest is None else largest * camera.mm_per_px
        return cls(largest, median, mm, in_px, *counts)


@dataclass(frozen=True)
class MeasuredImage:
    """An image and its result; gaps in the numbers of the images are dropped images.

    hz: results per second. dropped: images and results dropped so far in favour of newer ones,
    including the camera's lost images. motion: of the pattern in the image.
    """

    source: SourceImage
    result: MeasurementResult
    hz: float
    dropped: int
    motion: Motion


class MeasurementSession:
    """Measures all images of a source until it ends or its results are no longer read."""

    def __init__(
        self,
        source: Source,
        measurement: Measurement,
        *,
        most_hz: float | None = None,
        frames: Iterator[CameraFrame] | None = None,
        pattern: RestPattern | None = None,
    ) -> None:
        """most_hz: largest number of images per second, of a source that is not live.

        frames: of the source, if the first was already read. pattern: recognised in the first
        image, if the source did not know it.
        """
        self.source, self.measurement, self.pattern = source, measurement, pattern
        self.view = source.model.camera
        """Camera of the tracked images."""
        self._least_s = 0.0 if most_hz is None or source.live else 1 / most_hz
        self._frames = images(source) if frames is None else frames
        self._stopped = False
        self._error: BaseException | None = None
        self._pending: deque[SourceImage] = deque()
        self._drops = 0

    def results(self) -> Iterator[MeasuredImage]:
        """Yield the results in order. Raises the errors of the source and the measurement."""
        times: deque[float] = deque()
        live = self.source.live
        with Pipeline(self.measurement, "newest" if live else "every") as pipeline:
            feeder = threading.Thread(target=self._feed, args=(pipeline,), daemon=True)
            feeder.start()
            try:
                for result in pipeline.results():
                    now_s = time.monotonic()
                    times.append(now_s)
                    while now_s - times[0] > RATE_WINDOW_S:
                        times.popleft()
                    hz = (len(times) - 1) / (now_s - times[0]) if len(times) > 1 else 0.0
                    image = self._pending.popleft()
                    while image.age_from_s != result.t_s:  # those between were dropped
                        image = self._pending.popleft()
                    motion = Motion.from_result(result, self.view, self.source.model.in_px)
                    yield MeasuredImage(image, result, hz, pipeline.dropped + self._drops, motion)
            finally:
                self._stopped = True
                feeder.join(CLOSE_TIMEOUT_S)
        if self._error is not None:
            raise self._error

    def rectified(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Rectify an image of the source for tracking."""
        return self.measurement.rectified(image)

    def _feed(self, pipeline: Pipeline) -> None:
        """Submit every image to the pipeline, which drops those it has no time for."""
        flat = self.source.model.flat
        try:
            for k, frame in enumerate(self._frames):
                began_s = time.monotonic()
                self._drops += frame.dropped
                if self._stopped:
                    break
                image = frame.image if flat is None else flat.apply(self.rectified(frame.image))
                taken_s = frame.t_s if self.source.live else began_s
                queued = SourceImage(k, frame.t_s, image, taken_s)
                self._pending.append(queued)
                pipeline.submit(image, queued.age_from_s)
                if self._least_s:
                    time.sleep(max(0.0, began_s + self._least_s - time.monotonic()))
        except Exception as error:  # raised where the results are read
            self._error = None if self._stopped else error
        finally:
            self.source.close()
            pipeline.close()


def open_session(
    name: str,
    camera_file: Path | None = None,
    calibrations: Sequence[Path] = (),
    show: Sequence[str] | None = None,
    *,
    design: str | None = None,
    serial: str | None = None,
    seed: int = 0,
    mm_per_px: float | None = None,
    follow_s: float | None = None,
    most_hz: float | None = None,
) -> MeasurementSession:
    """Open a source and its measurement; `results` then measures its images.

    name, camera_file, design, serial, seed, follow_s: see `open_source`; calibrations, show: see
    `open_measurement`; most_hz: see MeasurementSession. mm_per_px: of the resting face, if the
    camera is unknown; without both, lengths are in pixels. If the pattern is unknown and there is
    no calibration, the first image decides between dense pattern and markers. Raises InputError,
    one line, and the source's errors.
    """
    source = open_source(name, camera_file, design, serial, seed, follow_s=follow_s)
    try:
        frames, model = images(source), source.model
        if model.projection is not None and mm_per_px is not None:
            raise InputError(f"{name}: --mm-per-px: the source's camera already gives the scale")
        if model.projection is None and calibrations:
            raise InputError(
                f"{calibrations[0]}: a calibration is valid for its own camera only: give that "
                "camera's file with --camera"
            )
        if model.projection is not None and (calibrations or model.recipe is not None):
            measurement = open_measurement(model, calibrations, show)
            return MeasurementSession(source, measurement, most_hz=most_hz, frames=frames)
        first = next(frames)
        if model.projection is None:
            h, w = first.image.shape[:2]
            camera = Pinhole(mm_per_px or 1.0, w, h, eye_distance_mm=1e3)  # replaces the lens
            model = source.model = replace(model, projection=camera, in_px=mm_per_px is None)
        if model.in_px:
            if unscaled := [o for o in show or () if o not in ("flow", "observation")]:
                reason = "needs a scale: --mm-per-px or --camera"
                if unscaled[0] not in Measurement.OUTPUTS:
                    reason = f"unknown; {did_you_mean(unscaled[0], Measurement.OUTPUTS)}"
                raise InputError(f"--show {unscaled[0]}: {reason}")
            show = ("observation",)
        measurement = open_measurement(model, (), show)
        pattern = RestPattern.recognise(measurement.rectified(first.image))
        if pattern.kind == "markers":
            measurement = Measurement.of_markers(model.camera)
        frames = chain((first,), frames)
        return MeasurementSession(
            source, measurement, most_hz=most_hz, frames=frames, pattern=pattern
        )
    except BaseException:
        source.close()
        raise


def session_notes(session: MeasurementSession) -> list[str]:
    """List the notes on a session's results, one line each."""
    pattern = session.pattern
    lines = [pattern.lacks] if pattern is not None and pattern.lacks else []
    if session.source.model.in_px:
        lines.append(
            "lengths in pixels (camera unknown): --mm-per-px gives mm on the face; a camera file "
            "(`deltact-fab calibrate lens`, --camera) removes lens distortion and allows "
            "calibrations for depth, contacts and force"
        )
    return lines


def measure_source(
    source: str | Path,
    calibrations: Sequence[str | Path] = (),
    *,
    show: Sequence[str] | None = None,
    camera: str | Path | None = None,
    design: str | None = None,
    serial: str | None = None,
    seed: int = 0,
    mm_per_px: float | None = None,
    most_hz: float | None = None,
) -> Iterator[MeasuredImage]:
    """Measure the images of a source as they come; the first must show the face at rest.

    source: the number of a camera ("0"), its device file or address, a video, a folder of images, a
    run, or a rig, as in `deltact-fab measure`. From a camera the newest image is measured, from
    other sources every image. calibrations: files of depth and force. show: outputs, None: all
    that the calibrations allow. camera: its file; design, serial: of the sensor, if the source
    does not know them. seed: of a virtual rig. mm_per_px: of the resting face, if the camera is
    unknown; without both, lengths are in pixels. most_hz: images per second, except of a camera.

    Raises InputError at once for a source or file that cannot be opened or is another sensor's;
    later the errors of the source and the measurement.
    """
    cv2.setNumThreads(1)  # the flow depends on the number of threads
    return open_session(
        str(source), None if camera is None else Path(camera),
        [Path(file) for file in calibrations], show,
        design=design, serial=serial, seed=seed, mm_per_px=mm_per_px, most_hz=most_hz,
    ).results()  # fmt: skip


def track_images(
    source: str | Path, camera: str | Path | None = None, design: str | None = None, seed: int = 0
) -> Iterator[MeasuredImage]:
    """Track the pattern through the images of a source like `measure_source`: flow only."""
    return measure_source(source, show=("flow",), camera=camera, design=design, seed=seed)


class LiveMeasurement(Pipeline):
    """Measurement of images from your own program, the newest first, one thread per stage.

    Pass each raw image, BGR or grey, to `submit`, and read `result`. The first image must show the
    face at rest.
    """

    def __init__(
        self,
        sensor: str | Path,
        calibrations: Sequence[str | Path] = (),
        *,
        show: Sequence[str] | None = None,
        design: str | None = None,
        serial: str | None = None,
    ) -> None:
        """sensor: its camera's file, or a run recorded with it; others as in `measure_source`.

        Raises InputError for a file that is invalid or another sensor's.
        """
        cv2.setNumThreads(1)
        if Path(sensor).is_dir():
            model = open_source(str(sensor), None, design, serial).model
        else:
            model = replace(load_model(Path(sensor), design), design=design, serial=serial)
        files = [Path(file) for file in calibrations]
        super().__init__(open_measurement(model, files, show), "newest")
        self._flat = model.flat

    def submit(self, image: Array, t_s: float | None = None) -> None:
        """Submit an image as in Pipeline, after flat field correction if known."""
        if self._flat is not None:
            image = self._flat.apply(self.measurement.rectified(image))
        super().submit(image, t_s)

    def reset(self) -> None:
        """Take the next image as the face at rest; call it while nothing touches the sensor."""
        self.measurement.reset()
