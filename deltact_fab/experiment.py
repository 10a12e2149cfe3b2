"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from . import __version__, preflight, record
from .cad.design import load_design
from .errors import InputError
from .patterns.dots import centres_mm
from .patterns.recipe import PatternRecipe, load_recipe
from .protocols import limits, plan
from .protocols.pace import LOCKSTEP, SIMULATED, WALL_CLOCK
from .protocols.plan import Protocol, Step
from .record import RunWriter
from .record import open as open_run
from .rig import config as rig_config
from .rig.config import RigConfig
from .rig.interface import Job, RigKind
from .rig.run import ask
from .rig.run.live import Live
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
    protocol_name: str,
    rig_name: str,
    air: bool = False,
    unattended: bool = False,
    out: Path = Path(),
) -> list[limits.Check]:
    """Static checks of a protocol on a rig; of forces those that take seconds to predict.

    out: a folder on the disk that the run will be written to.
    """
    protocol, source = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    kind = kind_of(rig, path)
    steps = plan.expand(protocol, air)
    rows = limits.check(protocol, sensor, rig.stage.box, steps)
    rows += preflight.needs(protocol, sensor, steps, rig, kind, out, not rig.simulated)
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


def show(
    protocol_name: str, rig_name: str, air: bool = False, realtime: bool = False
) -> tuple[list[Step], limits.Estimate]:
    """Steps and estimate of a protocol on a rig; realtime: a virtual one on the wall clock."""
    protocol, _ = plan.load(protocol_name)
    rig, path = rig_config.load(rig_name)
    image_px = preflight.image_px(
        protocol, load_design(protocol.specimen.design), rig, kind_of(rig, path)
    )
    steps = plan.expand(protocol, air)
    pace = (SIMULATED if realtime else LOCKSTEP) if rig.simulated else WALL_CLOCK
    return steps, limits.estimate(protocol, image_px, rig.stage.box, steps, pace)


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


@dataclass(frozen=True)
class _Asked:
    """A run as it was asked for, with everything checked that can be without a device."""

    job: Job
    source: Path
    rig: RigConfig
    rig_path: Path
    kind: RigKind
    steps: list[Step]
    realtime: bool

    def warnings(self, progress: Progress | None) -> list[str]:
        """What the predicted forces come to. Raises InputError where they are refused."""
        if self.job.air:
            return []
        job = self.job
        return _force_warnings(
            job.protocol, self.rig, str(self.rig_path), job.sensor, progress, self.realtime
        )


def _asked(
    protocol_name: str,
    rig_name: str,
    out: Path,
    seed: int,
    progress: Progress | None,
    air: bool,
    realtime: bool,
    unattended: bool,
    tip_is_clear: bool,
    disk: Path | None = None,
) -> _Asked:
    """disk: a folder on the disk that is judged, in place of out."""
    protocol, source = plan.load(protocol_name)
    rig, rig_path = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    if rig.kind == "grbl" and not air:
        refused = demands.unmet(rig, protocol, sensor, unattended)
        _require_none([f"{rig_path}: {line}" for line in refused])
    steps = plan.expand(protocol, air)
    kind = kind_of(rig, rig_path, realtime, progress)
    rows = limits.check(protocol, sensor, rig.stage.box, steps)
    rows += preflight.needs(
        protocol, sensor, steps, rig, kind, out if disk is None else disk,
        realtime or not rig.simulated,
    )  # fmt: skip
    limits.require(rows, str(source))
    _require_none(kind.refusals(protocol, sensor, str(source)))
    job = Job(
        protocol, sensor, load_recipe(protocol.specimen.pattern), seed, out, air,
        unattended=unattended, tip_is_clear=tip_is_clear,
    )  # fmt: skip
    return _Asked(job, source, rig, rig_path, kind, steps, realtime)


