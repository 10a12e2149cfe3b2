"""How long to wait at a stop: the force's error against the wait, on the viscous gel or a bench's.

Simulated: the protocol `settling` with rests until nothing is left, each depth a job, on the
viscous gel and (for the closed form) on the elastic one. Recorded: the rests of runs, and the
series that fits them. Both give stops, and from there on it is one study.

What is computed here is kept under the hash of this module: no words or figures belong into it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import catalog, record
from ..analysis.relaxation import Rest, Series, fit, rests
from ..cad.design import load_design
from ..errors import InputError
from ..protocols import plan
from ..protocols.plan import Protocol, expand
from ..report.result import StudyResult
from ..rig.simulator import GelConfig
from ..shapes import SkinDimensions
from ..virtual.paths import poses
from ..virtual.presses import Presses
from .grid import GridJob
from .intervals import estimate, headline
from .request import share_of, virtual_rig
from .settling_page import ASSUMED, result, words
from .settling_stops import WAITS_S, Stop, judged, simulated

if TYPE_CHECKING:
    from .request import StudyRequest


def follow(given: dict[str, Any]) -> dict[str, Any]:
    """One press of a protocol knot by knot.

    given: protocol, gel (resolution) and skin as data, press. Result: t_s (n + 1,) since first
    touch, force_n (n + 1, 3), moved_mm (n + 1,) in plane and at most since the tip last came to
    rest (0 without fields); stops: of each line of motion that ends in contact id, kind, depth_mm,
    rests_s and the knots `arrived` and `left` at the ends of its rest; of the solver flags, dofs
    and seconds.
    """
    protocol = Protocol.model_validate(given["protocol"])
    skin = SkinDimensions(**given["skin"])
    presses = Presses(protocol, skin, GelConfig.model_validate(given["gel"]))
    path = next(path for path in presses.paths if path.press == given["press"])
    solver = presses.of(path).solver
    knots = solver.solve_all()
    planned = poses(path, presses.increments, presses.relaxing_s)
    forces = np.array([(0.0, 0.0, 0.0), *(knot.force_n for knot in knots)]) * presses.modulus_mpa
    moved = np.zeros(len(forces))
    # The steps that end in contact: those that its path has a line for.
    steps = [s for s in expand(protocol) if s.press == path.press and s.target_mm[2] < 0]
    stops: list[dict[str, Any]] = [
        {"id": step.id, "kind": step.kind, "depth_mm": -step.target_mm[2], "rests_s": line.dwell_s}
        for step, line in zip(steps, path.lines, strict=True)
    ]
    line = 0
    for n, pose in enumerate(planned, start=1):
        if pose.part == 1.0:
            stops[line] |= {"arrived": n, "left": n}
            line += 1
        elif pose.part == 0.0:
            stops[line - 1]["left"] = n
            moved[n] = _moved(knots[stops[line - 1]["arrived"] - 1], knots[n - 1])
    return {
        "t_s": np.concatenate([[0.0], np.cumsum([pose.seconds for pose in planned])]),
        "force_n": forces,
        "moved_mm": moved,
        "stops": stops,
        "flags": solver.flags,
        "dofs": solver.dofs,
        "seconds": solver.seconds,
    }


def _moved(start: Any, now: Any) -> float:
    if start.displacement_mm is None or now.displacement_mm is None:
        return 0.0
    off = now.displacement_mm.astype(float) - start.displacement_mm
    return float(np.hypot(off[..., 0], off[..., 1]).max())


PROTOCOL = "settling"
NO_BENCH = (PROTOCOL, "demo", "demo-calibration")  # the first is judged here, of the gel itself
RIG = "virtual-coarse"
BALL = "sphere:"
FADE_S = np.concatenate([[0.0], np.geomspace(0.02, 2000.0, 120)])  # of a fitted series
RELAXED = 10.0  # x the slowest time: what is left then is e^-10 of its branch


def run(asked: StudyRequest) -> StudyResult:
    """The study. Raises InputError for a bad series, rig or run; SolverError, RunFailed."""
    return _recorded(asked) if asked.runs else _simulated(asked)


# -- simulated -----------------------------------------------------------------------------------


def _simulated(asked: StudyRequest) -> StudyResult:
    protocol, _ = plan.load(PROTOCOL)
    series = series_of(asked.more.get("prony") or (), protocol)
    count = max(1, round(share_of(asked.scale) * len(protocol.depths_mm)))
    given = _gel(asked.rig or RIG, protocol.specimen.design)
    jobs, pairs = [], []
    for depth in protocol.depths_mm[-count:]:  # the deepest are kept
        names = f"{depth:g} mm, viscous", f"{depth:g} mm, elastic"
        for name, of, cost in zip(names, (series, None), (25.0, 8.0), strict=True):
            jobs.append(_job(name, _one_depth(protocol, depth, of), given, cost))
        pairs.append(names)
    ways, way_jobs = shipped(given)
    grid = asked.solve([*jobs, *way_jobs])
    found = grid.partial()
    stops = [
        stop for viscous, elastic in pairs if viscous in found and elastic in found
        for stop in simulated(found[viscous], found[elastic], series)
    ]  # fmt: skip
    if not stops:
        grid.require_whole()
    solved = [found[viscous] for viscous, _ in pairs if viscous in found]
    moved_um = max(float(1e3 * one["moved_mm"].max()) for one in solved)
    # Of the stop's force, the most that the excess itself is off.
    off_pct = max(
        float(100 * np.linalg.norm(s.force_n - s.steady_n - s.by_series_n, axis=1).max()
              / np.linalg.norm(s.steady_n))
        for s in stops
    )  # fmt: skip
    table = _judged_protocols(ways, found, series)
    notes = [
        "The camera sees nothing of it: while the force fades at a stop, no point of the face "
        f"moves by more than {moved_um:.1f} um in plane. An image is of the deformation; the force "
        "beside it is a matter of when it was read.",
        f"The closed form (ramp, then hold, of the same way on an elastic gel) is off by at most "
        f"{off_pct:.2g} % of the force at any solved knot.",
        "Shares of the force do not depend on the modulus, and hardly on the mesh.",
    ]  # fmt: skip
    flags = sorted(
        {name for viscous, _ in pairs for name in found.get(viscous, {}).get("flags", ())}
    )
    settings = {
        "gel": f"Prony series {words(series)}, {ASSUMED}",
        "rig": f"{asked.rig or RIG}: {solved[-1]['dofs']} unknowns"
        + (f", flagged {', '.join(flags)}" if flags else ""),
        "ramp": f"{protocol.motion.press_feed_mm_min:g} mm/min",
    }
    return result(
        asked, stops, series, protocol, table, notes, settings,
        simulated_=True, missing=tuple(grid.missing),
        more={"moved_um": moved_um, "closed_form_off_pct": off_pct},
    )  # fmt: skip


def series_of(given: Sequence[str], protocol: Protocol) -> Series:
    """The series as typed, G:TAU_S each, else the protocol's. Raises InputError."""
    pairs: list[tuple[float, float]] = [(g, tau) for g, tau in protocol.specimen.prony if g > 0]
    if given:
        pairs = []
        for text in given:
            g, _, tau = text.partition(":")
            try:
                pairs.append((float(g), float(tau)))
            except ValueError:
                raise InputError(
                    f"--prony {text}: expected G:TAU_S, as 0.05:3 (5 % of the steady force fade "
                    "with 3 s)"
                ) from None
    if not pairs:
        raise InputError("protocol settling: specimen.prony: a series is needed, or --prony")
    return Series(tuple(g for g, _ in pairs), tuple(tau for _, tau in pairs))


