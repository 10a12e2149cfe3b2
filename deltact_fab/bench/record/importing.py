"""Import of a recording made elsewhere as a run folder, marked `imported`, never simulated.

It has one press, "imported", whose first image is the reference, and no steps. Unknown values are
absent from run.json and listed in its `imported.unknown`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np

from deltact_fab.common import (
    Array,
    Image,
    InputError,
    Progress,
    disk_errors,
    read_toml,
    validate,
    whole_file,
)
from deltact_fab.sensor import Fisheye, FlatField, Rectified, SensorDimensions, load_camera
from deltact_fab.version import PACKAGE_VERSION

from ..protocols.plan import Step
from .files import IMPORTED_MARK, UNKNOWN_SENSOR
from .recording import Recording, Samples, read_csv, read_force, read_pose
from .streams import FORCE_COLUMNS, TIME_KEY, Chunk
from .writer import RunWriter


def import_recording(
    file: Path,
    out: Path,
    images_of: Callable[[Path], Any],
    design_of: Callable[[str], SensorDimensions],
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Write a run from a recording's TOML file and return its summary.

    images_of, design_of: `bench.rig.camera.files.open_images` and
    `fabricate.cad.design.load_design`, which are in higher layers. Nothing is written unless all
    input is valid. Raises InputError naming file, key or line, and value; RunFailed for an
    unreadable image or a disk error.
    """
    recording: Recording = validate(Recording, read_toml(file), str(file))
    if out.exists():
        raise InputError(f"{out}: already exists; name a new --out folder")
    folder = file.parent
    streams: dict[str, Samples] = {}
    if recording.force is not None:
        streams["force"] = read_force(recording.force, folder)
    if recording.pose is not None:
        streams["pose"] = read_pose(recording.pose, folder)
    step = Step(
        IMPORTED_MARK, IMPORTED_MARK, UNKNOWN_SENSOR, cast(Any, UNKNOWN_SENSOR), (0, 0, 0), 0
    )  # not written to the journal
    with (
        closing(images_of(folder / recording.images)) as images,
        disk_errors(out),
        whole_file(out) as part,
    ):
        timed = _timed_images(images, recording, file)
        first = next(timed)
        size = first[1].shape[1::-1]
        sensor_meta, flat = _sensor_meta(recording, file, size, design_of)
        meta = _meta(recording, folder, size) | {"name": out.name} | sensor_meta
        about = b"# Imported run: protocol unknown.\n"
        writer = RunWriter.create(part, meta, about, {IMPORTED_MARK: True}, [step], flat)
        try:
            at_s, moved_px, measure_motion, n_lost = [], [], motion_meter(), 0
            for k, (t_s, image, dropped) in enumerate(chain([first], timed), start=1):
                at_s.append(t_s)
                moved_px.append(measure_motion(image))
                n_lost += dropped
                writer.frame(step, k, image, t_s, t_s - at_s[0], t_s - at_s[0], dropped=dropped)
                if progress is not None:
                    progress(k, k + 1, "images")
            chunks = [_chunk(name, *samples, at_s[0]) for name, samples in streams.items()]
            writer.interrupted_step(step, chunks)  # samples only: an import has no steps
            summary = _summary(recording, np.array(at_s), np.array(moved_px), streams)
            if n_lost:
                summary["notes"].append(f"{n_lost} damaged images are missing")
            writer.close(summary)
        finally:
            writer.abandon()
    return summary


def _timed_images(
    images: Any, recording: Recording, file: Path
) -> Iterator[tuple[float, Image, int]]:
    """Yield time (s), image, and number of damaged ones since the previous.

    Requires one image size, and one image, damaged or not, per time.
    """
    rate_hz = recording.rate_hz or (images.rate_hz if images.kind == "video" else 0.0)
    if recording.times is None and not rate_hz:
        raise InputError(f"{file}: rate_hz: missing key, or [times]; {images.name} has no times")
    table = recording.times
    times = None if table is None else read_csv(table, file.parent, {}, rising=True)[0]
    size, n, n_lost = None, 0, 0
    for n, image in enumerate(images.read(), start=1):
        if image is None:
            n_lost += 1
            continue
        size = size or image.shape
        if image.shape != size:
            (h, w), (first_h, first_w) = image.shape[:2], size[:2]
            raise InputError(
                f"{images.name}: image {n} has {w} x {h} px, the first has {first_w} x {first_h} "
                "px; all must have one size"
            )
        if times is None or n <= len(times):
            yield (n - 1) / rate_hz if times is None else float(times[n - 1]), image, n_lost
            n_lost = 0
    if not n:
        raise InputError(f"{images.name}: no images")
    if recording.times is not None and times is not None and n != len(times):
        raise InputError(
            f"{file.parent / recording.times.file}: {recording.times.time}: {len(times)} rows, but "
            f"{images.name} has {n} images; one row per image needed"
        )


