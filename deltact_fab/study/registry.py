"""The studies by name, as plain data; a study's module is imported only when it is run."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from ..errors import InputError, did_you_mean

if TYPE_CHECKING:
    from ..report.result import StudyResult
    from .request import StudyRequest


@dataclass(frozen=True)
class Study:
    """A study. line: what `study list` says. about: paragraphs of its `--help`.

    takes: which of the common options it has: "scale", "seed", "rig", "from", and "grid" for --jobs
    and --on. scale: its default scale, shown in the help; None where it takes none. options: of
    this study only, as click takes them, by flag; a request has their values in `more`.
    """

    module: str
    line: str
    about: str = ""
    takes: tuple[str, ...] = ("scale", "seed", "rig", "from", "grid")
    scale: float | None = None
    options: dict[str, dict[str, Any]] = field(default_factory=dict)


STUDIES = {
    "force-calibration": Study(
        "force_calibration",
        "The paper's force table: 5 balls, 2070 points.",
        "The default is all of the paper's 2070 settled points (protocol "
        "force-calibration) on a gel at finite strain: half an hour on two idle cores, six minutes "
        "with --scale 0.1. A smaller scale takes fewer depths and places; all indenters stay, and "
        "so do at least two places and the range of depth and shear.\n\n"
        "With --from the points are those of recorded runs, of any bench.",
        options={"--protocol": {"help": "Another protocol with images, forces and settled stops."}},
    ),
    "pattern-selection": Study(
        "pattern_selection",
        "The paper's 17 patterns under 5 indenters.",
        "By the paper's own tracker and by ours, at the dots and away from them. --scale 1 is the "
        "paper's 3600 frames per indenter and pattern, a day on two cores. A smaller scale films "
        "fewer positions and shorter drags, with the same step between frames. The gel is solved "
        "once and kept. With --from, each run is one tactile base.",
        scale=0.04,
        options={
            "--protocol": {"help": "Protocol to press: a name or a path.",
                           "default": "pattern-selection"},
            "--pattern": {"help": "Only this pattern of the series, as d0p1-r0p5; repeatable.",
                          "multiple": True},
            "--indenter": {"help": "Only this indenter of the protocol; repeatable.",
                           "multiple": True},
        },
    ),
    "shapes": Study(
        "shapes",
        "Sphere, cylinder, ring, toy hat: depth against truth; force fields.",
        "Four objects (protocols shapes, shapes-hat), the calibrations of depth and force that "
        "they need (ball-press, and one ball of force-calibration-small), and a press of twist: "
        "five minutes on two idle cores. A smaller scale presses each object at fewer than three "
        "places; all objects and depths stay. `analyze shape` does the same with a recorded run.",
        takes=("scale", "seed", "rig", "grid"),
    ),
    "pattern-search": Study(
        "pattern_search",
        "The best pattern for a printer and a camera.",
        about="Candidates go through the printer and the camera of a virtual rig (its tables "
        "[virtual.printer] and [virtual.camera]) and are ranked by "
        "their tracking error on a known drag; the best few are then tracked on the finite-strain "
        "gel next to the paper's pattern. A smaller scale takes fewer candidates and seeds, and a "
        "shorter drag.",
        takes=("scale", "seed", "rig", "grid"),
        scale=1.0,
        options={
            "--dpi": {"help": "Resolution of the printer, dots per inch.", "type": int},
            "--mm-per-px": {"help": "Size of a camera pixel on the face, mm.", "type": float},
        },
    ),
    "settling": Study(
        "settling",
        "How long to wait at a stop before the force is steady.",
        about="Record the protocol `settling`, on your bench or a virtual rig, and name the run "
        "with --from: the gel's relaxation is fitted to its rests.",
        takes=("from",),
    ),
}  # fmt: skip


def find(name: str) -> Study:
    """A study by its name. Raises InputError for an unknown one."""
    if name not in STUDIES:
        raise InputError(f"{name}: no such study; {did_you_mean(name, STUDIES)}")
    return STUDIES[name]


def run(name: str, asked: StudyRequest) -> StudyResult:
    """Run a study. Raises InputError for an unknown one or bad options, RunFailed.

    Jobs that were asked for and have no result stand in the result's `missing`.
    """
    module = f"study.{find(name).module}"
    result: StudyResult = importlib.import_module(f"deltact_fab.{module}").run(asked)
    missing = tuple(job for grid in asked.grids for job in grid.missing)
    heads = tuple(replace(one, whole=not missing) for one in result.headlines)
    return replace(result, missing=missing, headlines=heads, module=module)