def _one_depth(protocol: Protocol, depth_mm: float, series: Series | None) -> Protocol:
    """The protocol at one depth: on the viscous gel with rests to the end, or elastic with none."""
    rest = 0.0 if series is None else RELAXED * max(series.times_s)
    prony = () if series is None else series.pairs
    fields = {"image"} if series is not None else set()
    return protocol.model_copy(
        update={
            "depths_mm": (depth_mm,),
            "channels": protocol.channels | fields,
            "capture": protocol.capture.model_copy(update={"settle_s": rest}),
            "specimen": protocol.specimen.model_copy(update={"prony": prony}),
        }
    )


def _gel(rig_name: str, design: str) -> dict[str, Any]:
    """Resolution of the simulated gel, and the skin, as a job takes them."""
    gel = virtual_rig(rig_name)[0].virtual.gel
    return {"gel": gel.model_dump(mode="json"), "skin": asdict(load_design(design).skin)}


def _job(name: str, protocol: Protocol, given: dict[str, Any], cost: float) -> GridJob:
    """The first press of a protocol, which has one indenter or takes the first."""
    data = protocol.model_dump(mode="json", exclude={"description"})
    press = f"{protocol.indenters[0].replace(':', '-')}/p1"
    return GridJob(name, follow, {**given, "protocol": data, "press": press}, cost)