def dry_run(
    protocol_name: str,
    rig_name: str,
    progress: Progress | None = None,
    air: bool = False,
    *,
    realtime: bool = False,
    unattended: bool = False,
    out: Path | None = None,
) -> dict[str, Any]:
    """Check all that a run checks, and ask the devices of a rig that has any; nothing moves.

    Returns steps, frames, seconds and disk_mb of the estimate, devices (a line each, empty on a
    rig in lockstep) and notes. Raises InputError or RunFailed, as the run would.
    """
    with TemporaryDirectory() as folder:
        asked = _asked(
            protocol_name, rig_name, Path(folder) / "dry-run", 0, progress, air, realtime,
            unattended, False, out or Path(),
        )  # fmt: skip
        notes = [*_air_note(air), *asked.warnings(progress)]
        _, estimate = show(protocol_name, rig_name, air, realtime)
        lines: list[str] = []
        if realtime or not asked.rig.simulated:
            with closing(asked.kind.build(asked.job)) as bench:
                lines = ask.devices(bench.devices())
    return {**estimate.as_dict(), "devices": lines, "notes": notes}


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
    note: str | None = None,
    live: Callable[[Live], None] | None = None,
) -> dict[str, Any]:
    """Check everything, run every step, return the summary.

    resume: continue the unfinished run in `out`, or start it when there is none; a finished one is
    verified (every hash) and left as it is, and its summary comes with "already_finished" true.
    The summary's times, counts, notes and devices are those of the last session. air: nothing goes
    below the clearance plane, and no force is predicted. realtime: a virtual rig runs on the wall
    clock, in a process of its own behind real wires. unattended: nobody is asked anything, and what
    would need that is refused. tip_is_clear: the operator's word, where the position is lost. note:
    kept with the run. live: shown what goes on. Raises InputError or RunFailed.
    """
    started = time.monotonic()
    asked = _asked(
        protocol_name, rig_name, out, seed, progress, air, realtime, unattended, tip_is_clear
    )
    job, rig, steps, protocol = asked.job, asked.rig, asked.steps, asked.job.protocol
    text = asked.source.read_bytes()
    meta = _meta(job, rig, rig_name, asked.kind)
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
    warnings = asked.warnings(progress)
    if resuming:
        writer = RunWriter.resume(out, steps, progress)
    else:
        writer = RunWriter.create(out, meta, text, pattern, steps, asked.kind.flat(protocol))
    try:
        if note is not None:
            record.add_note(out, note)
        with closing(asked.kind.build(job)) as bench:
            devices = bench.devices()
            start_s = devices.clock.now_s()
            runner = Runner(devices, writer, progress, live)
            runner.run(steps)
            kept = sum(step.frames for step in steps if step.press in writer.kept)
            summary = {
                "protocol": protocol.name,
                "rig": rig_name,
                "simulated": rig.simulated,
                "realtime": realtime,
                "air": air,
                "seed": seed,
                "steps": len(steps),
                "frames": sum(step.frames for step in steps) - writer.missed,
                "missed_frames": writer.missed,
                "frame_counts": runner.counts(),
                "sessions": writer.session,
                "kept_frames": kept,
                "redone": writer.redone,
                "rig_seconds": devices.clock.now_s() - start_s,
                "wall_seconds": time.monotonic() - started,
                "left_out": bench.left_out(),
                "notes": [
                    *_air_note(air), *bench.notes(), *warnings,
                    *_resumed(writer.session, kept),
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
    realtime: bool,
) -> list[str]:
    """Predicted forces against the rig's limits: refused on a real rig, noted on the simulated."""
    limits = preflight.limits_of(rig, rig_source, protocol, realtime)
    peaks = preflight.predict(protocol, sensor, limits.origin_mm, progress)
    assert peaks is not None
    lines = preflight.judge(protocol.name, sensor.skin.thickness_mm, peaks, limits)
    found = preflight.require(lines, limits) + preflight.may_trip(protocol.name, peaks, limits)
    return [f"WARNING: {line}" for line in found]


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