def _sensor_meta(
    recording: Recording,
    file: Path,
    size: tuple[int, ...],
    design_of: Callable[[str], SensorDimensions],
) -> tuple[dict[str, Any], FlatField | None]:
    """Sensor and camera entries of run.json, as far as given, and the flat field."""
    if recording.design is None:
        return {"camera": None}, None
    sensor = design_of(recording.design)
    if recording.camera is None:
        return {"camera": None, "sensor": asdict(sensor)}, None
    lens, _ = load_camera(file.parent / recording.camera)
    if (lens_px := (lens.width_px, lens.height_px)) != size:
        raise InputError(
            f"{file}: camera: {recording.camera} has {lens_px[0]} x {lens_px[1]} px, the "
            f"images have {size[0]} x {size[1]} px"
        )
    view = Rectified.from_sensor(sensor, lens) if isinstance(lens, Fisheye) else lens
    flat = FlatField.from_camera_file(file.parent / recording.camera)
    return {"camera": view.as_dict(), "sensor": asdict(sensor)}, flat


def _meta(recording: Recording, folder: Path, size: tuple[int, ...]) -> dict[str, Any]:
    """Remaining entries of run.json, known values only."""
    parts = (recording.times, recording.force, recording.pose)
    tables = [part.file for part in parts if part is not None]
    return {
        "imported": {
            "recording": recording.model_dump(mode="json", exclude_none=True),
            "sha256": {n: hashlib.sha256((folder / n).read_bytes()).hexdigest() for n in tables},
            "image_px": size,
            "unknown": recording.unknown(),
        },
        "protocol": {
            "name": IMPORTED_MARK,
            "description": recording.description,
            "channels": ["image", "force"] if recording.force else ["image"],
            "capture": {},
            "specimen": recording.model_dump(include={"design", "serial"}, exclude_none=True),
        },
        "rig_name": IMPORTED_MARK,
        "rig": {"kind": IMPORTED_MARK},
        "simulated": False,
        "versions": {"deltact-fab": PACKAGE_VERSION},
    }


def _chunk(stream: str, t_s: Array, columns: dict[str, Array], origin_s: float) -> Chunk:
    t_ns = np.rint((t_s - origin_s) * 1e9).astype(np.int64)
    return Chunk(stream, origin_s, {TIME_KEY: t_ns, **columns})


def _summary(
    recording: Recording, t_s: Array, moved_px: Array, streams: dict[str, Samples]
) -> dict[str, Any]:
    """Summary of the import; the lag is that of the stored force, after subtracting lag_s."""
    lag = None
    if "force" in streams:
        force_t_s, six = streams["force"]
        forces = [six[name] for name in FORCE_COLUMNS[:3] if np.isfinite(six[name]).all()]
        lag = estimate_lag(t_s, moved_px, force_t_s, np.transpose(forces))
    unknown = "unknown: " + "; ".join(recording.unknown())
    return {
        "steps": 0,
        "frames": len(t_s),
        "samples": {name: len(samples[0]) for name, samples in streams.items()},
        "lag": None if lag is None else asdict(lag),
        "moved_px": np.round(moved_px[:, 2], 3).tolist(),
        "notes": [unknown] if lag is None else [lag.line, unknown],
        "left_out": [],
        "devices": {},
    }


_REACH_S, _REACH_FRAMES = 0.6, 5
"""By hand: search range, the larger of both; larger drops images at the ends."""
_STEPS_PER_FRAME, _MAX_LAGS = 10, 400  # by hand: finer search grids cost time only
_CHI2_LIMIT = 3.84  # definition: 95 % of chi-square with 1 degree of freedom
_MIN_R2, _MIN_IMAGES = 0.5, 40  # by hand: lower reports lags that are noise
_MOTION_WIDTH_PX = 320  # by hand: enough for an image's mean motion; larger is slower


