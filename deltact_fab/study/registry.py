"""The studies by name, as plain data; a study's module is imported only when it is run."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ..errors import InputError, did_you_mean

if TYPE_CHECKING:
    from ..report.result import StudyResult
    from .request import Asked


@dataclass(frozen=True)
class Option:
    """An option of one study only: `--name VALUE` of its command, `Asked.more["name"]` in it.

    name: with hyphens; in `more` with underscores. default: its type is the option's (True and
    False: a switch; a tuple: may be given several times, a tuple of words arrives). None: no
    default, and kind says the type. low, high: limits, both allowed. choices: what is valid.
    """

    name: str
    help: str
    default: Any = None
    kind: type = str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Study:
    """A study. line: what `study list` says. about: paragraphs of its `--help`.

    takes: which of the common options it has: "scale", "seed", "rig", "from", and "grid" for --jobs
    and --on. scale: its default scale, shown in the help; None where it takes none.
    """

    module: str
    line: str
    about: str = ""
    takes: tuple[str, ...] = ("scale", "seed", "rig", "from", "grid")
    scale: float | None = None
    options: tuple[Option, ...] = ()


STUDIES = {
    "force-calibration": Study(
        "force_calibration",
        "The paper's force table: 5 balls, 2070 points.",
        "The whole, and the default, is the paper's 2070 settled points (protocol "
        "force-calibration) on a gel at finite strain: half an hour on two idle cores, six minutes "
        "with --scale 0.1. The scale thins depths and places; all indenters stay, two places at "
        "least, and the range of depth and shear.\n\n"
        "With --from the points are those of recorded runs, of any bench.",
        options=(
            Option("protocol", "Another protocol that has images, forces and settled stops."),
        ),
    ),
    "pattern-selection": Study(
        "pattern_selection",
        "The paper's 17 patterns under 5 indenters.",
        "By the paper's own tracker and by ours, at the dots and off them. --scale 1 is the "
        "paper's 3600 frames an indenter and pattern: a day on two cores. Below, fewer positions "
        "and shorter drags are filmed, with the same step between frames. The gel is solved once "
        "and kept. With --from, each run is one tactile base.",
        scale=0.04,
        options=(
            Option("protocol", "What is pressed, by name or path.", "pattern-selection"),
            Option("pattern", "One of the series, as d0p1-r0p5; may be given several times.", ()),
            Option("indenter", "One of the protocol's; may be given several times.", ()),
        ),
    ),
    "shapes": Study(
        "shapes",
        "Sphere, cylinder, ring, toy hat: depth against truth; force fields.",
        "Four objects (protocols shapes, shapes-hat), the calibrations of depth and force that "
        "they need (ball-press, and one ball of force-calibration-small), and a press of twist: "
        "five minutes on two idle cores. The scale thins the places at which an object is "
        "pressed, three of them, to one at least; all objects and depths stay.\n\n"
        "With --from the presses are those of recorded runs, of any bench and any indenters.",
        options=(
            Option("depth", "With --from: the calibration of depth, by `calibrate-depth`."),
            Option("force", "With --from: the calibration of force, by `analyze force`."),
        ),
    ),
    "comparison": Study(
        "comparison",
        "The paper's table of sensors, with your designs as rows.",
        takes=(),
        options=(Option("design", "A sensor's TOML, as a row; may be given several times.", ()),),
    ),
    "pattern-search": Study(
        "pattern_search",
        "The best pattern for a printer and a camera.",
        about="Candidates are printed and photographed by the models of a virtual rig's printer "
        "and camera, what predicts their tracking error is ranked, and the best few are followed "
        "on the finite-strain gel beside the paper's pattern. The scale thins candidates, seeds "
        "and drag.",
        takes=("scale", "seed", "rig", "grid"),
        scale=1.0,
        options=(
            Option("dpi", "Of the printer.", kind=int),
            Option("levels", "Grey levels of a printed dot and ink.", kind=int),
            Option("spread-um", "How far ink runs, um.", kind=float),
            Option("misregistration-um", "How far an ink is misplaced, um.", kind=float),
            Option("mm-per-px", "Of the face, a pixel of the camera, mm.", kind=float),
            Option("blur-px", "Of lens and sensor together, pixels.", kind=float),
            Option("full-well-electrons", "Of a pixel: fewer make more noise.", kind=float),
            Option("read-noise-electrons", "Of a pixel.", kind=float),
        ),
    ),
    "settling": Study(
        "settling",
        "How long to wait at a stop before the force is steady.",
        about="On a simulated gel whose relaxation is assumed, or given by --prony; of your own "
        "gel: record the protocol `settling` and give the run by --from, the relaxation is fitted.",
        takes=("scale", "rig", "from", "grid"),
        scale=1.0,
        options=(
            Option(
                "prony",
                "G:TAU_S, a share of the steady force that fades with TAU_S; may be given several "
                "times.",
                (),
            ),
        ),
    ),
}


def find(name: str) -> Study:
    """A study by its name. Raises InputError for an unknown one."""
    if name not in STUDIES:
        raise InputError(f"{name}: no such study; {did_you_mean(name, STUDIES)}")
    return STUDIES[name]


def run(name: str, asked: Asked) -> StudyResult:
    """Run a study. Raises InputError for an unknown one or bad options, RunFailed.

    Jobs that were asked for and have no result stand in the result's `missing`, whatever the study
    says of them.
    """
    module = importlib.import_module(f"deltact_fab.study.{find(name).module}")
    result: StudyResult = module.run(asked)
    forgotten = [job for grid in asked.grids for job in grid.missing if job not in result.missing]
    return replace(result, missing=(*result.missing, *forgotten)) if forgotten else result
