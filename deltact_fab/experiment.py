"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import __version__, preflight, record
from .cad.design import load_design
from .errors import InputError
from .optics import Rectified
from .patterns.dots import centres_mm
from .patterns.recipe import PatternRecipe, load_recipe
from .protocols import limits, plan
from .protocols.plan import Protocol, Step
from .record import RunWriter
from .record import open as open_run
from .rig import config as rig_config
from .rig.config import RigConfig
from .rig.interface import Job, RigKind
from .rig.run.runner import Runner
from .rig.tool import demands
from .shapes import SensorDimensions

Progress = Callable[[int, int, str], None]


def kind_of(
    rig: RigConfig, source: Path, realtime: bool = False, progress: Progress | None = None
) -> RigKind:
    """What a kind of rig says and builds. Only the one that is asked for is imported.

    source: of the rig file, from which the paths in it count. realtime: a virtual rig on the wall
    clock and real wires. progress: hears of what is solved before that. Raises InputError.
    """
    if rig.kind == "grbl":
        from .rig.bench import GrblKind

        if realtime:
            raise InputError(f"{source}: --realtime is of a virtual rig; this one is real")
        return GrblKind(rig, source)
    if realtime:
        from .virtual.realtime.rig import RealtimeKind

        return RealtimeKind(rig, source, progress)
    from .virtual.rig import VirtualKind

    return VirtualKind(rig, source)


def checks(
    protocol_name: str, rig_name: str, air: bool = False, unattended: bool = False
) -> list[limits.Check]:
    """Static checks of a protocol on a rig; of forces those that take seconds to predict."""
    protocol, source = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    kind = kind_of(rig, path)
    kind.camera(protocol, sensor)  # a file that cannot be used is said now
    rows = limits.check(protocol, sensor, rig.stage.box, plan.expand(protocol, air))
    refused = kind.refusals(protocol, sensor, str(source))
    rows += [_check(kind.part, "refusals", refused)]
    rows += _contact(rig, protocol, sensor, air, unattended)
    # What leaves the gel or the stage is said already, and has no force.
    if all(row.ok for row in rows) and not air:
        declared = preflight.limits_of(rig, str(path), protocol)
        peaks = preflight.predict(protocol, sensor, declared.origin_mm, solve=False)
        rows += [] if peaks is None else preflight.checks(peaks, declared)
    return rows


def _check(name: str, what: str, reasons: list[str]) -> limits.Check:
    return limits.Check(name, not reasons, what, len(reasons), 0, "; ".join(reasons))


def _contact(
    rig: RigConfig, protocol: Protocol, sensor: SensorDimensions, air: bool, unattended: bool
) -> list[limits.Check]:
    """What a real rig lacks for a press, and lengths of tools that it does not know."""
    if rig.kind != "grbl" or air:
        return []
    unknown = demands.undeclared_lengths(rig, protocol)
    return [
        _check("contact", "refusals", demands.unmet(rig, protocol, sensor, unattended)),
        limits.Check(
            "tool lengths", True, "unknown", len(unknown), 0, "; ".join(unknown), bool(unknown)
        ),
    ]


