"""Measuring from Python: a source from its first image to its last, or images of one's own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2

from ..aliases import Array
from ..measure.pipeline import Pipeline
from .open import known_of, measurement_of, open_source
from .session import MeasuredImage, open_session


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


def track(
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
            known = open_source(str(sensor), None, design, serial).known
        else:
            known = replace(known_of(Path(sensor), design), design=design, serial=serial)
        files = [Path(file) for file in calibrations]
        super().__init__(measurement_of(known, files, show), "newest")
        self._flat = known.flat

    def submit(self, image: Array, t_s: float | None = None) -> None:
        """As Pipeline; under even light, where the sensor's flat field is known."""
        if self._flat is not None:
            image = self._flat.apply(self.measurement.rectified(image))
        super().submit(image, t_s)

    def reset(self) -> None:
        """The next image is the new face at rest: whenever nothing touches the sensor."""
        self.measurement.reset()
