"""What is wrong with a bench, and how to put it right: each device is talked to, nothing moves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Check, DeltactFabError, InputError, SensorError, Status, graded

from .bench import lacking
from .camera.model import calibrated_camera, open_camera, raw_size_px
from .config import GrblConfig
from .force.guard import GuardLimits
from .force.rdt import fetch
from .force.watchdog import open_force
from .interface import Camera, ForceSensor, OpenBench, Rig, WallClock
from .stage.grbl import GrblStage
from .tables import CameraConfig, ForceConfig, GuardConfig

SLOW = 0.95
"""Of the nominal rate; below, something holds the camera back."""
BRIGHT = 0.01
"""Share of an image that may be at the end of its scale."""
DARK = 16
SLOW_DEVICE = "a shorter exposure, another fourcc or a faster port would help"
SLOW_SENDER = "what sends them is slow, or this computer is busy"
HOLDS = {"exposure": "auto_exposure", "gain": None, "white_balance_k": "auto_white_balance"}
SLOW_SENSOR = 0.98
"""Of the rate that the box tells; below, records are lost."""
NOISY = 0.01
"""Of the range, one deviation at rest."""
NEAR = 0.02
"""Ranges of the box and of the rig file that differ by less are the same."""


def check_rig(config: GrblConfig, folder: Path, seconds: float) -> Iterator[Check]:
    """Look at stage, force sensor, guard, camera and at what a press needs besides.

    folder: of the rig file. seconds: how long camera and sensor are watched. Raises nothing that a
    device can cause: that is a row.
    """
    yield from _stage(config)
    if config.force is not None and config.force.reachable:
        yield from force_rows(config.force, config.guard, seconds)
    if config.camera is not None:
        yield from camera_rows(config.camera, folder, seconds)
    else:
        text = "no [camera]: a protocol with the channel image is refused"
        yield _row("camera", "table", "warn", text)
    yield from _presses(config)


def _stage(config: GrblConfig) -> Iterator[Check]:
    stage = GrblStage.of(config.stage, WallClock())
    refused = ""
    try:
        stage.connect()
    except DeltactFabError as why:
        refused = str(why)
    finally:
        stage.close()
    told = stage.identity()
    if read := len(told["settings"]):
        banner = told["banner"] or "no banner: the board does not restart when opened"
        text = f"{config.stage.port} answers: {banner}; {read} settings were read"
        yield _row("stage", "answer", "pass", text)
    yield from stage.judged
    if refused and not any(row.failed for row in stage.judged):
        remedy = "check its power and cable, [stage] port and baud, and that no other program has"
        yield _row("stage", "connection", "fail", refused, f"{remedy} the port")


def _presses(config: GrblConfig) -> Iterator[Check]:
    """What a press needs of the rig file; without it a run goes in air only."""
    force, missing = config.force, lacking(config)
    if force is not None and force.reachable and "range_n" not in force.model_fields_set:
        missing["range"] = "[force] range_n is not declared: write it from the calibration sheet"
    if config.stage.max_force_n is None:
        missing["max-force"] = (
            "[stage] max_force_n is not declared: measure what the axes push without losing steps"
        )
    for id, text in missing.items():
        yield _row("presses", id, "fail", text)
    if not missing:
        yield _row("presses", "rig-file", "pass", "the rig file has all that a press needs")


def _row(device: str, id: str, status: Status, text: str, remedy: str = "") -> Check:
    return Check(f"{device}.{id}", device, value=text, status=status, remedy=remedy)


def camera_rows(config: CameraConfig, folder: Path, seconds: float) -> Iterator[Check]:
    """Open the camera of a rig file, look through it for so long, and judge what comes.

    folder: of the rig file. Raises nothing that a camera can cause: that is a row.
    """
    yield _calibration(config, folder)
    try:
        with closing(open_camera(config, folder, WallClock())) as camera:
            rows = list(_camera_images(camera, config, seconds))
            told = camera.identity()
    except (InputError, SensorError) as why:
        yield _row("camera", "images", "fail", str(why))
        return
    yield from rows
    yield from _locks(config, told)


def _calibration(config: CameraConfig, folder: Path) -> Check:
    if config.model is None:
        text = "camera.model: not calibrated, nothing can be tracked"
        remedy = "`deltact-fab calibrate lens` makes the file"
        return _row("camera", "calibration", "warn", text, remedy)
    path = folder / config.model
    try:
        size_px = raw_size_px(calibrated_camera(path))
    except InputError as why:
        return _row("camera", "calibration", "fail", str(why))
    asked = (config.width_px, config.height_px)
    if config.width_px is not None and asked != size_px:
        text = f"camera.model: of images of {size_px[0]} x {size_px[1]} px"
        return _row("camera", "calibration", "fail", text)
    return _row("camera", "calibration", "pass", f"calibrated: {path}")


def _camera_images(camera: Camera, config: CameraConfig, seconds: float) -> Iterator[Check]:
    """What at least two images tell. The first says nothing of what was lost before it."""
    camera.begin("probe")
    first_s = camera.capture().t_s
    n = dropped = repeated = 0
    until_s = time.monotonic() + seconds
    while n == 0 or time.monotonic() < until_s:
        last = camera.capture()
        n += 1
        dropped += last.dropped
        repeated += last.repeated
    image, took_s, told = last.image, last.t_s - first_s, camera.identity()
    h, w = image.shape[:2]
    stamped = told["stamped_by"]
    after = f", {config.latency_ms:g} ms after its exposure" if stamped == "arrival" else ""
    text = f"images of {w} x {h} px, stamped by {stamped}{after}"
    yield _row("camera", "images", "pass", text)
    nominal, hz = told["rate_hz"], n / took_s if took_s > 0 else 0.0
    slow = nominal is not None and hz < SLOW * nominal
    asked = "" if nominal is None else f" of {nominal:g}"
    why = (SLOW_DEVICE if config.is_device else SLOW_SENDER) if slow else ""
    yield _row("camera", "rate", graded(not slow), f"{hz:.1f} images a second{asked}", why)
    text = f"{dropped} lost, {repeated} repeated"
    yield _row("camera", "lost", graded(not (dropped or repeated)), text)
    bright = float(np.mean(image == 255))
    if bright > BRIGHT:
        text = f"{bright:.0%} of the image is over-exposed"
        yield _row("camera", "light", "fail", text, "less light or a shorter exposure")
    elif image.mean() < DARK:
        remedy = "is the light on, the lens uncovered?"
        yield _row("camera", "light", "fail", "the image is dark", remedy)


def _locks(config: CameraConfig, told: dict[str, Any]) -> Iterator[Check]:
    """Of a V4L2 device: what it would change by itself."""
    controls: dict[str, Any] = told.get("controls", {})
    for key, automatic in HOLDS.items() if controls else ():
        has = controls[key]
        if getattr(config, key) is not None:
            yield _row("camera", key.replace("_", "-"), "pass", f"{key} locked at {has:g}")
        elif has is not None and (automatic is None or controls[automatic] is not None):
            remedy = f"`{key} = {has:.0f}` keeps what it has"
            yield _row("camera", key.replace("_", "-"), "fail", f"camera.{key}: not locked", remedy)


def force_rows(config: ForceConfig, guard: GuardConfig | None, seconds: float) -> Iterator[Check]:
    """Open the sensor, tare it with nothing touching, listen for so long, and judge what it says.

    Raises nothing that a sensor can cause: that is a row.
    """
    try:
        yield from _page(config)
        with closing(open_force(config, WallClock())) as sensor:
            heard = list(_heard(sensor, config, seconds))
        yield from heard
        limits = GuardLimits.of(guard, config)
    except DeltactFabError as why:
        yield _row("force", "answer", "fail", str(why))
        return
    force = ", ".join(f"{value:g}" for value in limits.force_n)
    torque = ", ".join(f"{value:g}" for value in limits.torque_nmm)
    text = f"the guard stops the stage at {force} N and {torque} N mm"
    yield _row("force", "guard", "pass", text)


def _page(config: ForceConfig) -> Iterator[Check]:
    """What the box says of itself, against the rig file. Raises SensorError, InputError."""
    if config.netft is None:
        return
    s = fetch(config.netft)
    about = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in s.about)
    text = f"{config.netft.host}: transducer {s.serial}, {about}"
    yield _row("force", "transducer", "pass", text)
    text = f"{s.counts_per_n:g} counts a newton, {s.counts_per_nmm:g} a newton millimetre"
    yield _row("force", "counts", "pass", text)
    for key, told in (("range_n", s.range_n), ("range_nmm", s.range_nmm)):
        written = getattr(config, key)
        if told is None:
            text = f"force.{key}: {written}, which the box does not tell"
            yield _row("force", key.replace("_", "-"), "pass", text)
            continue
        right = [round(value, 3) for value in told]
        if np.allclose(written, told, rtol=NEAR):
            yield _row(
                "force",
                key.replace("_", "-"),
                "pass",
                f"force.{key} = {right}, as the transducer's",
            )
        else:
            wrong = f"force.{key}: {list(written)}; the transducer's is {right}: write that"
            yield _row("force", key.replace("_", "-"), "fail", wrong)


def _heard(sensor: ForceSensor, config: ForceConfig, seconds: float) -> Iterator[Check]:
    """Rate, losses, tare and noise. Raises SensorError."""
    sensor.begin("probe")
    until_s = time.monotonic() + seconds
    parts = [sensor.read()]
    while time.monotonic() < until_s:
        parts.append(sensor.read())
    t_ns = np.concatenate([part.t_ns for part in parts])
    values = np.concatenate([np.hstack([part.force_n, part.torque_nmm]) for part in parts])
    told_hz = float(sensor.identity()["rate_hz"] or 0)
    hz = (len(t_ns) - 1) / max((t_ns[-1] - t_ns[0]) / 1e9, 1e-9)
    slow = config.netft is not None and hz < SLOW_SENSOR * told_hz
    of = f" of {told_hz:g}" if config.netft is not None else ""
    lost, late = sum(part.lost for part in parts), sum(part.late for part in parts)
    yield _row("force", "rate", graded(not slow), f"{hz:.0f}{of} samples a second")
    text = f"{lost} samples lost, {late} late"
    yield _row("force", "lost", graded(not lost, warns=late > 0), text)
    if any(part.saturated.any() for part in parts):
        text = "saturated with nothing touching: is the tip free?"
        yield _row("force", "saturation", "fail", text)
    ranges = np.array([*config.range_n, *config.range_nmm])
    mean, noise = np.abs(values.mean(axis=0)), values.std(axis=0)
    text = f"{mean[:3].max():.3f} N and {mean[3:].max():.2f} N mm are left after the tare"
    yield _row("force", "tare", graded(bool((mean <= NOISY * ranges).all())), text)
    if config.netft is not None and not noise.any():
        text = "the readings do not change at all: is the transducer plugged in?"
        yield _row("force", "noise", "fail", text)
        return
    quiet = bool((noise <= NOISY * ranges).all())
    text = f"noise at rest {noise[:3].max():.4f} N, {noise[3:].max():.3f} N mm (one deviation)"
    text = text if quiet else f"{text}: does something touch or shake it?"
    yield _row("force", "noise", graded(quiet), text)


def ask_devices(bench: OpenBench) -> list[str]:
    """Ask each device of a bench; returns a line for each: that it answers, and how.

    The stage is connected, its settings are judged; the camera gives an image, the force sensor
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
            lines.append("force sensor: SATURATED: the guard would stop the run at once")
    return lines


def _identity(identity: dict[str, object], *keys: str) -> str:
    return " ".join(str(identity[key]) for key in keys if identity.get(key)) or "answers"
