"""From a name to results: a source's images through a measurement, what belongs together together.

What is measured of a source is chosen by what is known of it.
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

RATE_WINDOW_S = 2.0
"""Over so long the rate of results is taken."""
CLOSE_TIMEOUT_S = 2.0
"""So long the source may take to deliver its last image when nobody wants more."""


@dataclass(frozen=True)
class SourceImage:
    """An image on its way. frame: its number in the source. t_s: when it was taken, by the source's
    clock; given_s: the time that its result's age counts from, by `time.monotonic`."""

    frame: int
    t_s: float
    image: NDArray[np.uint8]
    age_from_s: float


@dataclass(frozen=True)
class Motion:
    """From rest. largest_px, median_px: length of the motion where it is known, None where none is.

    largest_mm: as much on the face, None where its scale is not known: in_px. markers,
    markers_held: of the first image, and those of them that are found; None of a dense pattern.
    """

    largest_px: float | None
    median_px: float | None
    largest_mm: float | None
    in_px: bool
    markers: int | None = None
    markers_held: int | None = None

    @classmethod
    def from_result(cls, result: MeasurementResult, camera: CameraModel, in_px: bool) -> Motion:
        """Of a result with "observation", or of markers; camera: of the tracked images."""
        counts: tuple[int, ...] = ()
        if (dots := result.markers) is not None:
            shift_px = dots.displacement_px[dots.found]
            counts = len(dots.found), len(shift_px)
        else:
            assert result.observation is not None, "`measurement_of` asks for it"
            flow = FaceFlow.of(result.observation, camera, FaceFlow.SPACING_PX)
            shift_px = flow.shift_mm[flow.known] / np.float32(camera.mm_per_px)
        size = np.hypot(*shift_px.T)
        largest, median = (float(size.max()), float(np.median(size))) if len(size) else (None, None)
        mm = None if in_px or largest is None else largest * camera.mm_per_px
        return cls(largest, median, mm, in_px, *counts)


@dataclass(frozen=True)
class MeasuredImage:
    """An image and its result; a gap in the numbers of the images is those that were dropped.

    hz: results a second. dropped: images and results that gave way to newer ones, so far, with
    the images that the camera lost. motion: of the pattern in the picture.
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
        """most_hz: of a source that is not live, so many images a second are measured at most.

        frames: those of the source, where the first was looked at already. pattern: what it shows,
        where the source did not know.
        """
        self.source, self.measurement, self.pattern = source, measurement, pattern
        self.view = source.model.camera
        """Of the images as they are tracked."""
        self._least_s = 0.0 if most_hz is None or source.live else 1 / most_hz
        self._frames = images(source) if frames is None else frames
        self._stopped = False
        self._error: BaseException | None = None
        self._pending: deque[SourceImage] = deque()
        self._drops = 0

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
        """An image of the source as it is tracked."""
        return self.measurement.rectified(image)

    def _feed(self, pipeline: Pipeline) -> None:
        """Give every image to the pipeline, which drops those that it has no time for."""
        flat = self.source.model.flat
        try:
            for k, frame in enumerate(self._frames):
                began_s = time.monotonic()
                self._drops += frame.dropped
                if self._stopped:
                    break
                image = frame.image if flat is None else flat.apply(self.rectified(frame.image))
                queued = SourceImage(
                    k, frame.t_s, image, frame.t_s if self.source.live else began_s
                )
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
    """Open a source and choose what is measured of it; `results` then measures its images.

    name, camera_file, design, serial, seed, follow_s: as of `open_source`; calibrations, show: of
    `measurement_of`; most_hz: as of Session. mm_per_px: of the resting face, where no camera is
    known; with neither, lengths are in pixels. Where the source does not know its pattern and no
    calibration is given, the first image is waited for, and markers are followed as such. Raises
    InputError, one line, and what the source raises.
    """
    source = open_source(name, camera_file, design, serial, seed, follow_s=follow_s)
    try:
        frames, model = images(source), source.model
        if model.projection is not None and mm_per_px is not None:
            raise InputError(f"{name}: --mm-per-px: its camera is known, and has the scale")
        if model.projection is None and calibrations:
            raise InputError(
                f"{calibrations[0]}: a calibration holds for the camera that it was made with: "
                "name that camera's file with --camera"
            )
        if model.projection is not None and (calibrations or model.recipe is not None):
            measurement = open_measurement(model, calibrations, show)
            return MeasurementSession(source, measurement, most_hz=most_hz, frames=frames)
        first = next(frames)
        if model.projection is None:
            h, w = first.image.shape[:2]
            camera = Pinhole(mm_per_px or 1.0, w, h, eye_distance_mm=1e3)  # stands for the lens
            model = source.model = replace(model, projection=camera, in_px=mm_per_px is None)
        if model.in_px:
            if unscaled := [
                name_shown for name_shown in show or () if name_shown not in ("flow", "observation")
            ]:
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
    """What a reader must know of a session's results, a line each."""
    pattern = session.pattern
    lines = [pattern.lacks] if pattern is not None and pattern.lacks else []
    if session.source.model.in_px:
        lines.append(
            "in pixels, as no camera is known: --mm-per-px gives lengths on the face in mm; a "
            "camera file (`deltact-fab calibrate lens`, --camera) takes the lens out, and with it "
            "calibrations give depth, contacts and force"
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
    run, or a rig, as `deltact-fab measure` takes it. From a camera the newest image is measured;
    of anything else every one. calibrations: files of depth and force. show: the outputs, None: all
    that the calibrations allow. camera: its file; design, serial: of the sensor, where the source
    does not say. seed: of a virtual rig. mm_per_px: of the resting face, where no camera is known;
    with neither, lengths are in pixels. most_hz: images a second, of what is no camera.

    Raises InputError at once for what cannot be opened or is another sensor's; while it goes on, as
    the source and the measurement do.
    """
    cv2.setNumThreads(1)  # the flow depends on their number
    return open_session(
        str(source), None if camera is None else Path(camera),
        [Path(file) for file in calibrations], show,
        design=design, serial=serial, seed=seed, mm_per_px=mm_per_px, most_hz=most_hz,
    ).results()  # fmt: skip


def track_images(
    source: str | Path, camera: str | Path | None = None, design: str | None = None, seed: int = 0
) -> Iterator[MeasuredImage]:
    """Follow the pattern through the images of a source as `measure_source`: its flow alone."""
    return measure_source(source, show=("flow",), camera=camera, design=design, seed=seed)


class LiveMeasurement(Pipeline):
    """Measures images that a program of your own takes, the newest first, a thread a stage.

    Give each image to `submit`, BGR or grey, as the camera gave it, and ask for `result`. The first
    image must show the face at rest.
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
        """sensor: its camera's file, or a run that was recorded with it; else as `measure_source`.

        Raises InputError for a file that is none or another sensor's.
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
        """As Pipeline; under even light, where the sensor's flat field is known."""
        if self._flat is not None:
            image = self._flat.apply(self.measurement.rectified(image))
        super().submit(image, t_s)

    def reset(self) -> None:
        """The next image is the new face at rest: whenever nothing touches the sensor."""
        self.measurement.reset()
