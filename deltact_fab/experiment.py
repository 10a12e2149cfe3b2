"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import __version__, preflight, record
from .cad.design import load_design
from .errors import InputError
from .patterns.dots import centres_mm
from .patterns.recipe import PatternRecipe, load_recipe
from .protocols import limits, plan
from .protocols.plan import Protocol, Step
from .record import RunWriter
from .record import open as open_run
from .rig import config as rig_config
from .rig.config import RigConfig
from .rig.runner import Runner
from .shapes import SensorDimensions

Progress = Callable[[int, int, str], None]


def checks(protocol_name: str, rig_name: str) -> list[limits.Check]:
    """Static checks of a protocol on a rig; of forces those that take seconds to predict."""
    protocol, source = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    rows = limits.check(protocol, sensor, rig.stage.box)
    if rig.kind == "virtual":
        rows.append(_answered(protocol, sensor, rig, str(source)))
    # What leaves the gel or the stage is said already, and has no force.
    if all(row.ok for row in rows):
        declared = preflight.limits_of(rig, str(path), protocol)
        peaks = preflight.predict(protocol, sensor, declared.origin_mm, solve=False)
        rows += [] if peaks is None else preflight.checks(peaks, declared)
    return rows


def _answered(
    protocol: Protocol, sensor: SensorDimensions, rig: RigConfig, source: str
) -> limits.Check:
    """Whether the simulated gel has a level and a mesh for every press."""
    from .virtual.answerable import unanswered

    why = unanswered(protocol, sensor, rig.gel, source)
    what = "refusals for lack of a level or a mesh"
    return limits.Check("simulated gel", not why, what, len(why), 0, "; ".join(why))


def show(protocol_name: str, rig_name: str) -> tuple[list[Step], limits.Estimate]:
    """Steps and estimate of a protocol on a rig."""
    protocol, _ = plan.load(protocol_name)
    rig, _ = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    return plan.expand(protocol), limits.estimate(protocol, sensor, rig.stage.box)


def forces(
    protocol_name: str, rig_name: str, progress: Progress | None = None, solve: bool = True
) -> tuple[list[preflight.Peak], list[str]] | None:
    """Predicted peaks of a protocol, and what the rig says to them, one line each.

    None where that would take more than seconds and solve is False. Raises InputError.
    """
    protocol, _ = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    limits = preflight.limits_of(rig, str(path), protocol)
    peaks = preflight.predict(protocol, sensor, limits.origin_mm, progress, solve)
    if peaks is None:
        return None
    return peaks, preflight.judge(protocol.name, sensor.skin.thickness_mm, peaks, limits)


def run(
    protocol_name: str,
    rig_name: str,
    out: Path,
    seed: int = 0,
    progress: Progress | None = None,
    resume: bool = False,
) -> dict[str, Any]:
    """Check everything, run every step, return the summary.

    resume: continue the unfinished run in `out`, or start it when there is none; a finished one is
    left as it is, and its summary comes with "already_finished" true. The summary's times, notes
    and devices are those of the last session. Raises InputError or RunFailed.
    """
    started = time.monotonic()
    protocol, source = plan.load(protocol_name)
    rig, rig_path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    recipe = load_recipe(protocol.specimen.pattern)
    steps = plan.expand(protocol)
    limits.require(limits.check(protocol, sensor, rig.stage.box, steps), str(source))

    from .virtual.answerable import require_answers
    from .virtual.rig import VirtualRig, identity

    require_answers(protocol, sensor, rig.gel, str(source))
    text = source.read_bytes()
    meta = _meta(protocol, rig, rig_name, sensor, seed, out.name)
    pattern = _pattern(recipe)
    resuming = out.exists() and resume
    if resuming:
        found = open_run(out)
        record.require_same(found, meta, text, pattern, with_versions=not found.finished)
        if found.finished:
            return {**found.summary(), "already_finished": True}
    else:
        _require_new(out, text)
    warnings = _force_warnings(protocol, rig, str(rig_path), sensor, progress)
    if resuming:
        writer = RunWriter.resume(out, steps, progress)
    else:
        writer = RunWriter.create(out, meta, text, pattern, steps)
    try:
        bench = VirtualRig(rig, protocol, sensor, recipe, seed, out)
        taken = Runner(bench.devices(), writer, progress).run(steps)
        frames = sum(step.frames for step in steps)
        summary = {
            "protocol": protocol.name,
            "rig": rig_name,
            "simulated": rig.kind == "virtual",
            "seed": seed,
            "steps": len(steps),
            "frames": frames,
            "sessions": writer.session,
            "kept_frames": frames - taken,
            "redone": writer.redone,
            "rig_seconds": bench.clock.now_s(),
            "wall_seconds": time.monotonic() - started,
            "left_out": bench.left_out(),
            "notes": [*bench.notes(), *warnings, *_resumed(writer.session, frames - taken)],
            "devices": identity(bench),
        }
        writer.close(summary)
    except BaseException:
        writer.abandon()
        raise
    return {**summary, "already_finished": False}


def _force_warnings(
    protocol: Protocol,
    rig: RigConfig,
    rig_source: str,
    sensor: SensorDimensions,
    progress: Progress | None,
) -> list[str]:
    """Predicted forces against the rig's limits: refused on a real rig, noted on the simulated."""
    limits = preflight.limits_of(rig, rig_source, protocol)
    peaks = preflight.predict(protocol, sensor, limits.origin_mm, progress)
    assert peaks is not None
    lines = preflight.judge(protocol.name, sensor.skin.thickness_mm, peaks, limits)
    return [f"WARNING: {line}" for line in preflight.require(lines, limits)]


def _require_new(out: Path, protocol: bytes) -> None:
    """Raise InputError when the folder is there, with what can be done about it."""
    if not out.exists():
        return
    hint = "name a new --out folder"
    try:
        found = open_run(out)
        if not found.finished and (out / "protocol.toml").read_bytes() == protocol:
            hint = "an unfinished run of this protocol: go on with --resume, or " + hint
    except (OSError, InputError):
        pass
    raise InputError(f"{out}: already there; {hint}")


def _resumed(sessions: int, kept_frames: int) -> list[str]:
    if sessions == 1:
        return []
    return [
        f"resumed: session {sessions} kept {kept_frames} frames of those before it; seconds and "
        "solved problems count this session only"
    ]


def _meta(
    protocol: Protocol,
    rig: RigConfig,
    rig_name: str,
    sensor: SensorDimensions,
    seed: int,
    name: str,
) -> dict[str, Any]:
    from .virtual.rig import pinhole

    dumped = protocol.model_dump(mode="json")
    dumped["channels"] = sorted(dumped["channels"])
    return {
        "name": name,
        "protocol": dumped,
        "rig_name": rig_name,
        "rig": rig.model_dump(mode="json"),
        "sensor": asdict(sensor),
        "camera": pinhole(sensor).as_dict(),
        "simulated": rig.kind == "virtual",
        "seed": seed,
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions that can change a number."""
    from importlib.metadata import PackageNotFoundError, version

    found = {"deltact-fab": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "opencv-contrib-python-headless", "cadquery"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def _pattern(recipe: PatternRecipe) -> dict[str, Any]:
    """Recipe and dot centres as data, so that analysis needs no maker of patterns."""
    dots = recipe.dots
    return {
        "recipe": recipe.model_dump(mode="json"),
        "dots_mm": centres_mm(dots).tolist() if dots is not None else [],
        "dot_diameter_mm": dots.diameter_mm if dots is not None else 0.0,
    }
