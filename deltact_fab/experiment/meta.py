"""What a record says of its run besides what was measured."""

from __future__ import annotations

import platform
from dataclasses import asdict
from typing import Any

from .. import __version__
from ..patterns.dots import centres_mm
from ..patterns.recipe import PatternRecipe
from .request import Asked


def meta_of(asked: Asked, rig_name: str) -> dict[str, Any]:
    """What `run.json` keeps: protocol, rig, sensor, camera, seed, versions."""
    job, rig = asked.job, asked.rig
    dumped = job.protocol.model_dump(mode="json")
    dumped["channels"] = sorted(dumped["channels"])
    camera = asked.kind.camera(job.protocol, job.sensor)
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


def pattern_of(recipe: PatternRecipe) -> dict[str, Any]:
    """Recipe and dot centres as data, so that analysis needs no maker of patterns."""
    dots = recipe.dots
    return {
        "recipe": recipe.model_dump(mode="json"),
        "dots_mm": centres_mm(dots).tolist() if dots is not None else [],
        "dot_diameter_mm": dots.diameter_mm if dots is not None else 0.0,
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
