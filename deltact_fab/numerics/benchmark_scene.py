"""The frames that the benchmark measures: a shipped press and shear through the fisheye.

They are runs of the virtual rig, kept in the user's cache folder, one a pattern. The gel is solved
once for both: its store finds the solution again.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import cache, catalog, digest
from ..aliases import Array, Progress
from ..analysis.tracking_error.truth import TrueFrame, seen_by
from ..record import Run

FRAMES = 300
JUDGED = 10  # every so many frames the flow is held against the truth
PROTOCOL, RIG = "deep-drag", "fisheye"
PATTERNS = {"0.15/0.1": (0.15, 0.1), "0.075/0.6": (0.075, 0.6)}
_RATE_HZ = 3.0  # enough frames of the shipped protocol
_KIND = "benchmark"
_DRAWN_BY = ("virtual.devices", "virtual.presses", "imaging", "patterns.raster")


@dataclass(frozen=True)
class BenchmarkScene:
    """One pattern's frames in memory, as a camera gives them, and what is true of them.

    run: the record. raw: FRAMES images (h, w, 3) uint8. truth: of every JUDGED-th frame, by its
    number.
    """

    run: Run
    raw: list[Array]
    truth: dict[int, TrueFrame]


def scene(pattern: str, progress: Progress | None = None) -> BenchmarkScene:
    """The frames of a pattern of PATTERNS, drawn if the cache folder has none.

    Raises as `experiment.run` and `record.open` do.
    """
    from .. import experiment, record

    home = cache.user_folder() / _KIND
    name = pattern.replace("/", "-")
    folder = home / f"{name}-{digest.of(*_DRAWN_BY)}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    for old in home.glob(f"{name}-*"):
        if old != folder and old.is_dir():
            shutil.rmtree(old, ignore_errors=True)
    protocol = _protocol(home, name, *PATTERNS[pattern])
    if not (folder.is_dir() and record.open(folder).finished):
        request = experiment.RunRequest(str(protocol), RIG, folder, seed=0, progress=progress)
        experiment.run(request, resume=True)
    run = record.open(folder)
    frames, truth = run.frames().iloc[:FRAMES], run.truth()
    assert truth is not None, "the virtual rig writes it"
    seen = seen_by(run.camera)
    whole = np.ones_like(seen)  # there are no dots
    judged = {
        k: TrueFrame.read(truth, frames["frame_id"][k], whole, seen, run.camera.mm_per_px)
        for k in range(JUDGED, len(frames), JUDGED)
    }
    return BenchmarkScene(run, [run.raw(file) for file in frames["file"]], judged)


def _protocol(home: Path, name: str, patch_mm: float, r: float) -> Path:
    """The shipped protocol, filmed faster, with force, on the pattern."""
    recipe = {"law": "algorithm1", "seed": 7, "size_mm": 35.0, "patch_mm": patch_mm, "r": r}
    pattern = home / f"pattern-{name}.toml"
    pattern.write_text(catalog.as_toml(recipe))
    plan = catalog.read(catalog.find("protocols", PROTOCOL))
    plan["channels"] = ["image", "force", "shear"]
    plan["capture"]["rate_hz"] = _RATE_HZ
    plan["specimen"]["pattern"] = str(pattern)
    path = home / f"{PROTOCOL}-{name}.toml"
    path.write_text(catalog.as_toml(plan))
    return path
