"""What is wrong with a force sensor, and how to put it right: it is opened and listened to."""

from __future__ import annotations

import time

import numpy as np

from ...errors import DeltactFabError
from ..clock import WallClock
from ..interface import BenchFinding, ForceSensor
from .config import ForceConfig, GuardConfig
from .guard import GuardLimits
from .netft import SILENT_S
from .open import open_force

LISTEN_S = 2.0
SLOW = 0.98
"""Of the rate that the box tells; below, records are lost."""
NOISY = 0.01
"""Of the range, one deviation at rest."""
NEAR = 0.02
"""Ranges of the box and of the rig file that differ by less are the same."""


def probe(
    config: ForceConfig,
    guard: GuardConfig | None = None,
    seconds: float = LISTEN_S,
    silent_s: float = SILENT_S,
) -> list[BenchFinding]:
    """Open the sensor, tare it with nothing touching, listen for so long, and judge what it says.

    silent_s: see `open_force`. Raises nothing that a sensor can cause: it is a finding.
    """
    try:
        findings = _page(config)
        sensor = open_force(config, WallClock(), silent_s)
    except DeltactFabError as why:
        return [BenchFinding(False, str(why))]
    try:
        findings += _heard(sensor, config, seconds)
    except DeltactFabError as why:
        return [*findings, BenchFinding(False, str(why))]
    finally:
        sensor.close()
    return [*findings, _guard(config, guard)]


def _page(config: ForceConfig) -> list[BenchFinding]:
    """What the box says of itself, against the rig file. Raises SensorError, InputError."""
    if config.netft is None:
        return []
    from .page import fetch

    page = fetch(config.netft)
    s = page.settings
    about = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in s.about)
    findings = [
        BenchFinding(True, f"{config.netft.host}: transducer {s.serial}, {about}"),
        BenchFinding(
            True,
            f"{s.counts_per_n:g} counts a newton, {s.counts_per_nmm:g} a newton millimetre (the "
            f"box is set to {page.force_unit} and {page.torque_unit})",
        ),
    ]
    for key, told in (("range_n", page.range_n), ("range_nmm", page.range_nmm)):
        written = getattr(config, key)
        if told is None:
            findings.append(
                BenchFinding(True, f"force.{key}: {written}, which the box does not tell")
            )
        else:
            same = np.allclose(written, told, rtol=NEAR)
            right = [round(value, 3) for value in told]
            text = f"force.{key} = {right}, as the transducer's"
            wrong = f"force.{key}: {list(written)}; the transducer's is {right}: write that"
            findings.append(BenchFinding(same, text if same else wrong))
    return findings


def _heard(sensor: ForceSensor, config: ForceConfig, seconds: float) -> list[BenchFinding]:
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
    findings = [
        BenchFinding(not slow, f"{hz:.0f}{of} samples a second"),
        BenchFinding(not lost and not late, f"{lost} samples lost, {late} late"),
    ]
    if any(part.saturated.any() for part in parts):
        findings.append(BenchFinding(False, "saturated with nothing touching: is the tip free?"))
    ranges = np.array([*config.range_n, *config.range_nmm])
    mean, noise = np.abs(values.mean(axis=0)), values.std(axis=0)
    text = f"{mean[:3].max():.3f} N and {mean[3:].max():.2f} N mm are left after the tare"
    findings.append(BenchFinding(bool((mean <= NOISY * ranges).all()), text))
    quiet = bool((noise <= NOISY * ranges).all())
    dead = config.netft is not None and not noise.any()
    text = f"noise at rest {noise[:3].max():.4f} N, {noise[3:].max():.3f} N mm (one deviation)"
    if dead:
        text = "the readings do not change at all: is the transducer plugged in?"
    elif not quiet:
        text += ": does something touch or shake it?"
    findings.append(BenchFinding(quiet and not dead, text))
    return findings


def _guard(config: ForceConfig, guard: GuardConfig | None) -> BenchFinding:
    """Where the guard stops the stage."""
    try:
        limits = GuardLimits.of(guard, config)
    except DeltactFabError as why:
        return BenchFinding(False, str(why))
    force = ", ".join(f"{value:g}" for value in limits.force_n)
    torque = ", ".join(f"{value:g}" for value in limits.torque_nmm)
    return BenchFinding(True, f"the guard stops the stage at {force} N and {torque} N mm")
