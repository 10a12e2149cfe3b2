"""From a name to a session: what is measured of a source, by what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

from ..errors import InputError, did_you_mean
from ..measure.pipeline import OUTPUTS, MarkerMeasurement
from ..measure.recognised import recognise
from ..optics import Pinhole
from .open import images, measurement_of, open_source
from .session import Session


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
) -> Session:
    """Open a source; `results` of what is returned measures its images.

    name, camera_file, design, serial, seed, follow_s: as of `open_source`; calibrations, show: of
    `measurement_of`; most_hz: as of Session. mm_per_px: of the resting face, where no camera is
    known; with neither, lengths are in pixels. Where the source does not know its pattern and no
    calibration is given, the first image is waited for, and markers are followed as such. Raises
    InputError, one line, and what the source raises.
    """
    source = open_source(name, camera_file, design, serial, seed, follow_s=follow_s)
    try:
        frames, known = images(source), source.known
        if known.camera is not None and mm_per_px is not None:
            raise InputError(f"{name}: --mm-per-px: its camera is known, and has the scale")
        if known.camera is None and calibrations:
            raise InputError(
                f"{calibrations[0]}: a calibration holds for the camera that it was made with: "
                "name that camera's file with --camera"
            )
        if known.camera is not None and (calibrations or known.recipe is not None):
            measurement = measurement_of(known, calibrations, show)
            return Session(source, measurement, most_hz=most_hz, frames=frames)
        first = next(frames)
        if known.camera is None:
            h, w = first.image.shape[:2]
            camera = Pinhole(mm_per_px or 1.0, w, h, eye_distance_mm=1e3)  # stands for the lens
            known = source.known = replace(known, camera=camera, in_px=mm_per_px is None)
        if known.in_px:
            if beyond := [one for one in show or () if one not in ("flow", "observation")]:
                why = "needs a scale: --mm-per-px or --camera"
                if beyond[0] not in OUTPUTS:
                    why = f"unknown; {did_you_mean(beyond[0], OUTPUTS)}"
                raise InputError(f"--show {beyond[0]}: {why}")
            show = ("observation",)
        measurement = measurement_of(known, (), show)
        pattern = recognise(measurement.rectified(first.image))
        if pattern.kind == "markers" and known.camera is not None:
            measurement = MarkerMeasurement(known.camera)
        frames = chain((first,), frames)
        return Session(source, measurement, most_hz=most_hz, frames=frames, pattern=pattern)
    except BaseException:
        source.close()
        raise


def told_once(session: Session) -> list[str]:
    """What a reader must know of a session's results, a line each."""
    pattern = session.pattern
    lines = [pattern.lacks] if pattern is not None and pattern.lacks else []
    if session.source.known.in_px:
        lines.append(
            "in pixels, as no camera is known: --mm-per-px gives lengths on the face in mm; a "
            "camera file (`deltact-fab calibrate lens`, --camera) takes the lens out, and with it "
            "calibrations give depth, contacts and force"
        )
    return lines