def show(protocol_name: str, rig_name: str) -> tuple[list[Step], limits.Estimate]:
    """Steps and estimate of a protocol on a rig."""
    protocol, _ = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    camera = kind_of(rig, path).camera(protocol, load_design(protocol.specimen.design))
    stored = camera.lens if isinstance(camera, Rectified) else camera
    image_px = stored.width_px * stored.height_px if stored is not None else 0
    return plan.expand(protocol), limits.estimate(protocol, image_px, rig.stage.box)


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
    air: bool = False,
    *,
    realtime: bool = False,
    unattended: bool = False,
    tip_is_clear: bool = False,
) -> dict[str, Any]:
    """Check everything, run every step, return the summary.

    resume: continue the unfinished run in `out`, or start it when there is none; a finished one is
    verified (every hash) and left as it is, and its summary comes with "already_finished" true.
    The summary's times, notes and devices are those of the last session. air: nothing goes below
    the clearance plane, and no force is predicted. realtime: a virtual rig runs on the wall clock,
    in a process of its own behind real wires. unattended: nobody is asked anything, and what would
    need that is refused. tip_is_clear: the operator's word, where the position is lost. Raises
    InputError or RunFailed.
    """
    started = time.monotonic()
    protocol, source = plan.load(protocol_name)
    rig, rig_path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    if rig.kind == "grbl" and not air:
        refused = demands.unmet(rig, protocol, sensor, unattended)
        _require_none([f"{rig_path}: {line}" for line in refused])
    steps = plan.expand(protocol, air)
    limits.require(limits.check(protocol, sensor, rig.stage.box, steps), str(source))
    kind = kind_of(rig, rig_path, realtime, progress)
    _require_none(kind.refusals(protocol, sensor, str(source)))
    job = Job(
        protocol, sensor, load_recipe(protocol.specimen.pattern), seed, out, air,
        unattended=unattended, tip_is_clear=tip_is_clear,
    )  # fmt: skip
    text = source.read_bytes()
    meta = _meta(job, rig, rig_name, kind)
    if realtime:
        meta["realtime"] = True
    pattern = _pattern(job.recipe)
    resuming = out.exists() and resume
    if resuming:
        found = open_run(out)
        record.require_same(found, meta, text, pattern, with_versions=not found.finished)
        if found.finished:
            record.require_whole(found, progress)
            return {**found.summary(), "already_finished": True}
    else:
        _require_new(out, text)
    warnings = [] if air else _force_warnings(protocol, rig, str(rig_path), sensor, progress)
    if resuming:
        writer = RunWriter.resume(out, steps, progress)
    else:
        writer = RunWriter.create(out, meta, text, pattern, steps, kind.flat(protocol))
    try:
        with closing(kind.build(job)) as bench:
            devices = bench.devices()
            start_s = devices.clock.now_s()
            taken = Runner(devices, writer, progress).run(steps)
            frames = sum(step.frames for step in steps)
            summary = {
                "protocol": protocol.name,
                "rig": rig_name,
                "simulated": rig.simulated,
                "realtime": realtime,
                "air": air,
                "seed": seed,
                "steps": len(steps),
                "frames": frames,
                "sessions": writer.session,
                "kept_frames": frames - taken,
                "redone": writer.redone,
                "rig_seconds": devices.clock.now_s() - start_s,
                "wall_seconds": time.monotonic() - started,
                "left_out": bench.left_out(),
                "notes": [
                    *_air_note(air), *bench.notes(), *warnings,
                    *_resumed(writer.session, frames - taken),
                ],
                "devices": bench.identity(),
            }  # fmt: skip
        writer.close(summary)
    except BaseException:
        writer.abandon()
        raise
    return {**summary, "already_finished": False}


def _require_none(reasons: list[str]) -> None:
    if reasons:
        more = f"; and {len(reasons) - 1} more" if len(reasons) > 1 else ""
        raise InputError(reasons[0] + more)


def _air_note(air: bool) -> list[str]:
    if not air:
        return []
    return ["an air run: the clearance plane stood for every height below it; nothing was touched"]


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


def _meta(job: Job, rig: RigConfig, rig_name: str, kind: RigKind) -> dict[str, Any]:
    dumped = job.protocol.model_dump(mode="json")
    dumped["channels"] = sorted(dumped["channels"])
    camera = kind.camera(job.protocol, job.sensor)
    return {
        "name": job.folder.name,
        "protocol": dumped,
        "rig_name": rig_name,
        "rig": rig.recorded(),
        "sensor": asdict(job.sensor),
        "camera": camera.as_dict() if camera is not None else None,
        "simulated": rig.simulated,
        "air": job.air,
        "seed": job.seed,
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
