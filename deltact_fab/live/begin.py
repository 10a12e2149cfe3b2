"""From a name to a session: what is measured of a source, by what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..measure.pipeline import MarkerMeasurement, Measurement
from ..optics import Pinhole
from .open import images, measurement_of, open_source
from .recognised import Pattern, recognise
from .session import Session
from .source import KnownSensor

if TYPE_CHECKING:
    from .followed import Follow

PICTURE = ("flow", "observation")
"""Outputs that need no camera."""


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
    follow: Follow | None = None,
    most_hz: float | None = None,
) -> Session:
    """Open a source and look at its first image; `results` of what is returned measures them all.

    name, camera_file, design, serial, seed, follow: as of `open_source`; calibrations, show: as of
    `measurement_of`; most_hz: as of Session. mm_per_px: of the resting face, where no camera is
    known. With neither, lengths are in pixels. Markers are followed as such where the source does
    not know its pattern and no calibration is given. Waits for the first image. Raises InputError,
    one line, and what the source raises.
    """
    source = open_source(name, camera_file, design, serial, seed, follow=follow)
    try:
        if source.known.camera is not None and mm_per_px is not None:
            raise InputError(f"{name}: --mm-per-px: its camera is known, and has the scale")
        if source.known.camera is None and calibrations:
            raise InputError(
                f"{calibrations[0]}: a calibration holds for the camera that it was made with: "
                "name that camera's file with --camera"
            )
        frames = images(source)
        if source.known.camera is not None and (calibrations or source.known.recipe is not None):
            measurement = measurement_of(source.known, calibrations, show)
            return Session(source, measurement, most_hz=most_hz, frames=frames)
        first = next(frames)
        if source.known.camera is None:
            h, w = first.image.shape[:2]
            stands = Pinhole(mm_per_px or 1.0, w, h, eye_distance_mm=1e3)
            source.known = replace(source.known, camera=stands, in_px=mm_per_px is None)
        pattern, measurement = _recognised(source.known, first.image, show)
        frames = chain((first,), frames)
        return Session(source, measurement, most_hz=most_hz, frames=frames, pattern=pattern)
    except BaseException:
        source.close()
        raise


def _recognised(
    known: KnownSensor, image: np.ndarray, show: Sequence[str] | None
) -> tuple[Pattern, Measurement]:
    assert known.camera is not None, "one stands for it"
    dense = measurement_of(known, (), PICTURE[1:] if known.in_px else show)
    beyond = [] if show is None or not known.in_px else [o for o in show if o not in PICTURE]
    if beyond:
        raise InputError(f"--show {beyond[0]}: needs a scale: --mm-per-px or --camera")
    pattern = recognise(dense.rectified(image))
    markers = pattern.kind == "markers"
    return pattern, MarkerMeasurement(known.camera) if markers else dense


def told_once(session: Session) -> list[str]:
    """What a reader must know of a session's results, a line each."""
    pattern, known = session.pattern, session.source.known
    lines = [] if pattern is None or not pattern.line else [pattern.line]
    if known.in_px:
        lines.append(
            "in pixels, as no camera is known: --mm-per-px gives lengths on the face in mm; a "
            "camera file (`deltact-fab calibrate`, --camera) takes the lens out, and with it "
            "calibrations give depth, contacts and force"
        )
    return lines
