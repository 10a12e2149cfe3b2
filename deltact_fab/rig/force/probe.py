"""What is wrong with a force sensor, and how to put it right: it is opened and listened to."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing

import numpy as np

from ...errors import DeltactFabError
from ..interface import DeviceRow, ForceSensor, WallClock
from .config import ForceConfig, GuardConfig
from .guard import GuardLimits
from .open import open_force

SLOW = 0.98
"""Of the rate that the box tells; below, records are lost."""
NOISY = 0.01
"""Of the range, one deviation at rest."""
NEAR = 0.02
"""Ranges of the box and of the rig file that differ by less are the same."""


def probe(config: ForceConfig, guard: GuardConfig | None, seconds: float) -> Iterator[DeviceRow]:
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
        yield _row(False, str(why))
        return
    force = ", ".join(f"{value:g}" for value in limits.force_n)
    torque = ", ".join(f"{value:g}" for value in limits.torque_nmm)
    yield _row(True, f"the guard stops the stage at {force} N and {torque} N mm")


def _row(passed: bool, text: str, otherwise: str = "FAIL") -> DeviceRow:
    return DeviceRow("force", "pass" if passed else otherwise, text)


def _page(config: ForceConfig) -> Iterator[DeviceRow]:
    """What the box says of itself, against the rig file. Raises SensorError, InputError."""
    if config.netft is None:
        return
    from .page import fetch

    page = fetch(config.netft)
    s = page.settings
    about = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in s.about)
    yield _row(True, f"{config.netft.host}: transducer {s.serial}, {about}")
    text = f"{s.counts_per_n:g} counts a newton, {s.counts_per_nmm:g} a newton millimetre"
    yield _row(True, text)
    for key, told in (("range_n", page.range_n), ("range_nmm", page.range_nmm)):
        written = getattr(config, key)
        if told is None:
            yield _row(True, f"force.{key}: {written}, which the box does not tell")
            continue
        right = [round(value, 3) for value in told]
        if np.allclose(written, told, rtol=NEAR):
            yield _row(True, f"force.{key} = {right}, as the transducer's")
        else:
            wrong = f"force.{key}: {list(written)}; the transducer's is {right}: write that"
            yield _row(False, wrong)


def _heard(sensor: ForceSensor, config: ForceConfig, seconds: float) -> Iterator[DeviceRow]:
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
    slow = config.netft is not None and hz < SLOW * told_hz
    of = f" of {told_hz:g}" if config.netft is not None else ""
    lost, late = sum(part.lost for part in parts), sum(part.late for part in parts)
    yield _row(not slow, f"{hz:.0f}{of} samples a second")
    text = f"{lost} samples lost, {late} late"
    yield _row(not lost and not late, text, "FAIL" if lost else "WARN")
    if any(part.saturated.any() for part in parts):
        yield _row(False, "saturated with nothing touching: is the tip free?")
    ranges = np.array([*config.range_n, *config.range_nmm])
    mean, noise = np.abs(values.mean(axis=0)), values.std(axis=0)
    text = f"{mean[:3].max():.3f} N and {mean[3:].max():.2f} N mm are left after the tare"
    yield _row(bool((mean <= NOISY * ranges).all()), text)
    if config.netft is not None and not noise.any():
        yield _row(False, "the readings do not change at all: is the transducer plugged in?")
        return
    quiet = bool((noise <= NOISY * ranges).all())
    text = f"noise at rest {noise[:3].max():.4f} N, {noise[3:].max():.3f} N mm (one deviation)"
    yield _row(quiet, text if quiet else f"{text}: does something touch or shake it?")
