"""Faults of a bench and their remedies: each device is queried, nothing moves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Check, DeltactFabError, InputError, SensorError, Status, graded

from ..protocols.motion import UNTOUCHED_STOP_MM
from .bench import missing_tables
from .camera.model import calibrated_camera, open_camera, raw_size_px
from .config import GrblConfig
from .force.guard import GuardLimits
from .force.rdt import fetch_settings
from .force.watchdog import open_force
from .interface import Camera, ForceSensor, OpenBench, Rig, WallClock
from .stage.grbl import GrblStage
from .tables import CameraConfig, ForceConfig, GuardConfig

# By hand: stricter limits fail a sound bench, looser ones pass a poor one.
MIN_IMAGE_RATE_SHARE = 0.95  # of the nominal rate
MAX_OVEREXPOSED_SHARE = 0.01  # of the pixels, at 255
MIN_MEAN_GREY = 16  # of 255
MIN_SAMPLE_RATE_SHARE = 0.98  # of the box's rate
SCALE_RATE_TOLERANCE = 0.2  # relative, measured against rate_hz of the rig file
MAX_REST_SHARE = 0.01  # of the range: mean after the tare, standard deviation at rest
RANGE_TOLERANCE = 0.02  # relative, box against rig file
STIFF_N_PER_MM15 = 5.6  # Hertz' law for a ball of 10 mm and twice the modulus of the paper's gel
UNCHANGED_SCALE = "press the tip with a finger in the second half of `rig check --seconds 20`"
SLOW_DEVICE = "try a shorter exposure, another fourcc or a faster port"
SLOW_SENDER = "the sender is slow, or this computer is busy"
AUTO_KEYS = {"exposure": "auto_exposure", "gain": None, "white_balance_k": "auto_white_balance"}


def check_rig(config: GrblConfig, folder: Path, seconds: float) -> Iterator[Check]:
    """Check stage, force sensor, guard and camera, and that the rig file allows a press.

    folder: of the rig file. seconds: how long camera and sensor are watched. A device that fails
    gives a row, no exception.
    """
    yield from _stage_rows(config)
    if config.force is not None and config.force.reachable:
        yield from force_rows(config.force, config.guard, seconds)
    if config.camera is not None:
        yield from camera_rows(config.camera, folder, seconds)
    else:
        text = "no [camera]: a protocol with the channel image is refused"
        yield _row("camera", "table", "warn", text)
    yield from _press_rows(config)
    yield from _stop_rows(config)


def _stage_rows(config: GrblConfig) -> Iterator[Check]:
    stage = GrblStage.from_config(config.stage, WallClock())
    refused = ""
    try:
        stage.connect()
    except DeltactFabError as error:
        refused = str(error)
    finally:
        stage.close()
    identity = stage.identity()
    if n_settings := len(identity["settings"]):
        banner = identity["banner"] or "no banner (board did not restart on opening)"
        text = f"{config.stage.port} answers: {banner}; {n_settings} settings read"
        yield _row("stage", "answer", "pass", text)
    yield from stage.setting_checks
    if refused and not any(row.failed for row in stage.setting_checks):
        remedy = "check its power and cable, [stage] port and baud, and that no other program has"
        yield _row("stage", "connection", "fail", refused, f"{remedy} the port")


def _stop_rows(config: GrblConfig) -> Iterator[Check]:
    """Rows for the way of a stop, and for the switch that stops without software."""
    stage, feed = config.stage, config.stage.max_feed_mm_min[2]
    slow = stage.descent_feed_mm_min
    text = (
        f"at {feed:g} mm/min a stop takes {stage.stopping_mm(feed):.2f} mm; towards a face not "
        f"touched yet at most {slow:.0f} mm/min, {UNTOUCHED_STOP_MM:g} mm"
    )
    yield _row("stage", "stop", "pass", text)
    if not stage.emergency_stop:
        yield _row(
            "stage", "emergency-stop", "warn", "[stage] emergency_stop is not declared",
            "install a latching switch in the supply of the motors, test it, and write "
            "emergency_stop = true",
        )  # fmt: skip
    if config.force is None or not config.force.reachable:
        return
    with suppress(InputError):  # a row of the force sensor
        trip_n = GuardLimits.from_config(config.guard, config.force).force_n[2]
        range_n = config.force.range_n[2]
        fast_n, slow_n = (stage.stop_force_n(trip_n, f, STIFF_N_PER_MM15) for f in (feed, slow))
        text = (
            f"the guard's {trip_n:.1f} N end at {slow_n:.1f} N, and at {fast_n:.1f} N from "
            f"{feed:g} mm/min, with sphere:10 on a stiff gel; the sensor's range is {range_n:g} N"
        )
        remedy = "" if slow_n <= range_n else "set a lower limit in [guard]"
        yield _row("stage", "stop-force", graded(not remedy), text, remedy)


def _press_rows(config: GrblConfig) -> Iterator[Check]:
    """Rows for the keys of the rig file that a press needs; a run in air does without."""
    force, missing = config.force, missing_tables(config)
    if force is not None and force.reachable and "range_n" not in force.model_fields_set:
        missing["range"] = "[force] range_n is not declared: take it from the calibration sheet"
    if config.stage.max_force_n is None:
        missing["max-force"] = (
            "[stage] max_force_n is not declared: measure the axis forces without lost steps"
        )
    for id, text in missing.items():
        yield _row("presses", id, "fail", text)
    if not missing:
        yield _row("presses", "rig-file", "pass", "complete for a press")


def _row(device: str, id: str, status: Status, text: str, remedy: str = "") -> Check:
    return Check(f"{device}.{id}", device, value=text, status=status, remedy=remedy)


def camera_rows(config: CameraConfig, folder: Path, seconds: float) -> Iterator[Check]:
    """Open the camera of a rig file and check its images for some seconds.

    folder: of the rig file. A camera that fails gives a row, no exception.
    """
    yield _calibration_row(config, folder)
    try:
        with closing(open_camera(config, folder, WallClock())) as camera:
            rows = list(_image_rows(camera, config, seconds))
            identity = camera.identity()
    except (InputError, SensorError) as error:
        yield _row("camera", "images", "fail", str(error))
        return
    yield from rows
    yield from _lock_rows(config, identity)


def _calibration_row(config: CameraConfig, folder: Path) -> Check:
    if config.model is None:
        text = "camera.model: not calibrated; images cannot be tracked"
        remedy = "run `deltact-fab calibrate lens`"
        return _row("camera", "calibration", "warn", text, remedy)
    path = folder / config.model
    try:
        size_px = raw_size_px(calibrated_camera(path))
    except InputError as error:
        return _row("camera", "calibration", "fail", str(error))
    configured_px = (config.width_px, config.height_px)
    if config.width_px is not None and configured_px != size_px:
        text = f"camera.model: for images of {size_px[0]} x {size_px[1]} px"
        return _row("camera", "calibration", "fail", text)
    return _row("camera", "calibration", "pass", f"calibrated: {path}")


def _image_rows(camera: Camera, config: CameraConfig, seconds: float) -> Iterator[Check]:
    """Rows from at least two images; losses are counted from the second one on."""
    camera.begin("probe")
    first_s = camera.capture().t_s
    n = dropped = repeated = 0
    until_s = time.monotonic() + seconds
    while n == 0 or time.monotonic() < until_s:
        last = camera.capture()
        n += 1
        dropped += last.dropped
        repeated += last.repeated
    image, took_s, identity = last.image, last.t_s - first_s, camera.identity()
    h, w = image.shape[:2]
    stamped = identity["stamped_by"]
    delay = f", {config.latency_ms:g} ms after its exposure" if stamped == "arrival" else ""
    lag = f", {identity['lag_ms']} ms before its arrival"
    text = f"images of {w} x {h} px, stamped by {stamped}{delay or lag}"
    yield _row("camera", "images", "pass", text)
    nominal, hz = identity["rate_hz"], n / took_s if took_s > 0 else 0.0
    slow = nominal is not None and hz < MIN_IMAGE_RATE_SHARE * nominal
    of_nominal = "" if nominal is None else f" of {nominal:g}"
    remedy = (SLOW_DEVICE if config.is_device else SLOW_SENDER) if slow else ""
    yield _row("camera", "rate", graded(not slow), f"{hz:.1f} images per s{of_nominal}", remedy)
    text = f"{dropped} lost, {repeated} repeated"
    yield _row("camera", "lost", graded(not (dropped or repeated)), text)
    bright = float(np.mean(image == 255))
    if bright > MAX_OVEREXPOSED_SHARE:
        text = f"{bright:.0%} of the image is over-exposed"
        yield _row("camera", "light", "fail", text, "reduce the light or the exposure")
    elif image.mean() < MIN_MEAN_GREY:
        remedy = "check the light and the lens cap"
        yield _row("camera", "light", "fail", "the image is dark", remedy)


def _lock_rows(config: CameraConfig, identity: dict[str, Any]) -> Iterator[Check]:
    """Rows for the automatic controls of a V4L2 device."""
    controls: dict[str, Any] = identity.get("controls", {})
    for key, automatic in AUTO_KEYS.items() if controls else ():
        value = controls[key]
        if getattr(config, key) is not None:
            yield _row("camera", key.replace("_", "-"), "pass", f"{key} locked at {value:g}")
        elif value is not None and (automatic is None or controls[automatic] is not None):
            remedy = f"`{key} = {value:.0f}` keeps the present value"
            yield _row("camera", key.replace("_", "-"), "fail", f"camera.{key}: not locked", remedy)


def force_rows(config: ForceConfig, guard: GuardConfig | None, seconds: float) -> Iterator[Check]:
    """Open the sensor, tare it with nothing touching, and check its samples for some seconds.

    A sensor that fails gives a row, no exception.
    """
    try:
        yield from _box_rows(config)
        with closing(open_force(config, WallClock())) as sensor:
            rows = list(_sample_rows(sensor, config, seconds))
        yield from rows
    except DeltactFabError as error:
        yield _row("force", "answer", "fail", str(error))
    try:
        limits = GuardLimits.from_config(guard, config)
    except InputError as error:
        yield _row("force", "guard", "fail", str(error))
        return
    force = ", ".join(f"{value:g}" for value in limits.force_n)
    torque = ", ".join(f"{value:g}" for value in limits.torque_nmm)
    text = f"the guard stops the stage at {force} N and {torque} N mm"
    yield _row("force", "guard", "pass", text)


def _box_rows(config: ForceConfig) -> Iterator[Check]:
    """Compare the box's own settings with the rig file. Raises SensorError, InputError."""
    if config.netft is None:
        return
    s = fetch_settings(config.netft)
    about = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in s.about)
    text = f"{config.netft.host}: transducer {s.serial}, {about}"
    yield _row("force", "transducer", "pass", text)
    text = f"{s.counts_per_n:g} counts/N, {s.counts_per_nmm:g} counts/(N mm)"
    yield _row("force", "counts", "pass", text)
    for key, rated in (("range_n", s.range_n), ("range_nmm", s.range_nmm)):
        declared = getattr(config, key)
        if rated is None:
            text = f"force.{key}: {declared}; the box reports no range"
            yield _row("force", key.replace("_", "-"), "pass", text)
            continue
        right = [round(value, 3) for value in rated]
        if np.allclose(declared, rated, rtol=RANGE_TOLERANCE):
            text = f"force.{key} = {right}, same as the transducer"
            yield _row("force", key.replace("_", "-"), "pass", text)
        else:
            wrong = f"force.{key}: {list(declared)}; the transducer has {right}: use that"
            yield _row("force", key.replace("_", "-"), "fail", wrong)


