"""Asking every device of a rig once, with nothing moved and nothing kept: a dry run."""

from __future__ import annotations

from ..job import Devices


def devices(found: Devices) -> list[str]:
    """A line a device: that it answers, and how. Raises InputError, StageError, SensorError.

    The stage is connected, its settings are judged; the camera gives an image, the force sensor
    a reading.
    """
    found.stage.connect()
    lines = [f"stage: {_named(found.stage.identity(), 'banner', 'port')}"]
    if found.camera is not None:
        found.camera.begin("dry-run")
        frame = found.camera.capture()
        h, w = frame.image.shape[:2]
        age_ms = (found.clock.now_s() - frame.t_s) * 1e3
        name = _named(found.camera.identity(), "name", "kind")
        lines.append(f"camera: {name}: {w} x {h} px, {age_ms:.0f} ms old")
    if found.force is not None:
        found.force.start()
        try:
            samples = found.force.read()
        finally:
            found.force.stop()
        x, y, z = samples.force_n[-1]
        name = _named(found.force.identity(), "kind", "serial")
        lines.append(f"force sensor: {name}: {x:+.2f}, {y:+.2f}, {z:+.2f} N, not tared")
        if samples.saturated.any():
            lines.append("force sensor: SATURATED: the guard would stop the run at once")
    return lines


def _named(identity: dict[str, object], *keys: str) -> str:
    return " ".join(str(identity[key]) for key in keys if identity.get(key)) or "answers"
