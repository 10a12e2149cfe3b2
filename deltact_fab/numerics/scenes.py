"""What the layers cost that a scene may leave out: CPU seconds, megabytes, modules.

CPU time, for what is measured once and kept must not depend on who else was at work. Each cost is
the difference of two fresh processes, with and without the layer, on one reference press
(sphere:10, 1 mm deep, 1 mm of shear). It is measured once a version and machine and kept in the
user's cache folder: a report quotes the figure, and never runs a stage to say what leaving it out
saved.
"""

from __future__ import annotations

import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .. import cache
from .memory import peak_resident_mb
from .process import answers

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
    "confidence map": ("what of the flow is believed, 60 frames", "flow", "flow, not judged"),
    "cadquery": ("the CAD kernel's import", "cadquery", "empty"),
    "report libraries": ("imports of matplotlib, jinja2 and pandas", "report", "empty"),
}

_CHANNELS = {
    "all": ("image", "dots", "force", "shear"),
    "all, lens": ("image", "dots", "force", "shear"),
    "no image": ("force", "shear"),
    "no force": ("image", "dots", "shear"),
    "press": ("force", "shear"),
    "press, no friction": ("force",),
}
# The knots of one press, without stage and camera: (channels, shear, Prony series).
_GELS: dict[str, tuple[tuple[str, ...], bool, tuple[tuple[float, float], ...]]] = {
    "gel: force": (("force",), False, ()),
    "gel: normal": (("image",), False, ()),
    "gel: shear": (("image", "shear"), True, ()),
    # A strong series changes the number of iterations, either way, by more than it costs.
    "gel: viscous": (("image", "shear"), True, ((1e-9, 0.5), (1e-9, 5.0))),
}
_FLOWS = {"flow": True, "flow, not judged": False}
_FRAMES = 60
_IMPORTS = {
    "empty": (),
    "cadquery": ("cadquery",),
    "report": ("matplotlib.figure", "matplotlib.backends.backend_svg", "jinja2", "pandas"),
}


@dataclass(frozen=True)
class LayerCost:
    """What leaving a layer out saves; None where it was not measured, and note says why.

    seconds: of the processor, one thread.
    """

    layer: str
    seconds: float | None
    megabytes: float | None
    modules: int | None
    about: str
    note: str

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def costs(
    measure: bool = False, progress: Callable[[int, int, str], None] | None = None
) -> list[LayerCost]:
    """One row a layer, from the cache; `measure` fills the cache where this machine has none.

    Raises RunFailed when a measuring process fails.
    """
    key = _key()
    held = cache.get(KIND, key)
    if held is None and measure:
        held = _measured(progress or (lambda done, total, what: None))
        cache.put(KIND, key, held)
    if held is None:
        missing = "not measured on this machine; `deltact-fab numerics` does"
        rows = [
            LayerCost(name, None, None, None, about, missing)
            for name, (about, _, _) in LAYERS.items()
        ]
    else:
        rows = [LayerCost(**row) for row in held]
    return rows


def probe(name: str) -> dict[str, float]:
    """Run one process's part, in that process: its cost from the start of the process on."""
    import importlib

    start_s, start_cpu_s = time.perf_counter(), time.process_time()
    if name in _IMPORTS:
        for module in _IMPORTS[name]:
            importlib.import_module(module)
    else:
        # What was solved before would be found; every process pays for its own.
        with tempfile.TemporaryDirectory() as folder:
            os.environ[cache.FOLDER_VARIABLE] = folder
            if name in _GELS:
                _knots(name)
            elif name in _FLOWS:
                _follow(_FLOWS[name])
            else:
                _press(name)
    return {
        "wall_s": time.perf_counter() - start_s,
        "seconds": time.process_time() - start_cpu_s,
        "megabytes": peak_resident_mb(),
        "modules": len(sys.modules),
    }


