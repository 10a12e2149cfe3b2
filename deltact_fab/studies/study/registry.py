"""Registry of studies as plain data, and their request; a study's module is imported to run it."""

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
    """A study. line: for `study list`. about: paragraphs of its `--help`.

    takes: its common options, of "scale", "seed", "rig", "from", and "grid" for --jobs and --on.
    scale: default scale, shown in the help; None without one. options: click options of this study
    only, by flag; a request has their values in `options`.
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
        "Default: all of the paper's 2070 settled points (protocol force-calibration) on a gel at "
        "finite strain: half an hour on two idle cores, six minutes with --scale 0.1. A smaller "
        "scale uses fewer depths and positions, with all indenters, at least two positions and "
        "the full range of depth and shear.\n\n"
        "--from uses the points of recorded runs instead, from any bench.",
        options={"--protocol": {"help": "Another protocol with images, forces and settled stops."}},
    ),
    "pattern-selection": Study(
        "pattern_selection",
        "The paper's 17 patterns under 5 indenters.",
        "Tracks with the published tracker and compares errors at the dots over realisations of "
        "pattern, print and noise, until each question is decided or the CPU time is used up; the "
        "same command goes on from there. The gel is solved once and stored. Sides of recorded "
        "runs: `analyze compare`.",
        takes=("seed", "rig", "grid"),
        options={
            "--protocol": {"help": "Press the whole of this protocol, a name or a path.",
                           "show_default": "pattern-selection at one position, short drags"},
            "--pattern": {"help": "Only this pattern of the series, as d0p1-r0p5; repeatable.",
                          "multiple": True},
            "--indenter": {"help": "Only this indenter of the protocol; repeatable.",
                           "multiple": True},
            "--cpu-minutes": {"help": "CPU time of new jobs at most, without the gel.",
                              "default": 120.0},
        },
    ),
    "shapes": Study(
        "shapes",
        "Sphere, cylinder, ring, toy hat: depth against truth; force fields.",
        "Four objects (protocols shapes, shapes-hat), the depth and force calibrations that they "
        "need (ball-press, and one ball of force-calibration-small), and a press of twist: "
        "five minutes on two idle cores. A smaller scale presses each object at fewer than three "
        "positions, with all objects and depths. `analyze shape` analyses a recorded run likewise.",
        takes=("scale", "seed", "rig", "grid"),
    ),
    "pattern-search": Study(
        "pattern_search",
        "The best pattern for a printer and a camera.",
        about="Candidates are rendered with the printer and the camera of a virtual rig (tables "
        "[virtual.printer] and [virtual.camera]) and ranked by tracking error on a known drag; the "
        "best few are then tracked on the finite-strain gel, with the paper's pattern. A smaller "
        "scale uses fewer candidates and seeds, and a shorter drag.",
        takes=("scale", "seed", "rig", "grid"),
        scale=1.0,
        options={
            "--dpi": {"help": "Resolution of the printer, dots per inch.", "type": int},
            "--mm-per-px": {"help": "Size of a camera pixel on the face, mm.", "type": float},
        },
    ),
    "settling": Study(
        "settling",
        "Waiting time at a stop until the force is steady.",
        about="Fits the gel's relaxation to the rests of a run of the protocol `settling`. Record "
        "it on your bench or a virtual rig, and give it with --from.",
        takes=("from",),
    ),
}  # fmt: skip


def find_study(name: str) -> Study:
    """Look up a study by name. Raises InputError for an unknown one."""
    if name not in STUDIES:
        raise InputError(f"no study {name!r}; {did_you_mean(name, STUDIES)}")
    return STUDIES[name]


def run_study(name: str, request: StudyRequest) -> StudyResult:
    """Run a study. Raises InputError for an unknown one or bad options, RunFailed.

    Jobs without a result are listed in the result's `missing`.
    """
    module = f"studies.study.{find_study(name).module}"
    result: StudyResult = importlib.import_module(f"deltact_fab.{module}").run(request)
    missing = tuple(job for grid in request.grids for job in grid.missing)
    # The last grid repeats what the intervals are over.
    cpu_s = request.grids[-1].cpu_s if request.grids else 0.0
    heads = tuple(
        replace(head, whole=not missing, unit_cpu_s=cpu_s / max(head.groups, 1))
        for head in result.headlines
    )
    return replace(result, missing=missing, headlines=heads, module=module)


@dataclass(frozen=True)
class StudyRequest:
    """Options of a study run.

    scale: share of the paper's points or frames, in (0, 1]; None: the study's default. rig: name or
    path of a virtual rig; None: the study's default. runs: recorded runs to use instead of
    simulating. executor: None for local processes. say: prints a line on stderr. options: all
    options that the registry declares for this study. grids: grids solved so far.
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
        """Solve a grid of jobs; its missing jobs go into the result."""
        from .grid import solve

        grid = solve(jobs, self.executor, self.progress, self.say)
        self.grids.append(grid)
        return grid


def parse_scale(scale: float | None) -> float:
    """Return the scale, 1 for None. Raises InputError outside of (0, 1]."""
    share = 1.0 if scale is None else scale
    if not 0 < share <= 1:
        raise InputError(f"--scale: {share:g}; expected above 0 and at most 1")
    return share


def load_virtual_rig(name: str) -> tuple[VirtualConfig, Path]:
    """Load a virtual rig by name or path, and its file. Raises InputError for a real one."""
    from deltact_fab.bench import VirtualConfig, load_rig

    rig, source = load_rig(name)
    if not isinstance(rig, VirtualConfig):
        raise InputError(
            f"{source}: kind: {rig.kind!r}; expected a 'virtual' rig; runs of a real one go to a "
            "study with --from"
        )
    return rig, source


def modulus_remark(modulus_mpa: float, extra: str = "") -> str:
    """Note on the uncertainty of the gel's modulus and its effects.

    Stresses of the simulated gel are proportional to it at the same deformation (`physics.gel.path`
    solves for 1 MPa). extra: further effects, for a study with quantities fixed in newtons.
    """
    from deltact_fab.simulate import MODULUS_FACTOR

    return (
        f"The gel's modulus, {modulus_mpa:g} MPa, is known to a factor of {MODULUS_FACTOR:g} "
        "(Gent's relation from Shore 15A). It does not affect deformation at a given depth, nor "
        "images, flow, tracking errors, depth, contact, relaxation times and relative forces. "
        f"Forces and tractions, and their errors in N and kPa, are proportional to it.{extra}"
    )
