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

from deltact_fab.door import open_door
from deltact_fab.version import PACKAGE_VERSION as __version__

if TYPE_CHECKING:
    from deltact_fab.bench import load_protocol, open_probe
    from deltact_fab.bench import open_run as load_run
    from deltact_fab.common import InputError, RunFailed, SensorError
    from deltact_fab.estimate import analyse_tracking as analyze_tracking
    from deltact_fab.estimate import calibrate_depth, calibrate_force, write_force_calibration
    from deltact_fab.fabricate import (
        PatternRecipe,
        assemble_bench,
        assemble_sensor,
        export_parts,
        load_design,
        make_pattern,
    )
    from deltact_fab.fabricate import build_named_part as build_part
    from deltact_fab.fabricate import check_feasible as check_design
    from deltact_fab.fabricate import measure_quality as measure_pattern
    from deltact_fab.physics import press_gel
    from deltact_fab.present import LiveMeasurement as Live
    from deltact_fab.present import measure_source
    from deltact_fab.present import track_images as track
    from deltact_fab.sensor import GelMaterial, parse_indenter
    from deltact_fab.simulate import RunRequest
    from deltact_fab.simulate import run_experiment as run_protocol
else:
    __getattr__, __dir__ = open_door(__name__)

    class _OldPaths:
        """Finder of modules that moved; asked first, as an earlier version may leave folders."""

        tops = frozenset(
            [
                "aliases",
                "analysis",
                "cad",
                "elasticity",
                "errors",
                "experiment",
                "gel",
                "optics",
                "patterns",
                "protocols",
                "record",
                "rig",
                "shapes",
            ]
        )

        @classmethod
        def find_spec(cls, name: str, *_: object) -> object:
            top, _, rest = name.partition(".")
            if top == __name__ and rest.partition(".")[0] in cls.tops:
                from deltact_fab.moved import spec_of

                return spec_of(name)
            return None

    sys.meta_path.insert(0, _OldPaths)

__all__ = [  # noqa: RUF022
    "__version__", "load_design", "check_design", "build_part", "assemble_sensor",
    "assemble_bench", "export_parts", "PatternRecipe", "make_pattern", "measure_pattern",
    "parse_indenter", "GelMaterial", "press_gel", "load_protocol", "RunRequest", "run_protocol",
    "open_probe", "load_run", "track", "measure_source", "Live", "analyze_tracking",
    "calibrate_force", "write_force_calibration", "calibrate_depth", "InputError", "RunFailed",
    "SensorError",
]  # fmt: skip
