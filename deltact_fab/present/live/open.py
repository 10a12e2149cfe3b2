"""From what a user names to a source of images with all that is known of its sensor."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import CameraFrame, open_run, raw_size_px
from deltact_fab.common import InputError, catalogue_names, did_you_mean, validate
from deltact_fab.estimate import Measurement, Rectifier, SensorModel, read_acceptance
from deltact_fab.sensor import (
    Fisheye,
    FlatField,
    Rectified,
    SensorDimensions,
    SkinDimensions,
    load_camera,
)

from .source import Source, camera_source, file_source

NAMES_A_FILE = re.compile(r"\w[\w.+-]*")  # of a serial number: others are never kept


def open_source(
    name: str,
    camera_file: Path | None = None,
    design: str | None = None,
    serial: str | None = None,
    seed: int = 0,
    rest_only: bool = False,
    follow_s: float | None = None,
) -> Source:
    """Open what a name stands for, and tell it what the user knows of its sensor.

    name: the number of a camera ("0"), its device file or address, a run, a folder of images, a
    video, a virtual rig with or without a protocol ("virtual:smoke"), or a real rig, of which only
    the camera is opened. camera_file: as `deltact-fab calibrate lens` writes
    it. design, serial: of the sensor. They go before what the source knows. seed: of a virtual rig.
    rest_only: the images are looked at only to see what was made: where no one knows the camera,
    the design's lens stands for it. follow_s: NAME is a folder that is still written into, and ends
    when no image came for so long. Raises InputError for a name that is nothing of these.
    """
    given = None if camera_file is None else known_of(camera_file, design)
    source = (
        _opened(name, given, design, seed) if follow_s is None else _followed(name, given, follow_s)
    )
    try:
        own = source.known
        if given is not None:
            own = replace(own, projection=given.projection, flat=given.flat)
        if design is not None:
            own = replace(own, design=design, skin=_design(design).skin)
        if serial is not None:
            own = replace(own, serial=serial)
        source.known = own
        if own.projection is None and rest_only:
            sensor = _design(own.design)
            lens = Rectified.from_sensor(sensor, Fisheye.from_sensor(sensor))
            own = source.known = replace(own, projection=lens, nominal=True)
    except InputError:
        source.close()
        raise
    return source


def _design(name: str | None) -> SensorDimensions:
    """The named design, else the default one; a source that knows its sensor asks for none."""
    from deltact_fab.fabricate import load_design

    return load_design(name or "deltact")


def known_of(camera_file: Path, design: str | None = None) -> SensorModel:
    """What a camera file and a design say. Raises InputError."""
    sensor = _design(design)
    camera, _ = load_camera(camera_file)
    flat = FlatField.from_camera_file(camera_file)
    if isinstance(camera, Fisheye):
        camera = Rectified.from_sensor(sensor, camera)
    return SensorModel(camera, sensor.skin, flat=flat and flat.for_view(camera))


def _opened(name: str, given: SensorModel | None, design: str | None, seed: int) -> Source:
    """What is imported is what that kind of source needs."""
    path = Path(name)
    if name.isdecimal() or path.is_char_device() or "://" in name:
        from deltact_fab.bench import CameraConfig

        camera = None if given is None else given.projection
        w, h = (None, None) if camera is None else raw_size_px(camera)
        asked = {"source": int(name) if name.isdecimal() else name, "width_px": w, "height_px": h}
        config = validate(CameraConfig, asked, f"camera {name}")
        return camera_source(config, Path(), given)
    rig, _, protocol = name.partition(":")
    rigs = catalogue_names("protocols/rigs")
    if Path(rig).suffix == ".toml" or (rig in rigs and not path.exists()):
        from .rig import rig_source

        return rig_source(rig, protocol, design, seed)
    if (path / "run.json").is_file():
        return _recorded(path)
    if path.is_dir() or path.is_file():
        from deltact_fab.bench import open_images

        return file_source(open_images(path), given)
    near = did_you_mean(rig, rigs)
    raise InputError(
        f"{name}: no camera number, address, video, folder, run or rig of that name; of the rigs "
        f"{near}"
    )


def _followed(name: str, given: SensorModel | None, silence_s: float) -> Source:
    from deltact_fab.bench import open_images

    folder = Path(name)
    if not folder.is_dir() or (folder / "run.json").is_file():
        wanted = "a folder that images are written into"
        raise InputError(f"{name}: {wanted} is needed with --follow, as RUN/images of a run")
    return file_source(open_images(folder, silence_s), given)


def _recorded(folder: Path) -> Source:
    """A run's images as the camera gave them, at rest one of each press; times of the rig's clock.

    Raises InputError for a folder that is no run, or one without images.
    """
    run = open_run(folder)
    rows = run.frames().dropna(subset=["file"])
    if rows.empty:
        raise InputError(f"{folder}: a run without images")
    specimen = run.meta["protocol"]["specimen"]
    skin = run.meta["sensor"]["skin"]
    known = SensorModel(
        run.camera,
        validate(SkinDimensions, skin, f"{folder}/run.json: sensor.skin"),
        flat=run.flat,
        recipe=run.pattern.get("recipe"),
        design=specimen.get("design"),
        serial=specimen.get("serial"),
        simulated=f"simulated, seed {run.meta['seed']}" if run.simulated else None,
    )

    def frames(rest_only: bool) -> Iterator[CameraFrame]:
        chosen = rows[rows["step_id"].str.endswith("/rest")] if rest_only else rows
        for file, t_s in zip(chosen["file"], chosen["t_s"], strict=True):
            yield CameraFrame(run.raw(str(file)), float(t_s))

    return Source(str(folder), known, frames)


def measurement_of(
    known: SensorModel, files: Sequence[Path], show: Sequence[str] | None = None
) -> Measurement:
    """Of the outputs named, or of all that the calibrations allow; always with what is tracked.

    Raises InputError, one line, for a file that is none, for another sensor's, and as Measurement.
    """
    include = None if show is None else [*show, "observation"]
    return Measurement(replace(known, rest=accepted_rest(known)), include, files)


def acceptance_file(serial: str) -> Path:
    """The file in which `rig accept` keeps a sensor.

    Raises InputError for a serial that is no file's name.
    """
    if not NAMES_A_FILE.fullmatch(serial):
        raise InputError(
            f"--serial {serial!r}: letters, digits, '.', '+', '-', '_' make a file's name"
        )
    return Path("sensors") / f"{serial}.toml"


def accepted_rest(known: SensorModel) -> NDArray[np.uint8] | None:
    """The face at rest when this sensor was accepted, as it is tracked; None where it was not.

    Raises InputError for a file that is none, and for an image of another size.
    """
    if known.serial is None or known.projection is None or not NAMES_A_FILE.fullmatch(known.serial):
        return None
    file = acceptance_file(known.serial)
    if not file.is_file():
        return None
    kept = read_acceptance(file, known)
    image = None if kept is None else cv2.imdecode(np.frombuffer(kept, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{file}: rest.file: no image of the face at rest")
    try:
        seen = np.asarray(Rectifier(known.camera).view(image), np.uint8)
    except InputError as why:
        raise InputError(f"{file}: rest.file: {why}") from why
    return seen if known.flat is None else known.flat.apply(seen)
