"""Module paths documented in 0.3: forwarded with a warning until 0.5."""

from __future__ import annotations

import warnings
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType

_TOP_NAME = __name__.partition(".")[0]
# Names of each old path and their new ones: a top-level name, or MODULE:NAME.
MOVED_NAMES: dict[str, dict[str, str]] = {
    "aliases": {"Vector": "common.aliases:Point"},
    "analysis.force": {
        "calibrate": "calibrate_force",
        "write_calibration": "write_force_calibration",
    },
    "analysis.shape": {"calibrate_depth": "calibrate_depth"},
    "analysis.tracking_error": {
        "analyse": "analyze_tracking",
        "TrackingResult": "estimate.analysis.tracking_error.result:TrackingResult",
    },
    "cad.assembly": {"assemble": "assemble_sensor", "bench": "assemble_bench"},
    "cad.build": {"build_part": "fabricate.cad.build:build_part"},
    "cad.design": {"load_design": "load_design"},
    "cad.export": {"export_parts": "export_parts"},
    "cad.feasibility": {"check": "check_design"},
    "cad.registry": {"find": "fabricate.cad.registry:find_part"},
    "elasticity": {"GelMaterial": "GelMaterial"},
    "errors": {name: name for name in ("InputError", "RunFailed", "SensorError")},
    "experiment": {"RunRequest": "RunRequest", "run": "run_protocol"},
    "gel.press": {"press": "press_gel"},
    "optics": {"StageFrame": "sensor.optics.camera:StageFrame"},
    "patterns": {"PatternRecipe": "PatternRecipe", "make": "make_pattern"},
    "patterns.quality.measure": {"measure": "measure_pattern"},
    "protocols.plan": {"load": "load_protocol"},
    "record": {"open": "load_run"},
    "rig.config": {
        "load": "bench.rig.config:load_rig",
        "GrblConfig": "bench.rig.config:GrblConfig",
    },
    "rig.interface": {"go": "bench.rig.interface:move_to"},
    "rig.tables": {"TouchConfig": "bench.rig.tables:TouchConfig"},
    "rig.tool.feeler": {"ForceProbe": "bench.rig.tool.feeler:ForceProbe"},
    "rig.tool.session": {"homed": "bench.rig.tool.session:home_stage"},
    "rig.tool.tooling": {
        "TerminalOperator": "bench.rig.tool.tooling:TerminalOperator",
        "confirm": "bench.rig.tool.tooling:confirm",
    },
    "rig.tool.touch": {
        "LOWERING": "bench.rig.tool.touch:LOWERING_RATIO",
        "MOST": "bench.rig.tool.touch:MAX_FORCE_RATIO",
        "STEP_MM": "bench.rig.tool.touch:TOUCH_STEP_MM",
    },
    "shapes": {
        "Indenter": "sensor.shapes.rigid:Indenter",
        "SkinDimensions": "sensor.shapes.sensor:SkinDimensions",
    },
    "shapes.indenter": {"parse": "parse_indenter"},
}


class MovedModule(Loader):
    """Loader of an old path, or a package above one, as a module that forwards its names."""

    def exec_module(self, module: ModuleType) -> None:
        """Warn once, then look up each name at its new location."""
        names = MOVED_NAMES.get(module.__name__.partition(".")[2])
        if names is None:  # package above an old path
            return
        public = [f"dt.{new}" for new in names.values() if ":" not in new]
        instead = f"`import {_TOP_NAME} as dt` has {', '.join(public) or 'nothing in its place'}"
        warnings.warn(f"{module.__name__} goes in 0.5: {instead}", FutureWarning, stacklevel=2)

        def load(name: str) -> object:
            if name not in names:
                raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
            home, _, attribute = names[name].rpartition(":")
            return getattr(import_module(f"{_TOP_NAME}.{home}" if home else _TOP_NAME), attribute)

        vars(module)["__getattr__"] = load


def spec_of(name: str) -> ModuleSpec | None:
    """Spec of a module at an old path; None for any other."""
    old = f"{name.partition('.')[2]}."
    if any(f"{path}.".startswith(old) for path in MOVED_NAMES):
        return ModuleSpec(name, MovedModule(), is_package=True)
    return None
