"""The best pattern for a printer and a camera: candidates ranked, the best few confirmed."""

from __future__ import annotations

from typing import Any

from ..protocols import plan
from ..report.result import StudyResult
from .grid import Grid, GridJob
from .request import StudyRequest
from .search.candidates import Candidate, candidates, shortened, size_of, thinned
from .search.confirm import confirm
from .search.findings import DEFAULT, FARNEBACK, Findings
from .search.imager import PatternImager, bench_of, rig_of
from .search.probe import FIELD_PX, probe
from .search.result import result
from .search.search import combined, finalists, order, spread, table
from .seeds import seed_of

RIG = "virtual"
PROTOCOL = "pattern-search"
SHIPPED = {"law": "algorithm1", "patch_mm": 0.15, "r": 0.1}
"""What `dense-with-dots` prints: the pattern that a sensor has that takes the default."""
PROBE_S, FRAME_S = 1.9, 0.11
"""A candidate's cost, and a frame's of a pattern on the gel; measured on one core."""


def run(asked: StudyRequest) -> StudyResult:
    """Search, then confirm. Raises InputError for a rig or option that cannot be, RunFailed."""
    rig = asked.rig or RIG
    bench = bench_of(rig, asked.more)
    whole = candidates(bench.printer.mm_per_dot, bench.mm_per_px)
    size = size_of(asked.scale or 1.0, len(whole))
    among = thinned(whole, size.candidates, (SHIPPED,))
    probes = asked.solve(
        [_probe(c, k, bench, asked.seed) for k in range(size.seeds) for c in among]
    )
    frame = table(_by_candidate(probes, among, size.seeds), among)
    best = finalists(frame, size.finalists)
    paper = next(c.name for c in whole if c.is_paper)
    shipped = [c.name for c in among if dict(c.keys) == SHIPPED]
    fixed = list(dict.fromkeys([*best, paper, *shipped]))
    names = [*fixed, *spread(frame, fixed, size.others)]
    protocol = shortened(plan.load(PROTOCOL)[0], size.drag)
    chosen = [next(c for c in among if c.name == name) for name in names]
    farneback = {best[0], paper} if best else {paper}
    confirmations = asked.solve(
        [_confirm(chosen, farneback, k, press, bench, rig, protocol, asked.seed)
         for k in range(size.held_out) for press in presses_of(protocol)]
    )  # fmt: skip
    return result(
        Findings(
            bench=bench,
            rig=rig,
            seed=asked.seed,
            scale=asked.scale,
            size=size,
            protocol=protocol,
            among=tuple(among),
            frame=frame,
            order=order(frame),
            sure_order=order(frame, "confident_error_mm"),
            lost_order=order(frame.assign(lost=1 - frame["coverage"]), "lost"),
            pair=combined(frame),
            finalists=tuple(best),
            paper=paper,
            shipped=shipped[0] if shipped else None,
            presses=tuple(presses_of(protocol)),
            confirmed_names=tuple(names),
            confirmations=_by_seed(confirmations, protocol, size.held_out),
            missing=(*probes.missing, *confirmations.missing),
        )
    )


def _probe(candidate: Candidate, k: int, bench: PatternImager, seed: int) -> GridJob:
    """One candidate with one seed; motion and noise are the same for all of them."""
    own = seed_of(seed, f"search {k}")
    given = {
        "bench": bench.as_dict(),
        "recipe": _plain(candidate, own),
        "seed": own,
        "field_px": FIELD_PX,
    }
    return GridJob(f"{candidate.name}, search {k + 1}", probe, given, PROBE_S)


def _confirm(
    chosen: list[Candidate],
    farneback: set[str],
    k: int,
    press: str,
    bench: PatternImager,
    rig: str,
    protocol: plan.Protocol,
    seed: int,
) -> GridJob:
    """All chosen patterns in one press, with a seed that the search has not seen."""
    own = seed_of(seed, f"held-out seed {k}")
    patterns = [
        {
            "name": c.name,
            "recipe": _plain(c, own),
            "methods": [DEFAULT, FARNEBACK] if c.name in farneback else [DEFAULT],
        }
        for c in chosen
    ]
    given = {
        "protocol": protocol.model_dump(mode="json"),
        "press": press,
        "rig": rig_of(rig).model_dump(mode="json"),
        "bench": bench.as_dict(),
        "patterns": patterns,
        "seed": own,
    }
    frames = sum(step.frames for step in plan.expand(protocol) if step.press == press)
    cost = FRAME_S * frames * (len(chosen) + 6)  # geometry is one more, Farneback two or three
    return GridJob(f"{press}, held out {k + 1}", confirm, given, cost)


def _plain(candidate: Candidate, seed: int) -> dict[str, Any]:
    return candidate.recipe(seed).model_dump(mode="json", exclude_none=True)


def presses_of(protocol: plan.Protocol) -> list[str]:
    """Names of the protocol's presses."""
    return list(dict.fromkeys(step.press for step in plan.expand(protocol) if step.frames))


def _by_seed(grid: Grid, protocol: plan.Protocol, seeds: int) -> tuple[list[Any], ...]:
    """Of each seed that was done whole what its presses gave."""
    there = grid.partial()
    names = [[f"{press}, held out {k + 1}" for press in presses_of(protocol)] for k in range(seeds)]
    return tuple([there[n] for n in some] for some in names if all(n in there for n in some))


def _by_candidate(grid: Grid, among: list[Candidate], seeds: int) -> dict[str, list[Any]]:
    """What there is of each candidate, by its name."""
    there = grid.partial()
    names = {c.name: [f"{c.name}, search {k + 1}" for k in range(seeds)] for c in among}
    return {name: [there[job] for job in jobs if job in there] for name, jobs in names.items()}
