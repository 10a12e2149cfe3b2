"""The studies by name, as plain data, and what one is asked; a study's module is imported only when
it is run.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltact_fab.common import InputError, did_you_mean

if TYPE_CHECKING:
    from deltact_fab.bench import VirtualConfig
    from deltact_fab.common import Progress
    from deltact_fab.present import StudyResult

    from .grid import Grid, GridJob


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


def find_study(name: str) -> Study:
    """A study by its name. Raises InputError for an unknown one."""
    if name not in STUDIES:
        raise InputError(f"{name}: no such study; {did_you_mean(name, STUDIES)}")
    return STUDIES[name]


def run_study(name: str, request: StudyRequest) -> StudyResult:
    """Run a study. Raises InputError for an unknown one or bad options, RunFailed.

    Jobs that were asked for and have no result stand in the result's `missing`.
    """
    module = f"studies.study.{find_study(name).module}"
    result: StudyResult = importlib.import_module(f"deltact_fab.{module}").run(request)
    missing = tuple(job for grid in request.grids for job in grid.missing)
    heads = tuple(replace(head, whole=not missing) for head in result.headlines)
    return replace(result, missing=missing, headlines=heads, module=module)


@dataclass(frozen=True)
class StudyRequest:
    """The options of a study that is to be run.

    scale: share of the paper's points or frames, in (0, 1]; None: the study's default. rig: a
    virtual rig's name or path; None: the study's own. runs: recorded runs to take instead of
    simulating. executor: None is local processes. say: one line for the user, on stderr.
    more: options of one study only, every one that the registry declares. grids: those solved.
    """

    scale: float | None = None
    seed: int = 0
    rig: str | None = None
    runs: tuple[Path, ...] = ()
    executor: Executor | None = None
    progress: Progress | None = None
    say: Callable[[str], None] = lambda text: None
    options: dict[str, Any] = field(default_factory=dict)
    grids: list[Grid] = field(default_factory=list, compare=False, repr=False)

    def solve(self, jobs: Sequence[GridJob]) -> Grid:
        """A grid of jobs on what was asked for; what is missing in it gets into the result."""
        from .grid import solve

        grid = solve(jobs, self.executor, self.progress, self.say)
        self.grids.append(grid)
        return grid


def parse_scale(scale: float | None) -> float:
    """A scale as a number, 1 for None. Raises InputError outside of (0, 1]."""
    share = 1.0 if scale is None else scale
    if not 0 < share <= 1:
        raise InputError(f"--scale: {share:g}; expected above 0 and at most 1")
    return share


def load_virtual_rig(name: str) -> tuple[VirtualConfig, Path]:
    """A virtual rig by name or path, and its file. Raises InputError for a real one."""
    from deltact_fab.bench import VirtualConfig, load_rig

    rig, source = load_rig(name)
    if not isinstance(rig, VirtualConfig):
        raise InputError(
            f"{source}: kind: {rig.kind!r}; a study simulates on a 'virtual' rig: name a virtual "
            "rig, or give what a real one recorded to a study that takes --from"
        )
    return rig, source


def modulus_remark(modulus_mpa: float, extra: str = "") -> str:
    """For a study's notes: how well the gel's modulus is known, and what that changes.

    Stresses of the simulated gel are in proportion to it at one and the same deformation (so is
    every force that is solved here: `physics.gel.path` solves for 1 MPa). also: what else depends
    on it, of a study in which what is fixed in newtons meets forces at another place.
    """
    from deltact_fab.simulate import MODULUS_FACTOR

    return (
        f"The gel's modulus, {modulus_mpa:g} MPa, is known to a factor of {MODULUS_FACTOR:g} "
        "(Gent's relation from Shore 15A). Deformation at a given depth does not depend on it, nor "
        "does what follows from deformation alone: images, flow, tracking errors, depth, contact, "
        "how fast a force fades, shares of a force. Forces and tractions, and their errors in N "
        f"and kPa, are in proportion to it.{extra}"
    )
