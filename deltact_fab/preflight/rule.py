"""What a rig allows: a predicted peak over a declared limit, or a limit that is not declared.

On a real rig both are errors before anything moves; the simulated one cannot break, and warns.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from ..aliases import Vector
from ..errors import InputError
from ..protocols.limits import LimitCheck
from ..protocols.plan import Protocol
from ..rig.config import RigConfig
from ..rig.force.guard import SHARE, GuardLimits
from .peaks import MODULUS_FACTOR, PAPER_REMARK, PAPER_REMARK_FROM, Peak

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ForceLimits:
    """What a rig file says about forces; None: not declared.

    source: the rig file. stage_n: `[stage] max_force_n`. sensor_n, sensor_nmm: `[force] range_n`
    and `range_nmm`. origin_mm: `[force] origin_mm`. has_sensor: a sensor is in the way of the
    force, whether its channel is recorded or not. guard: where it stops the stage; None: nothing
    guards. guard_keys: where its limits of force and of torque stand.
    """

    simulated: bool
    source: str
    stage_n: Vector | None
    has_sensor: bool = False
    sensor_n: Vector | None = None
    sensor_nmm: Vector | None = None
    origin_mm: Vector | None = None
    guard: GuardLimits | None = None
    guard_keys: tuple[str, str] = ("", "")

    def undeclared(self) -> list[str]:
        """Keys that a real rig has to declare and this one does not.

        Torque ranges need the origin that torques count from; without one they are not checked.
        """
        keys = [] if self.stage_n else ["[stage] max_force_n"]
        if self.has_sensor and not self.sensor_n:
            keys.append("[force] range_n")
        if self.has_sensor and self.origin_mm and not self.sensor_nmm:
            keys.append("[force] range_nmm")
        return keys


def limits_of(
    rig: RigConfig, source: str, protocol: Protocol, realtime: bool = False
) -> ForceLimits:
    """The limits that a rig file declares; a default that it does not write down is none.

    realtime: a virtual rig on the wall clock, whose guard is armed as that of a real one. Raises
    InputError for a guard whose limit the sensor cannot measure.
    """
    force = rig.force if "force" in rig.model_fields_set else None
    guard, keys = None, ("", "")
    if rig.force is not None and (realtime or not rig.simulated):
        try:
            guard, keys = GuardLimits.of(rig.guard, rig.force), _guard_keys(rig)
        except InputError as why:
            raise InputError(f"{source}: {why}") from why
    declared = force.model_fields_set if force is not None else set()
    return ForceLimits(
        simulated=rig.simulated,
        source=source,
        stage_n=rig.stage.max_force_n,
        has_sensor=force is not None or "force" in protocol.channels,
        sensor_n=force.range_n if force and "range_n" in declared else None,
        sensor_nmm=force.range_nmm if force and "range_nmm" in declared else None,
        origin_mm=force.origin_mm if force else None,
        guard=guard,
        guard_keys=keys,
    )


def _guard_keys(rig: RigConfig) -> tuple[str, str]:
    """What sets the guard's limits on the axes: keys of force and of torque."""
    own = rig.guard
    force, torque = (f"the guard, {SHARE:g} of [force] {key}" for key in ("range_n", "range_nmm"))
    if own is not None and own.axes_n is not None:
        force = "[guard] axes_n"
    elif own is not None and own.force_n is not None:
        force = "[guard] force_n"
    if own is not None and own.torque_nmm is not None:
        torque = "[guard] torque_nmm"
    return force, torque


def judge(name: str, thickness_mm: float, peaks: Sequence[Peak], limits: ForceLimits) -> list[str]:
    """One line for each limit that is passed (the worst press) and each that is missing.

    name: of the protocol. thickness_mm: of the gel.
    """
    lines = [
        f"{name}: {key} is not declared in {limits.source}, so its force cannot be checked"
        for key in limits.undeclared()
    ]
    reasons: dict[str, None] = {}
    rows = [(*row, True) for row in _rows(limits, [p.high for p in peaks])]
    rows += [(*row, False) for row in _guard_rows(limits, peaks)]
    for what, limit, key, loads, high in rows:
        over = [(load, k) for k, load in enumerate(loads) if load > limit]
        if over:
            load, k = max(over)
            lines.append(
                _over(name, peaks[k], what, load, f"{limit:g} {_unit(what)}", key, limits, high)
                + (f" (and {len(over) - 1} more presses)" if len(over) > 1 else "")
            )
            if peaks[k].reason:
                reasons[f"; {peaks[k].indenter} {peaks[k].level}: {peaks[k].reason}"] = None
    if lines:
        lines[-1] += "".join(reasons)
    if any(p.depth_mm > PAPER_REMARK_FROM * thickness_mm for p in peaks) and lines:
        lines[-1] += f"; {PAPER_REMARK}"
    return lines


def may_trip(name: str, peaks: Sequence[Peak], limits: ForceLimits) -> list[str]:
    """One line for each limit of the guard that is passed only by a gel of twice the modulus."""
    expected = {row[0]: row[3] for row in _guard_rows(limits, peaks)}
    return [
        f"{name}: a gel of twice the modulus would trip the guard: {what} up to {max(loads):.0f} "
        f"{_unit(what)}, over {limit:g} {_unit(what)} of {key} in {limits.source}"
        for what, limit, key, loads in _guard_rows(limits, [p.high for p in peaks])
        if max(loads) > limit >= max(expected[what])
    ]