def _sample_rows(sensor: ForceSensor, config: ForceConfig, seconds: float) -> Iterator[Check]:
    """Rate, losses, tare, noise and change. Raises SensorError, also for a still Net F/T.

    A scale is at rest in the first half of the time, and may be pressed in the second.
    """
    sensor.begin("probe")
    until_s = time.monotonic() + seconds
    parts = [sensor.read()]
    while time.monotonic() < until_s:
        parts.append(sensor.read())
    t_ns = np.concatenate([part.t_ns for part in parts])
    values = np.concatenate([np.hstack([part.force_n, part.torque_nmm]) for part in parts])
    nominal_hz = float(sensor.identity()["rate_hz"] or 0)
    hz = (len(t_ns) - 1) / max((t_ns[-1] - t_ns[0]) / 1e9, 1e-9)
    slow = config.netft is not None and hz < MIN_SAMPLE_RATE_SHARE * nominal_hz
    remedy = ""
    if config.serial is not None:
        nominal_hz = config.serial.rate_hz
        if abs(hz / nominal_hz - 1) > SCALE_RATE_TOLERANCE:
            remedy = f"set force.serial.rate_hz = {hz:.3g}, for planned times"
    n_lost, n_late = sum(part.n_lost for part in parts), sum(part.n_late for part in parts)
    text = f"{hz:.0f} of {nominal_hz:g} samples per s"
    yield _row("force", "rate", graded(not slow, warns=bool(remedy)), text, remedy)
    text = f"{n_lost} samples lost, {n_late} late"
    yield _row("force", "lost", graded(not n_lost, warns=n_late > 0), text)
    if any(part.saturated.any() for part in parts):
        text = "saturated with nothing touching: check that the tip is free"
        yield _row("force", "saturation", "fail", text)
    ranges = np.array([*config.range_n, *config.range_nmm])
    rest = values if config.netft is not None else values[: (len(values) + 1) // 2]
    mean, noise = np.abs(rest.mean(axis=0)), rest.std(axis=0)
    text = f"{mean[:3].max():.3f} N and {mean[3:].max():.2f} N mm remain after the tare"
    yield _row("force", "tare", graded(bool((mean <= MAX_REST_SHARE * ranges).all())), text)
    if values.std(axis=0).any():
        yield _row("force", "change", "pass", "readings change")
    else:
        text = f"{len(values)} equal readings: a dead sensor, or a scale at rest"
        yield _row("force", "change", "warn", text, UNCHANGED_SCALE)
    quiet = bool((noise <= MAX_REST_SHARE * ranges).all())
    text = f"noise at rest {noise[:3].max():.4f} N, {noise[3:].max():.3f} N mm (1 sigma)"
    text = text if quiet else f"{text}: check that nothing touches or shakes it"
    yield _row("force", "noise", graded(quiet), text)


def ask_devices(bench: OpenBench) -> list[str]:
    """Query each device of a bench and return a line for each.

    The stage is connected and its settings checked; the camera takes an image, the force sensor
    a reading. Raises InputError, StageError, SensorError.
    """
    lines = []
    if isinstance(bench, Rig):
        bench.stage.connect()
        lines.append(f"stage: {_identity(bench.stage.identity(), 'banner', 'port')}")
    if bench.camera is not None:
        bench.camera.begin("dry-run")
        frame = bench.camera.capture()
        h, w = frame.image.shape[:2]
        age_ms = (bench.clock.now_s() - frame.t_s) * 1e3
        name = _identity(bench.camera.identity(), "name", "kind")
        lines.append(f"camera: {name}: {w} x {h} px, {age_ms:.0f} ms old")
    if bench.force is not None:
        bench.force.start()
        try:
            samples = bench.force.read()
        finally:
            bench.force.stop()
        x, y, z = samples.force_n[-1]
        name = _identity(bench.force.identity(), "kind", "serial")
        lines.append(f"force sensor: {name}: {x:+.2f}, {y:+.2f}, {z:+.2f} N, not tared")
        if samples.saturated.any():
            lines.append("force sensor: SATURATED: the guard would stop the run immediately")
    return lines


def _identity(identity: dict[str, object], *keys: str) -> str:
    return " ".join(str(identity[key]) for key in keys if identity.get(key)) or "answers"