# -- recorded ------------------------------------------------------------------------------------


def _recorded(asked: StudyRequest) -> StudyResult:
    if asked.more.get("prony"):
        raise InputError("--prony: the series of recorded runs is fitted; leave it out")
    runs = [record.open(folder) for folder in asked.runs]
    found: list[Rest] = []
    for run_ in runs:
        found += rests(run_)
    fitted = fit(found)
    stops = [
        Stop(
            rest.step_id, rest.kind, rest.depth_mm, rest.wait_s, rest.force_n, fitted.steady_n[n],
            fitted.left_n(n, rest.wait_s), f"{rest.way.press} {rest.depth_mm:g} mm",
            FADE_S, fitted.left_n(n, FADE_S),
        )
        for n, rest in enumerate(found)
    ]  # fmt: skip
    protocol = plan.load(PROTOCOL)[0]
    specimen = runs[0].meta["protocol"]["specimen"]
    ways, jobs = shipped(_gel(asked.rig or RIG, specimen["design"]))
    grid = asked.solve(jobs)
    longest = max(float(rest.wait_s[-1]) for rest in found)
    notes = [
        f"{len(found)} rests of up to {longest:.3g} s; the series leaves {1e3 * fitted.rms_n:.2g} "
        "mN rms of samples averaged over 20 ms.",
    ]  # fmt: skip
    if fitted.unsure:
        slow = ", ".join(f"{tau:.3g} s" for tau in fitted.unsure)
        notes.append(
            f"A branch of {slow} is slower than half of the longest rest: its share, and the "
            "steady force, are extrapolated. Rest longer (settle_s) to know them, and see to the "
            "force sensor's drift, which looks the same."
        )  # fmt: skip
    shares = np.arange(len(found))
    groups = [stop.group for stop in stops]
    total = estimate(
        shares, groups, lambda rows: sum(fit([found[int(n)] for n in rows]).series.shares),
        "press", "positive",
    )  # fmt: skip
    head = headline("Share of the steady force that fades", "%", total, 100)
    settings = {
        "runs": ", ".join(str(folder) for folder in asked.runs),
        "gel": f"fitted: {words(fitted.series)}",
        "ramp": f"{runs[0].meta['protocol']['motion']['press_feed_mm_min']:g} mm/min",
    }
    return result(
        asked, stops, fitted.series, protocol,
        _judged_protocols(ways, grid.partial(), fitted.series), notes, settings,
        simulated_=all(run_.simulated for run_ in runs), missing=tuple(grid.missing), heads=(head,),
        more={"rms_n": fitted.rms_n, "unsure_tau_s": list(fitted.unsure), "rests": len(found)},
    )  # fmt: skip


# -- what both give ------------------------------------------------------------------------------


def shipped(given: dict[str, Any]) -> tuple[dict[str, float], list[GridJob]]:
    """Protocols whose stops rest, with their settle_s, and the jobs of their elastic ways.

    Of each that presses a ball the largest one's first press, by the linear gel: ratios along
    the way matter here.
    """
    settle, jobs = {}, []
    for name in catalog.names("protocols"):
        protocol, _ = plan.load(name, by_hand=True)
        balls = [one for one in protocol.indenters if one.startswith(BALL)]
        settle_s, pressed = protocol.capture.settle_s, protocol.depths_mm
        felt = "force" in protocol.channels and name not in NO_BENCH
        if not (settle_s and pressed and felt and balls):
            continue
        largest = max(balls, key=lambda one: float(one.removeprefix(BALL)))
        settle[name] = settle_s
        linear = protocol.model_copy(
            update={
                "indenters": (largest,),
                "channels": protocol.channels & {"force", "shear"},
                "specimen": protocol.specimen.model_copy(
                    update={"gel_model": "linear", "prony": ()}
                ),
            }
        )
        jobs.append(_job(f"way of {name}", linear, given, 8.0))
    return settle, jobs


def _judged_protocols(
    settle: dict[str, float], found: dict[str, Any], series: Series
) -> dict[str, list[dict[str, float]]]:
    """Rows over settle_s of each protocol, its own settle_s first."""
    ways = {name: f"way of {name}" for name in settle}
    return {
        name: judged(found[way], series, [settle[name], *WAITS_S])
        for name, way in ways.items()
        if way in found
    }
