"""What a rig allows: a predicted peak over a declared limit, or a limit that is not declared.

On a real rig both are errors before anything moves; the simulated one cannot break, and warns.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..errors import InputError
from ..protocols.limits import Check
from ..protocols.plan import Protocol
from ..rig.config import RigConfig
from .peaks import MODULUS_FACTOR, PAPER_REMARK, PAPER_REMARK_FROM, Peak, Vector

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ForceLimits:
    """What a rig file says about forces; None: not declared.

    source: the rig file. stage_n: `[stage] max_force_n`. sensor_n, sensor_nmm: `[force] range_n`
    and `range_nmm`. origin_mm: `[force] origin_mm`. has_sensor: a sensor is in the way of the
    force, whether its channel is recorded or not.
    """

    simulated: bool
    source: str
    stage_n: Vector | None
    has_sensor: bool = False
    sensor_n: Vector | None = None
    sensor_nmm: Vector | None = None
    origin_mm: Vector | None = None

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


def limits_of(rig: RigConfig, source: str, protocol: Protocol) -> ForceLimits:
    """The limits that a rig file declares; a default that it does not write down is none."""
    force = rig.force if "force" in rig.model_fields_set else None
    declared = force.model_fields_set if force is not None else set()
    return ForceLimits(
        simulated=rig.simulated,
        source=source,
        stage_n=rig.stage.max_force_n,
        has_sensor=force is not None or "force" in protocol.channels,
        sensor_n=force.range_n if force and "range_n" in declared else None,
        sensor_nmm=force.range_nmm if force and "range_nmm" in declared else None,
        origin_mm=force.origin_mm if force else None,
    )


def judge(name: str, thickness_mm: float, peaks: Sequence[Peak], limits: ForceLimits) -> list[str]:
    """One line for each limit that is passed (the worst press) and each that is missing.

    name: of the protocol. thickness_mm: of the gel.
    """
    lines = [
        f"{name}: {key} is not declared in {limits.source}, so its force cannot be checked"
        for key in limits.undeclared()
    ]
    reasons: dict[str, None] = {}
    for what, limit, key, loads in _rows(limits, [p.high for p in peaks]):
        over = [(load, k) for k, load in enumerate(loads) if load > limit]
        if over:
            load, k = max(over)
            unit = "N mm" if key.endswith("range_nmm") else "N"
            lines.append(
                _over(name, peaks[k], what, load, f"{limit:g} {unit}", key, limits.source)
                + (f" (and {len(over) - 1} more presses)" if len(over) > 1 else "")
            )
            if peaks[k].reason:
                reasons[f"; {peaks[k].indenter} {peaks[k].level}: {peaks[k].reason}"] = None
    if lines:
        lines[-1] += "".join(reasons)
    if any(p.depth_mm > PAPER_REMARK_FROM * thickness_mm for p in peaks) and lines:
        lines[-1] += f"; {PAPER_REMARK}"
    return lines


def checks(peaks: Sequence[Peak], limits: ForceLimits) -> list[Check]:
    """A row for each declared limit, with the worst press, and one for those that are missing."""
    missing = limits.undeclared()
    rows = [_check("force limits", "undeclared: " + ", ".join(missing), len(missing), 0, limits)]
    for what, limit, key, loads in _rows(limits, [p.high for p in peaks]):
        load, worst = max(zip(loads, peaks, strict=True), key=lambda pair: pair[0])
        x, y = worst.at_mm
        where = f"{worst.indenter} at ({x:g}, {y:g}) mm, {worst.depth_mm:g} mm deep"
        unit = "N mm" if key.endswith("range_nmm") else "N"
        text = f"{what} with twice the modulus, {key} ({unit})"
        rows.append(_check("peak force", text, round(load, 1), limit, limits, where))
    return rows if missing else rows[1:]


def _check(
    name: str, what: str, figure: float, bound: float, limits: ForceLimits, where: str = ""
) -> Check:
    over = figure > bound
    return Check(
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


def _over(name: str, peak: Peak, what: str, load: float, limit: str, key: str, source: str) -> str:
    x, y = peak.at_mm
    unit = limit.partition(" ")[2]
    expected = f"expected {'at most ' if peak.reason else ''}{load / MODULUS_FACTOR:.0f}"
    return (
        f"{name}: {peak.indenter} at ({x:g}, {y:g}) mm, {peak.depth_mm:g} mm deep: {what} up to "
        f"{load:.0f} {unit} ({expected}), over {limit} of {key} in {source}"
    )