def _press(name: str) -> None:
    from .. import experiment

    lines = [
        'name = "reference-scene"',
        'indenters = ["sphere:10"]',
        "positions_mm = [[0.0, 0.0]]",
        "depths_mm = [1.0]",
        f"channels = {list(_CHANNELS[name])}",
    ]
    if not name.startswith("press"):
        lines += ["[shear]", "amplitude_mm = 1.0", 'axes = ["x"]']
    lines += ["[capture]", "rate_hz = 0.5"]
    with tempfile.TemporaryDirectory() as folder:
        protocol = Path(folder) / "scene.toml"
        protocol.write_text("\n".join(lines) + "\n")
        rig = "fisheye" if name.endswith("lens") else "virtual"
        experiment.run(experiment.RunRequest(str(protocol), rig, Path(folder) / "run", seed=0))


def _knots(name: str) -> None:
    """Every knot of one press (sphere:10, 1 mm deep, 1 mm of shear) at finite strain."""
    from ..protocols.plan import Protocol
    from ..rig.simulator import FiniteGelConfig, GelConfig
    from ..shapes import SkinDimensions
    from ..virtual.presses import Presses

    channels, shear, prony = _GELS[name]
    protocol = Protocol.model_validate(
        {
            "name": "reference-gel",
            "indenters": ["sphere:10"],
            "positions_mm": [[0.0, 0.0]],
            "depths_mm": [1.0],
            "channels": list(channels),
            "shear": {"amplitude_mm": 1.0, "axes": ["x"]} if shear else None,
            "capture": {"rate_hz": 1.0},
            "specimen": {"gel_model": "hyperelastic", "prony": prony},
        }
    )
    finite = FiniteGelConfig(cell_mm=1.5, lattice_mm=0.1, press_increment_mm=0.25)
    gel = GelConfig(hyperelastic=finite)
    presses = Presses(protocol, SkinDimensions(), gel)
    for path in presses.paths:
        presses.of(path).solver.solve_all()


def _follow(confidence: bool) -> None:
    """A tracker on a texture of the sensor's size that moves a pixel a frame."""
    import cv2
    import numpy as np

    from ..measure.flow import FlowTracker
    from ..shapes import SensorDimensions

    cv2.setNumThreads(1)
    o = SensorDimensions().optics
    noise = np.random.default_rng(0).normal(128, 400, (o.image_height_px, o.image_width_px, 3))
    image = np.clip(cv2.GaussianBlur(noise, (0, 0), 2.0), 0, 255).astype(np.uint8)
    tracker = FlowTracker(confidence=confidence)
    for shift in range(_FRAMES):
        tracker.update(np.roll(image, shift, axis=1))


def _packages(name: str) -> set[str]:
    return {module.partition(".")[0] for module in _IMPORTS[name]}


def _measured(progress: Callable[[int, int, str], None]) -> list[dict[str, Any]]:
    here = [name for name in _IMPORTS if all(map(find_spec, _packages(name)))]
    names = [*_CHANNELS, *_GELS, *_FLOWS, *here]
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    for i in range(REPEATS):
        for j, name in enumerate(names):
            progress(i * len(names) + j, REPEATS * len(names), f"scene: {name}")
            job = {"kind": "scene", "probe": name, "threads": 1}
            runs[name] += list(answers(job))
    # Whatever else is at work only ever adds.
    found = {name: {k: min(r[k] for r in rows) for k in rows[0]} for name, rows in runs.items()}
    rows = []
    for layer, (about, with_it, without) in LAYERS.items():
        if with_it not in found:
            absent = LayerCost(layer, None, None, None, about, "is not installed here")
            rows.append(absent.as_dict())
            continue
        a, b = found[with_it], found[without]
        cost = LayerCost(
            layer,
            a["seconds"] - b["seconds"],
            a["megabytes"] - b["megabytes"],
            int(a["modules"] - b["modules"]),
            about,
            f"wall {a['wall_s']:.2f} s with, {b['wall_s']:.2f} s without; least of {REPEATS}",
        )
        rows.append(cost.as_dict())
    return rows


def _key() -> dict[str, Any]:
    """Everything that could change a cost: what the processes run, its libraries, the machine."""
    from ..experiment import versions

    return cache.key("numerics.scenes", machine=machine(), versions=versions())


def machine() -> dict[str, Any]:
    """What the times were measured on: processor, cores, system."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    return {"processor": model, "cores": os.cpu_count(), "system": platform.system()}
