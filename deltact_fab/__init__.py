"""Fabrication and experiment-design toolchain for the DelTact tactile sensor.

`import deltact_fab as dt` is enough for most scripts; a name is loaded when it is first used:

- `load_design`: Read the dimensions of a sensor.
- `check_design`: Refuse dimensions that break a rule.
- `build_part`: Build one part as a solid.
- `assemble_sensor`: Build all parts, each in its place.
- `assemble_bench`: Build the sensor on its test bench.
- `export_parts`: Write parts as STEP, STL and so on.
- `PatternRecipe`: Recipe of a pattern, as a value.
- `make_pattern`: Write a pattern as the printer's PNG.
- `measure_pattern`: Rate a pattern for tracking.
- `parse_indenter`: Read an indenter such as sphere:10.
- `GelMaterial`: Stiffness and friction of the gel.
- `press_gel`: Press an indenter into the simulated gel.
- `load_protocol`: Read a protocol and its path.
- `RunRequest`: A protocol on a rig, to be run.
- `run_protocol`: Check a request, run it and record it.
- `open_probe`: Touch with the tip of a real rig.
- `load_run`: Open a recorded run for reading.
- `track`: Track the pattern through images.
- `measure_source`: Measure images, one by one.
- `Live`: Measure images of your own, live.
- `analyze_tracking`: Tracking error of a run.
- `calibrate_force`: Calibrate force on runs.
- `write_force_calibration`: Write a force calibration to a file.
- `calibrate_depth`: Calibrate depth on the run of a ball.
- `InputError`: A value of yours that cannot be used.
- `RunFailed`: Work that began and could not end.
- `SensorError`: A camera or force sensor that failed.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from .door import open_door
from .version import VERSION as __version__

if TYPE_CHECKING:
    from .analysis.force import write_calibration as write_force_calibration
    from .analysis.force.calibrate import calibrate as calibrate_force
    from .analysis.shape import calibrate_depth
    from .analysis.tracking_error import analyse as analyze_tracking
    from .cad.assembly import assemble as assemble_sensor
    from .cad.assembly import bench as assemble_bench
    from .cad.build import build_named as build_part
    from .cad.design import load_design
    from .cad.export import export_parts
    from .cad.feasibility import check as check_design
    from .elasticity import GelMaterial
    from .errors import InputError, RunFailed, SensorError
    from .experiment import RunRequest
    from .experiment import run as run_protocol
    from .gel.press import press as press_gel
    from .live.session import LiveMeasurement as Live
    from .live.session import measure_source, track
    from .patterns import PatternRecipe
    from .patterns import make as make_pattern
    from .patterns.quality.measure import measure as measure_pattern
    from .protocols.plan import load as load_protocol
    from .record import open as load_run
    from .rig.tool.session import open_probe
    from .shapes.indenter import parse as parse_indenter
else:
    __getattr__, __dir__ = open_door(__name__)

    class _OldPaths:
        """Finder of modules that moved; it is asked last."""

        @staticmethod
        def find_spec(name: str, *_: object) -> object:
            if name.startswith(f"{__name__}."):
                from .moved import spec_of

                return spec_of(name)
            return None

    sys.meta_path.append(_OldPaths)

__all__ = [  # noqa: RUF022
    "__version__", "load_design", "check_design", "build_part", "assemble_sensor",
    "assemble_bench", "export_parts", "PatternRecipe", "make_pattern", "measure_pattern",
    "parse_indenter", "GelMaterial", "press_gel", "load_protocol", "RunRequest", "run_protocol",
    "open_probe", "load_run", "track", "measure_source", "Live", "analyze_tracking",
    "calibrate_force", "write_force_calibration", "calibrate_depth", "InputError", "RunFailed",
    "SensorError",
]  # fmt: skip