def checks(peaks: Sequence[Peak], limits: ForceLimits) -> list[LimitCheck]:
    """A row for each declared limit, with the worst press, and one for those that are missing."""
    missing = limits.undeclared()
    rows = [_check("force limits", "undeclared: " + ", ".join(missing), len(missing), 0, limits)]
    for what, limit, key, loads in _rows(limits, [p.high for p in peaks]):
        load, where = _worst(loads, peaks)
        text = f"{what} with twice the modulus, {key} ({_unit(what)})"
        rows.append(_check("peak force", text, round(load, 1), limit, limits, where))
    for what, limit, key, loads in _guard_rows(limits, peaks):
        load, where = _worst(loads, peaks)
        text = f"{what} as expected, {key} ({_unit(what)})"
        row = _check("guard", text, round(load, 1), limit, limits, where)
        # What twice the modulus would trip is worth a look; the guard loses a run, and no gel.
        rows.append(replace(row, warns=row.warns or (row.ok and MODULUS_FACTOR * load > limit)))
    return rows if missing else rows[1:]


def _worst(loads: Sequence[float], peaks: Sequence[Peak]) -> tuple[float, str]:
    """The largest load and the press that it comes with."""
    load, worst = max(zip(loads, peaks, strict=True), key=lambda pair: pair[0])
    x, y = worst.at_mm
    return load, f"{worst.indenter} at ({x:g}, {y:g}) mm, {worst.depth_mm:g} mm deep"


def _unit(what: str) -> str:
    return "N mm" if what.startswith("moment") else "N"


def _check(
    name: str, what: str, figure: float, bound: float, limits: ForceLimits, where: str = ""
) -> LimitCheck:
    over = figure > bound
    return LimitCheck(
        name, limits.simulated or not over, what, figure, bound, where or limits.source,
        over and limits.simulated,
    )  # fmt: skip


def require(lines: Iterable[str], limits: ForceLimits) -> list[str]:
    """Raise InputError with all lines on a real rig; on the simulated one log and return them."""
    found = list(lines)
    if found and not limits.simulated:
        raise InputError(" | ".join(found))
    for line in found:
        _LOG.warning("warning: %s", line)
    return found


def _rows(
    limits: ForceLimits, high: Sequence[Peak]
) -> Iterable[tuple[str, float, str, list[float]]]:
    """(what, limit, its key, load of each peak)."""
    normal, side = [p.normal_n for p in high], [p.tangential_n for p in high]
    declared = ((limits.stage_n, "[stage] max_force_n"), (limits.sensor_n, "[force] range_n"))
    for limit, key in declared:
        if limit is not None:
            yield "normal force", limit[2], key, normal
            # A drag along any axis of the protocol may meet either axis of a turned stage.
            yield "tangential force", min(limit[:2]), key, side
    moments = [p.moment_nmm for p in high if p.moment_nmm is not None]
    if limits.sensor_nmm is not None and len(moments) == len(high):
        for axis, letter in enumerate("xyz"):
            loads = [m[axis] for m in moments]
            yield f"moment about {letter}", limits.sensor_nmm[axis], "[force] range_nmm", loads


def _guard_rows(
    limits: ForceLimits, peaks: Sequence[Peak]
) -> Iterable[tuple[str, float, str, list[float]]]:
    """The same for what the guard would stop at."""
    guard = limits.guard
    if guard is None:
        return
    force, torque = limits.guard_keys
    yield "normal force", guard.force_n[2], force, [p.normal_n for p in peaks]
    yield "tangential force", min(guard.force_n[:2]), force, [p.tangential_n for p in peaks]
    if math.isfinite(guard.resultant_n):
        loads = [math.hypot(p.normal_n, p.tangential_n) for p in peaks]
        yield "whole force", guard.resultant_n, "[guard] resultant_n", loads
    moments = [p.moment_nmm for p in peaks if p.moment_nmm is not None]
    if len(moments) == len(peaks):
        for axis, letter in enumerate("xyz"):
            loads = [m[axis] for m in moments]
            yield f"moment about {letter}", guard.torque_nmm[axis], torque, loads


def _over(
    name: str, peak: Peak, what: str, load: float, limit: str, key: str, limits: ForceLimits,
    high: bool,
) -> str:  # fmt: skip
    """high: the load is with twice the modulus; else as expected, which the guard would stop."""
    x, y = peak.at_mm
    unit = limit.partition(" ")[2]
    most = "at most " if peak.reason else ""
    told = f"up to {load:.0f} {unit} (expected {most}{load / MODULUS_FACTOR:.0f})"
    if not high:
        told = f"{most}{load:.0f} {unit} expected"
    return (
        f"{name}: {peak.indenter} at ({x:g}, {y:g}) mm, {peak.depth_mm:g} mm deep: {what} {told}, "
        f"over {limit} of {key} in {limits.source}"
        + ("" if high else ": the guard would stop the run")
    )
