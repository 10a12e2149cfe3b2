"""Opening of image sources by name, with the model of their sensor."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import CameraFrame, SensorLedger, open_run, raw_size_px
from deltact_fab.common import InputError, catalogue_names, did_you_mean, read_toml, validate
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


def open_source(
    name: str,
    camera_file: Path | None = None,
    design: str | None = None,
    serial: str | None = None,
    seed: int = 0,
    rest_only: bool = False,
    follow_s: float | None = None,
) -> Source:
    """Open a source by name, and complete its sensor model.

    name: the number of a camera ("0"), its device file or address, a run, a folder of images, a
    video, a virtual rig with or without a protocol ("virtual:smoke"), or a real rig, of which only
    the camera is opened. camera_file: from `deltact-fab calibrate lens`. design, serial: of the
    sensor; all three override the source's. seed: of a virtual rig. rest_only: for images at rest,
    an unknown camera is replaced by the design's lens. follow_s: the folder is still being written,
    and ends after so long without an image. Raises InputError for a name that is none of these.
    """
    file_model = None if camera_file is None else load_model(camera_file, design)
    source = (
        _open_named(name, file_model, design, seed)
        if follow_s is None
        else _open_followed(name, file_model, follow_s)
    )
    try:
        model = source.model
        if file_model is not None:
            model = replace(model, projection=file_model.projection, flat=file_model.flat)
        if design is not None:
            model = replace(model, design=design, skin=_design(design).skin)
        if serial is not None:
            model = replace(model, serial=serial)
        source.model = model
        if model.projection is None and rest_only:
            sensor = _design(model.design)
            lens = Rectified.from_sensor(sensor, Fisheye.from_sensor(sensor))
            model = source.model = replace(model, projection=lens, nominal=True)
    except InputError:
        source.close()
        raise
    return source


def _design(name: str | None) -> SensorDimensions:
    """Load the named or the default design."""
    from deltact_fab.fabricate import load_design

    return load_design(name or "deltact")


def load_model(camera_file: Path, design: str | None = None) -> SensorModel:
    """Load a sensor model from a camera file and a design. Raises InputError."""
    sensor = _design(design)
    camera, _ = load_camera(camera_file)
    flat = FlatField.from_camera_file(camera_file)
    if isinstance(camera, Fisheye):
        camera = Rectified.from_sensor(sensor, camera)
    return SensorModel(camera, sensor.skin, flat=flat and flat.for_view(camera))


def _open_named(name: str, file_model: SensorModel | None, design: str | None, seed: int) -> Source:
    """Open a source, importing only the modules for its kind."""
    path = Path(name)
    if name.isdecimal() or path.is_char_device() or "://" in name:
        from deltact_fab.bench import CameraConfig

        camera = None if file_model is None else file_model.projection
        w, h = (None, None) if camera is None else raw_size_px(camera)
        device = int(name) if name.isdecimal() else name
        settings = {"source": device, "width_px": w, "height_px": h}
        config = validate(CameraConfig, settings, f"camera {name}")
        return camera_source(config, Path(), file_model)
    rig, _, protocol = name.partition(":")
    rigs = catalogue_names("protocols/rigs")
    if Path(rig).suffix == ".toml" or (rig in rigs and not path.exists()):
        from .rig import rig_source

        return rig_source(rig, protocol, design, seed)
    if os.path.lexists(path / "run.json"):
        return _open_run_images(path)
    if path.is_dir() or path.is_file():
        from deltact_fab.bench import open_images

        return file_source(open_images(path), file_model)
    near = did_you_mean(rig, rigs)
    raise InputError(
        f"{name}: no camera number, address, video, folder, run or rig of that name; rigs: {near}"
    )


def _open_followed(name: str, file_model: SensorModel | None, silence_s: float) -> Source:
    from deltact_fab.bench import open_images

    folder = Path(name)
    if not folder.is_dir() or (folder / "run.json").is_file():
        raise InputError(f"{name}: --follow needs a folder of images, such as RUN/images")
    return file_source(open_images(folder, silence_s), file_model)


def _open_run_images(folder: Path) -> Source:
    """Open a run's raw images, at rest one per press; times of the rig's clock.

    Raises InputError for a folder that is not a run, or has no images.
    """
    run = open_run(folder)
    rows = run.frames().dropna(subset=["file"])
    if rows.empty:
        raise InputError(f"{folder}: run has no images")
    specimen = run.meta["protocol"]["specimen"]
    skin = run.meta["sensor"]["skin"]
    model = SensorModel(
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

    return Source(str(folder), model, frames)


def open_measurement(
    model: SensorModel, files: Sequence[Path], show: Sequence[str] | None = None
) -> Measurement:
    """Open a measurement of the named outputs, or of all that the calibrations allow.

    It always includes the tracked observation. Raises InputError, one line, for an invalid file, or
    one of another sensor, and Measurement's errors.
    """
    include = None if show is None else [*show, "observation"]
    return Measurement(replace(model, rest=accepted_rest(model)), include, files)


def accepted_rest(model: SensorModel) -> NDArray[np.uint8] | None:
    """Rectified face at rest when this sensor was accepted; None if it was not.

    Raises InputError for an invalid file, and for an image of another size.
    """
    serial = model.serial
    if serial is None or model.projection is None:
        return None
    try:
        file = SensorLedger.file(serial)
    except InputError:  # not a file name
        return None
    if not file.is_file() or "kind" not in read_toml(file):
        return None
    png = read_acceptance(file, model)
    image = None if png is None else cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise InputError(f"{file}: rest.file: not an image of the face at rest")
    try:
        view = np.asarray(Rectifier(model.camera).view(image), np.uint8)
    except InputError as error:
        raise InputError(f"{file}: rest.file: {error}") from error
    return view if model.flat is None else model.flat.apply(view)
