"""What a study is asked to do: its options and where it runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..aliases import Progress
from ..errors import InputError

if TYPE_CHECKING:
    from ..rig.config import VirtualConfig
    from .grid import Grid, GridJob


@dataclass(frozen=True)
class StudyRequest:
    """Common to all studies.

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
    more: dict[str, Any] = field(default_factory=dict)
    grids: list[Grid] = field(default_factory=list, compare=False, repr=False)

    def solve(self, jobs: Sequence[GridJob]) -> Grid:
        """A grid of jobs on what was asked for; what is missing in it gets into the result."""
        from .grid import solve

        grid = solve(jobs, self.executor, self.progress, self.say)
        self.grids.append(grid)
        return grid


def share_of(scale: float | None) -> float:
    """A scale as a number, 1 for None. Raises InputError outside of (0, 1]."""
    share = 1.0 if scale is None else scale
    if not 0 < share <= 1:
        raise InputError(f"--scale: {share:g}; expected above 0 and at most 1")
    return share


def virtual_rig(name: str) -> tuple[VirtualConfig, Path]:
    """A virtual rig by name or path, and its file. Raises InputError for a real one."""
    from ..rig.config import VirtualConfig, load

    rig, source = load(name)
    if not isinstance(rig, VirtualConfig):
        raise InputError(
            f"{source}: kind: {rig.kind!r}; a study simulates on a 'virtual' rig: name a virtual "
            "rig, or give what a real one recorded to a study that takes --from"
        )
    return rig, source


def modulus_remark(modulus_mpa: float, also: str = "") -> str:
    """For a study's notes: how well the gel's modulus is known, and what that changes.

    Stresses of the simulated gel are in proportion to it at one and the same deformation (so is
    every force that is solved here: `gel.path` solves for 1 MPa). also: what else depends on it, of
    a study in which what is fixed in newtons meets forces at another place.
    """
    from ..preflight.peaks import MODULUS_FACTOR

    return (
        f"The gel's modulus, {modulus_mpa:g} MPa, is known to a factor of {MODULUS_FACTOR:g} "
        "(Gent's relation from Shore 15A). Deformation at a given depth does not depend on it, nor "
        "does what follows from deformation alone: images, flow, tracking errors, depth, contact, "
        "how fast a force fades, shares of a force. Forces and tractions, and their errors in N "
        f"and kPa, are in proportion to it.{also}"
    )
