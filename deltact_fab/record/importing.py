"""A run folder out of a recording that was made elsewhere: marked `imported`, and never simulated.

It has one press, "imported", whose first image is the reference, and no row of a step, for nobody
knows of any. What is not known is missing in run.json, and `imported.unknown` there says it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np

from .. import catalog
from ..aliases import Array, Image, Progress
from ..errors import InputError
from ..files import disk_errors, whole
from ..optics import Fisheye, FlatField, Rectified, load_camera
from ..protocols.plan import Step
from ..shapes.sensor import SensorDimensions
from ..version import VERSION
from .files import IMPORTED, UNKNOWN
from .lag import lag_of, motion
from .recording import Recording, Samples, force_of, pose_of, read
from .streams import FORCE_COLUMNS, TIME, Chunk
from .writer import RunWriter


def import_recording(
    file: Path,
    out: Path,
    images_of: Callable[[Path], Any],
    design_of: Callable[[str], SensorDimensions],
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Write the run that a recording's file tells of, and return its summary.

    images_of, design_of: `rig.camera.files.images_of` and `cad.design.load_design`, which stand
    above this package. Nothing is written unless all of it is right. Raises InputError naming file,
    key or line, and value; RunFailed for an image that cannot be read, and when the disk refuses.
    """
    said: Recording = catalog.validate(Recording, catalog.read(file), str(file))
    if out.exists():
        raise InputError(f"{out}: already there; name a new --out folder")
    folder = file.parent
    streams: dict[str, Samples] = {}
    if said.force is not None:
        streams["force"] = force_of(said.force, folder)
    if said.pose is not None:
        streams["pose"] = pose_of(said.pose, folder)
    step = Step(IMPORTED, IMPORTED, UNKNOWN, cast(Any, UNKNOWN), (0, 0, 0), 0)  # no row is made
    with closing(images_of(folder / said.images)) as images, disk_errors(out), whole(out) as made:
        timed = _timed(images, said, file)
        first = next(timed)
        size = first[1].shape[1::-1]
        seen, flat = _sensor(said, file, size, design_of)
        meta = _meta(said, folder, size) | {"name": out.name} | seen
        about = b"# Imported: what protocol this was, nobody said.\n"
        writer = RunWriter.create(made, meta, about, {IMPORTED: True}, [step], flat)
        try:
            at_s, moved_px, moved = [], [], motion()
            for k, (t_s, image) in enumerate(chain([first], timed), start=1):
                at_s.append(t_s)
                moved_px.append(moved(image))
                writer.frame(step, k, image, t_s, t_s - at_s[0], t_s - at_s[0])
                if progress is not None:
                    progress(k, k + 1, "images")
            chunks = [_chunk(name, *one, at_s[0]) for name, one in streams.items()]
            writer.cut_off(step, chunks)  # samples without a step, for none is known
            summary = _summary(said, np.array(at_s), np.array(moved_px), streams)
            writer.close(summary)
        finally:
            writer.abandon()
    return summary


def _timed(images: Any, said: Recording, file: Path) -> Iterator[tuple[float, Image]]:
    """Each image after its time, s; all of one size, and as many as there are times."""
    rate_hz = said.rate_hz or (images.rate_hz if images.kind == "video" else 0.0)
    if said.times is None and not rate_hz:
        raise InputError(f"{file}: rate_hz: missing key; {images.name} has no times: or [times]")
    times = None if said.times is None else read(said.times, file.parent, {}, rising=True)[0]
    size, n = None, 0
    for n, image in enumerate(images.read(), start=1):
        size = size or image.shape
        if image.shape != size:
            (h, w), (first_h, first_w) = image.shape[:2], size[:2]
            raise InputError(
                f"{images.name}: image {n} is of {w} x {h} px, the first of {first_w} x {first_h} "
                "px; all must be of one size"
            )
        if times is None or n <= len(times):
            yield (n - 1) / rate_hz if times is None else float(times[n - 1]), image
    if not n:
        raise InputError(f"{images.name}: holds no image")
    if said.times is not None and times is not None and n != len(times):
        raise InputError(
            f"{file.parent / said.times.file}: {said.times.time}: {len(times)} rows, and "
            f"{images.name} holds {n} images; a row an image is needed"
        )


def _sensor(
    said: Recording,
    file: Path,
    size: tuple[int, ...],
    design_of: Callable[[str], SensorDimensions],
) -> tuple[dict[str, Any], FlatField | None]:
    """What run.json keeps of sensor and camera, as far as they are told, and the flat field."""
    if said.design is None:
        return {"camera": None}, None
    sensor = design_of(said.design)
    if said.camera is None:
        return {"camera": None, "sensor": asdict(sensor)}, None
    lens, _ = load_camera(file.parent / said.camera)
    if (wanted := (lens.width_px, lens.height_px)) != size:
        raise InputError(
            f"{file}: camera: {said.camera} makes {wanted[0]} x {wanted[1]} px, and the images "
            f"are of {size[0]} x {size[1]} px"
        )
    view = Rectified.of(sensor, lens) if isinstance(lens, Fisheye) else lens
    flat = FlatField.beside(file.parent / said.camera)
    return {"camera": view.as_dict(), "sensor": asdict(sensor)}, flat


def _meta(said: Recording, folder: Path, size: tuple[int, ...]) -> dict[str, Any]:
    """What run.json keeps besides: keys for what is known, and no others."""
    tables = [one.file for one in (said.times, said.force, said.pose) if one is not None]
    return {
        "imported": {
            "recording": said.model_dump(mode="json", exclude_none=True),
            "sha256": {n: hashlib.sha256((folder / n).read_bytes()).hexdigest() for n in tables},
            "image_px": size,
            "unknown": said.unknown(),
        },
        "protocol": {
            "name": IMPORTED,
            "description": said.description,
            "channels": ["image", "force"] if said.force else ["image"],
            "capture": {},
            "specimen": said.model_dump(include={"design", "serial"}, exclude_none=True),
        },
        "rig_name": IMPORTED,
        "rig": {"kind": IMPORTED},
        "simulated": False,
        "versions": {"deltact-fab": VERSION},
    }


def _chunk(stream: str, t_s: Array, columns: dict[str, Array], origin_s: float) -> Chunk:
    t_ns = np.rint((t_s - origin_s) * 1e9).astype(np.int64)
    return Chunk(stream, origin_s, {TIME: t_ns, **columns})


def _summary(
    said: Recording, t_s: Array, moved_px: Array, streams: dict[str, Samples]
) -> dict[str, Any]:
    """What was found; the lag is told of the force as it is kept, after lag_s was taken off."""
    lag = None
    if "force" in streams:
        force_t_s, six = streams["force"]
        forces = [six[name] for name in FORCE_COLUMNS[:3] if np.isfinite(six[name]).all()]
        lag = lag_of(t_s, moved_px, force_t_s, np.transpose(forces))
    unknown = "not known: " + "; ".join(said.unknown())
    return {
        "steps": 0,
        "frames": len(t_s),
        "samples": {name: len(of[0]) for name, of in streams.items()},
        "lag": None if lag is None else asdict(lag),
        "moved_px": np.round(moved_px[:, 2], 3).tolist(),
        "notes": [unknown] if lag is None else [lag.line, unknown],
        "left_out": [],
        "devices": {},
    }
