"""The best pattern for a printer and a camera: candidates ranked, the best few confirmed."""

from __future__ import annotations

from dataclasses import asdict

from ..protocols import plan
from ..report.result import StudyResult
from .grid import GridJob
from .request import StudyRequest, virtual_rig
from .search.candidates import Candidate, candidates, shortened, size_of, thinned
from .search.confirm import confirm
from .search.drag import FIELD_PX, probe
from .search.imager import PatternImager, bench_of
from .search.result import (
    DEFAULT,
    FARNEBACK,
    Findings,
    confirmed,
    finalists,
    ranked,
    result,
)
from .seeds import seed_of

RIG = "virtual"
PROTOCOL = "pattern-search"
SHIPPED = {"law": "algorithm1", "patch_mm": 0.4, "r": 0.6}
"""What `recommended` prints: confirmed in any case."""
PROBE_S, FRAME_S = 1.2, 0.11
"""A candidate's cost, and a frame's of a pattern on the gel; measured on one core."""


def run(asked: StudyRequest) -> StudyResult:
    """Search, then confirm. Raises InputError for a rig or option that cannot be, RunFailed."""
    bench = bench_of(asked.rig or RIG, asked.more)
    whole = candidates(bench.printer.mm_per_dot, bench.mm_per_px)
    size = size_of(asked.scale or 1.0, len(whole))
    among = thinned(whole, size.candidates, (SHIPPED,))
    searches = range(size.seeds)
    probes = asked.solve([_probe(c, k, bench, asked.seed) for k in searches for c in among])
    there = probes.partial()
    names = {c.name: [_probed(c, k) for k in searches] for c in among}
    frame = ranked({c: [there[n] for n in own if n in there] for c, own in names.items()}, among)
    best = finalists(frame, size.finalists)
    paper = next(c.name for c in whole if c.is_paper)
    shipped = [c.name for c in among if dict(c.keys) == SHIPPED]
    wanted = dict.fromkeys([*best, paper, *shipped])
    chosen = {c.name: c for c in among if c.name in wanted}
    protocol = shortened(plan.load(PROTOCOL)[0], size.drag)
    presses = list(dict.fromkeys(step.press for step in plan.expand(protocol) if step.frames))
    farneback = {*best[:1], paper}
    jobs = [
        [_confirm(list(chosen.values()), farneback, k, press, bench, asked, protocol)
         for press in presses]
        for k in range(size.held_out)
    ]  # fmt: skip
    confirmations = asked.solve([job for own in jobs for job in own])
    there = confirmations.partial()
    # Of each seed that was done whole what its presses gave.
    by_seed = [[there[j.name] for j in own] for own in jobs if all(j.name in there for j in own)]
    ours, refused = confirmed(by_seed, list(chosen), DEFAULT)
    return result(
        Findings(
            asked=asked,
            rig=asked.rig or RIG,
            bench=bench,
            size=size,
            protocol=protocol,
            among=among,
            frame=frame,
            finalists=best,
            paper=paper,
            ours=ours,
            farneback=confirmed(by_seed, list(chosen), FARNEBACK)[0],
            refused=refused,
            seen=by_seed[0][0] if by_seed else {},
        )
    )


def _probed(candidate: Candidate, k: int) -> str:
    return f"{candidate.name}, search {k + 1}"


def _probe(candidate: Candidate, k: int, bench: PatternImager, seed: int) -> GridJob:
    """One candidate with one seed; motion and noise are the same for all of them."""
    own = seed_of(seed, f"search {k}")
    given = {
        "bench": asdict(bench), "recipe": candidate.plain(own), "seed": own, "field_px": FIELD_PX,
    }  # fmt: skip
    return GridJob(_probed(candidate, k), probe, given, PROBE_S)


def _confirm(
    chosen: list[Candidate],
    farneback: set[str],
    k: int,
    press: str,
    bench: PatternImager,
    asked: StudyRequest,
    protocol: plan.Protocol,
) -> GridJob:
    """All chosen patterns in one press, with a seed that the search has not seen."""
    own = seed_of(asked.seed, f"held-out seed {k}")
    patterns = [
        {
            "name": c.name,
            "recipe": c.plain(own),
            "methods": [DEFAULT, FARNEBACK] if c.name in farneback else [DEFAULT],
        }
        for c in chosen
    ]
    given = {
        "protocol": protocol.model_dump(mode="json"),
        "press": press,
        "rig": virtual_rig(asked.rig or RIG)[0].model_dump(mode="json"),
        "bench": asdict(bench),
        "patterns": patterns,
        "seed": own,
    }
    frames = sum(step.frames for step in plan.expand(protocol) if step.press == press)
    cost = FRAME_S * frames * (len(chosen) + 6)  # geometry is one more, Farneback two or three
    return GridJob(f"{press}, held out {k + 1}", confirm, given, cost)
