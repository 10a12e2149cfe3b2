"""Where protocol, sensor and rig meet: checks before motion, then the run and its record."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import __version__
from .cad.design import load_design
from .errors import RunFailed
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
    """Static checks of a protocol on a rig."""
    protocol, _ = plan.load(protocol_name)
    rig, _ = rig_config.load(rig_name)
    return limits.check(protocol, load_design(protocol.specimen.design), rig.stage.box)


def show(protocol_name: str, rig_name: str) -> tuple[list[Step], limits.Estimate]:
    """Steps and estimate of a protocol on a rig."""
    protocol, _ = plan.load(protocol_name)
    rig, _ = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    return plan.expand(protocol), limits.estimate(protocol, sensor, rig.stage.box)


def run(
    protocol_name: str,
    rig_name: str,
    out: Path,
    seed: int = 0,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Check everything, run every step, return the summary. Raises InputError or RunFailed."""
    started = time.monotonic()
    protocol, source = plan.load(protocol_name)
    rig, _ = rig_config.load(rig_name)
    sensor = load_design(protocol.specimen.design)
    recipe = load_recipe(protocol.specimen.pattern)
    steps = plan.expand(protocol)
    limits.require(limits.check(protocol, sensor, rig.stage.box, steps), str(source))

    from .virtual.rig import VirtualRig, identity, require_gel_level

    require_gel_level(protocol, sensor, str(source))
    writer = RunWriter(
        out,
        _meta(protocol, rig, rig_name, sensor, seed, out.name),
        source.read_bytes(),
        _pattern(recipe),
    )
    try:
        bench = VirtualRig(rig, protocol, sensor, recipe, seed, out)
        frames = Runner(bench.devices(), writer, progress).run(steps)
        by_press: dict[str, list[str]] = {}
        for row in open_run(out).frames().itertuples():
            by_press.setdefault(str(row.press), []).append(str(row.frame_id))
        bench.finish(by_press)
        summary = {
            "protocol": protocol.name,
            "rig": rig_name,
            "simulated": rig.kind == "virtual",
            "seed": seed,
            "steps": len(steps),
            "frames": frames,
            "rig_seconds": bench.clock.now_s(),
            "wall_seconds": time.monotonic() - started,
            "left_out": bench.left_out(),
            "notes": bench.notes(),
            "devices": identity(bench),
        }
        writer.close(summary)
    except BaseException:
        writer.close()
        raise
    return summary


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


__all__ = ["RunFailed", "checks", "run", "show", "versions"]
