"""What the layers cost that a scene may leave out: CPU seconds, megabytes, modules.

CPU time, for what is measured once and kept must not depend on who else was at work. Each cost is
the difference of two fresh processes, with and without the layer, on one reference press
(sphere:10, 1 mm deep, 1 mm of shear). It is measured once a version and machine and kept in the
user's cache folder: a report quotes the figure, and never runs a stage to say what leaving it out
saved.
"""

from __future__ import annotations

import importlib
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .. import cache
from ..aliases import Progress
from .work_precision import peak_resident_mb
from .worker import answers

REPEATS = 3
KIND = "scene-costs"

# layer: (what it is, the process with it, the process without)
LAYERS = {
    "camera, picture, printer": ("draws every frame", "all", "no image"),
    "lens": ("draws raw frames through it, lays out their rectification", "all, lens", "all"),
    "force box": ("Net F/T box and its client", "all", "no force"),
    "friction": ("tangential contact, on a press without shear", "press", "press, no friction"),
    "finite-strain gel": ("the level 'hyperelastic', force only", "gel: force", "empty"),
    "its surface field": ("kept on a lattice of 0.1 mm for images", "gel: normal", "gel: force"),
    "its friction and shear": ("a drag, and the block without mirror", "gel: shear", "gel: normal"),
    "its viscosity": ("two branches of a Prony series", "gel: viscous", "gel: shear"),
    "cadquery": ("the CAD kernel's import", "cadquery", "empty"),
    "report libraries": ("imports of matplotlib, jinja2 and pandas", "report", "empty"),
}


def costs(measure: bool = False, progress: Progress | None = None) -> list[dict[str, Any]]:
    """One row a layer, from the cache; `measure` fills the cache where this machine has none.

    seconds (of the processor, one thread), megabytes and modules are None where the layer was not
    measured, and note says why. Raises RunFailed when a measuring process fails.
    """
    from ..experiment import versions

    # Everything that could change a cost: what the processes run, its libraries, the machine.
    key = cache.key("numerics.scenes", machine=machine(), versions=versions())
    held: list[dict[str, Any]] | None = cache.get(KIND, key)
    if held is None and measure:
        held = _measured(progress or (lambda done, total, what: None))
        cache.put(KIND, key, held)
    missing = "not measured on this machine; `deltact-fab numerics` does"
    return held or [_row(layer, missing) for layer in LAYERS]


def _measured(progress: Progress) -> list[dict[str, Any]]:
    here = [
        name for name, work in PROBES.items()
        if work.func is not _imports or all(find_spec(m.partition(".")[0]) for m in work.args)
    ]  # fmt: skip
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in here}
    for i in range(REPEATS):
        for j, name in enumerate(here):
            progress(i * len(here) + j, REPEATS * len(here), f"scene: {name}")
            runs[name] += answers(probe, name)
    # Whatever else is at work only ever adds.
    least = {name: {k: min(r[k] for r in rows) for k in rows[0]} for name, rows in runs.items()}
    rows = []
    for layer, (_, with_it, without) in LAYERS.items():
        if with_it not in least:
            rows.append(_row(layer, "is not installed here"))
            continue
        a, b = least[with_it], least[without]
        note = f"wall {a['wall_s']:.2f} s with, {b['wall_s']:.2f} s without; least of {REPEATS}"
        saved = [a[k] - b[k] for k in ("seconds", "megabytes", "modules")]
        rows.append(_row(layer, note, *saved))
    return rows


def _row(layer: str, note: str, *saved: float) -> dict[str, Any]:
    seconds, megabytes, modules = saved or (None, None, None)
    return {"layer": layer, "seconds": seconds, "megabytes": megabytes, "modules": modules,
            "about": LAYERS[layer][0], "note": note}  # fmt: skip


def probe(name: str) -> Iterator[dict[str, float]]:
    """Do one process's part, in that process: its cost from here on, its memory from its start."""
    start_s, start_cpu_s = time.perf_counter(), time.process_time()
    # What was solved before would be found; every process pays for its own.
    with tempfile.TemporaryDirectory() as folder:
        os.environ[cache.FOLDER_VARIABLE] = folder
        PROBES[name](folder=Path(folder))
    yield {
        "wall_s": time.perf_counter() - start_s,
        "seconds": time.process_time() - start_cpu_s,
        "megabytes": peak_resident_mb(),
        "modules": len(sys.modules),
    }


# -- what the processes do -------------------------------------------------------------------------


def _imports(*modules: str, folder: Path) -> None:
    for module in modules:
        importlib.import_module(module)


def _plan(channels: tuple[str, ...], sheared: bool, **more: Any) -> dict[str, Any]:
    """A protocol of the reference press."""
    plan = {"name": "reference", "indenters": ["sphere:10"], "positions_mm": [[0.0, 0.0]],
            "depths_mm": [1.0], "channels": list(channels), **more}  # fmt: skip
    return plan | ({"shear": {"amplitude_mm": 1.0, "axes": ["x"]}} if sheared else {})


def _run(*channels: str, folder: Path, sheared: bool = True, rig: str = "virtual") -> None:
    """The whole of it, on a rig."""
    from .. import catalog, experiment

    protocol = folder / "scene.toml"
    protocol.write_text(catalog.as_toml(_plan(channels, sheared, capture={"rate_hz": 0.5})))
    experiment.run(experiment.RunRequest(str(protocol), rig, folder / "run", seed=0))


def _knots(
    *channels: str, folder: Path, sheared: bool = False, prony: tuple[Any, ...] = ()
) -> None:
    """Every knot of it at finite strain, without stage and camera."""
    from ..protocols.plan import Protocol
    from ..rig.simulator import FiniteGelConfig, GelConfig
    from ..shapes import SkinDimensions
    from ..virtual.presses import Presses

    specimen = {"gel_model": "hyperelastic", "prony": prony}
    plan = _plan(channels, sheared, capture={"rate_hz": 1.0}, specimen=specimen)
    finite = FiniteGelConfig(cell_mm=1.5, lattice_mm=0.1, press_increment_mm=0.25)
    presses = Presses(
        Protocol.model_validate(plan), SkinDimensions(), GelConfig(hyperelastic=finite)
    )
    for path in presses.paths:
        presses.of(path).solver.solve_all()


_ALL, _SHEARED = ("image", "dots", "force", "shear"), ("image", "shear")
PROBES: dict[str, partial[None]] = {
    "all": partial(_run, *_ALL),
    "all, lens": partial(_run, *_ALL, rig="fisheye"),
    "no image": partial(_run, "force", "shear"),
    "no force": partial(_run, "image", "dots", "shear"),
    "press": partial(_run, "force", "shear", sheared=False),
    "press, no friction": partial(_run, "force", sheared=False),
    "gel: force": partial(_knots, "force"),
    "gel: normal": partial(_knots, "image"),
    "gel: shear": partial(_knots, *_SHEARED, sheared=True),
    # A strong series changes the number of iterations, either way, by more than it costs.
    "gel: viscous": partial(_knots, *_SHEARED, sheared=True, prony=((1e-9, 0.5), (1e-9, 5.0))),
    "empty": partial(_imports),
    "cadquery": partial(_imports, "cadquery"),
    "report": partial(_imports, "matplotlib.figure", "matplotlib.backends.backend_svg", "jinja2",
                      "pandas"),
}  # fmt: skip


def machine() -> dict[str, Any]:
    """What the times were measured on: processor, cores, system."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    return {"processor": model, "cores": os.cpu_count(), "system": platform.system()}