@dataclass(frozen=True)
class Lag:
    """Time by which the force lags behind the images, estimated from their common motion.

    For each lag the force is fitted linearly by the mean components of the image's flow, and the
    lag with the best fit is taken: a wrong lag leaves a hysteresis loop.

    lag_s: of the force behind the images, None if undetermined (why: reason); between_s: 95 %
    interval; frame_s: frame period; r2: share of the force explained by the motion at best.
    """

    lag_s: float | None = None
    between_s: tuple[float, float] | None = None
    frame_s: float = 0.0
    r2: float | None = None
    why: str = ""

    @property
    def line(self) -> str:
        """Lag in one sentence."""
        if self.lag_s is None or self.between_s is None:
            return f"lag of the force behind the images undetermined: {self.why}"
        low, high = self.between_s
        words = "less than one frame"
        if abs(self.lag_s) > self.frame_s:
            words = f"{self.lag_s / self.frame_s:.1f} frames; correct it with `lag_s` under [force]"
        return (
            f"the force lags {1e3 * self.lag_s:.0f} ms behind the images "
            f"({1e3 * low:.0f} to {1e3 * high:.0f} ms): {words}"
        )


def motion_meter() -> Callable[[Image], Array]:
    """Return a function from an image to the motion (4,) px since its first image.

    Means over the image: rightwards, downwards, magnitude, radial from the centre.
    """
    import cv2

    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    first: list[Array] = []

    def motion_px(image: Image) -> Array:
        scale = min(1.0, _MOTION_WIDTH_PX / image.shape[1])
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        first.append(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        small = first[0] if len(first) == 1 else first.pop()
        flow = dis.calc(first[0], small, np.zeros((*small.shape, 2), np.float32)) / scale
        u, v = flow[..., 0], flow[..., 1]
        x, y = (np.linspace(-1, 1, n) for n in reversed(small.shape))
        outwards = (u * x + v * y[:, None]).mean()
        return np.array([u.mean(), v.mean(), np.hypot(u, v).mean(), outwards], float)

    return motion_px


def estimate_lag(t_s: Array, moved_px: Array, force_t_s: Array, force_n: Array) -> Lag:
    """Lag between images at t_s (n,) with motion (n, 4) and force_n (m, k) at force_t_s (m,)."""
    every_s = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    reach_s = max(_REACH_S, _REACH_FRAMES * every_s)
    inside = (t_s - reach_s >= force_t_s[0]) & (t_s + reach_s <= force_t_s[-1])
    inside_s, motion = t_s[inside], moved_px[inside]
    if len(inside_s) < _MIN_IMAGES:
        reason = f"{len(inside_s)} images have force {reach_s:.1f} s before and after"
        return Lag(why=f"{reason}; {_MIN_IMAGES} are needed")
    half_count = min(_MAX_LAGS // 2, round(_STEPS_PER_FRAME * reach_s / every_s))
    lags, step_s = np.linspace(-reach_s, reach_s, 2 * half_count + 1, retstep=True)
    force = np.array([[np.interp(inside_s + lag, force_t_s, f) for f in force_n.T] for lag in lags])
    force -= force.mean(axis=-1, keepdims=True)
    basis, _ = np.linalg.qr(motion - motion.mean(axis=0))
    residual = force - (force @ basis) @ basis.T
    unexplained = (residual**2).sum(axis=(1, 2)) / np.maximum((force**2).sum(axis=(1, 2)), 1e-12)
    best = int(unexplained.argmin())
    # Correlated errors reduce the number of independent images.
    e = residual[best]
    correlation = float(np.clip((e[:, 1:] * e[:, :-1]).sum() / max((e**2).sum(), 1e-12), 0, 0.99))
    independent = len(inside_s) * (1 - correlation) / (1 + correlation)
    ratio = unexplained / max(unexplained[best], 1e-12)
    likely_lags = lags[independent * np.log(ratio) <= _CHI2_LIMIT]
    r2, low, high = 1 - float(unexplained[best]), float(likely_lags[0]), float(likely_lags[-1])
    if r2 < _MIN_R2:
        return Lag(r2=r2, why=f"image motion explains {r2:.0%} of the force; 50% needed")
    if low <= lags[0] or high >= lags[-1]:
        return Lag(r2=r2, why=f"any lag within {reach_s:.1f} s fits: signals too slow")
    return Lag(float(lags[best]), (low - float(step_s) / 2, high + float(step_s) / 2), every_s, r2)
