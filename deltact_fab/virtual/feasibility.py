"""What the simulated gel cannot compute, reported before a run begins."""

from __future__ import annotations

from ..errors import InputError
from ..gel.finite.material import MAX_POISSON
from ..gel.linear.validity import DEPTH_LIMIT
from ..protocols.plan import Protocol
from ..rig.simulator import GelConfig
from ..shapes import SensorDimensions
from ..shapes.indenter import parse as parse_indenter
from .presses import Presses


def unanswered(
    protocol: Protocol, sensor: SensorDimensions, config: GelConfig, source: str
) -> list[str]:
    """Why presses cannot be simulated, a line each; a level that cannot is one line for all."""
    try:
        require_gel_level(protocol, sensor, source)
        presses = Presses(protocol, sensor.skin, config)
    except InputError as why:
        return [str(why)]
    if not presses.observed:
        return []
    reasons = []
    for path in presses.paths:
        try:
            presses.choice(path)
        except InputError as why:
            reasons.append(f"{source}: press {path.press}: {why}")
    return reasons


def require_gel_level(protocol: Protocol, sensor: SensorDimensions, source: str) -> None:
    """Refuse what the protocol's gel level cannot answer for. Raises InputError."""
    specimen = protocol.specimen
    level, thickness_mm = specimen.gel_model, sensor.skin.thickness_mm
    deepest = max(protocol.depths_mm)
    if deepest >= thickness_mm:
        raise InputError(
            f"{source}: depths_mm: {deepest:g} mm is not less than the gel's thickness of "
            f"{thickness_mm:g} mm: no level of the gel can be pressed that deep"
        )
    if level == "hyperelastic":
        if specimen.poisson > MAX_POISSON:
            raise InputError(
                f"{source}: specimen.poisson: {specimen.poisson} is over {MAX_POISSON}: the level "
                "'hyperelastic' stops there; .499 serves, and only the level 'layer' takes .5"
            )
        return
    if specimen.prony:
        raise InputError(
            f"{source}: specimen.prony: the linear level {level!r} knows no time; "
            "this protocol needs the level 'hyperelastic'"
        )
    limit_mm = DEPTH_LIMIT * thickness_mm
    if deepest > limit_mm:
        raise InputError(
            f"{source}: depths_mm: {deepest:g} mm is over {limit_mm:g} mm, 25 % of the gel: the "
            f"linear level {level!r} stops there; this protocol needs the level 'hyperelastic'"
        )
    for indenter in map(parse_indenter, protocol.indenters):
        if deepest >= indenter.equator_mm:
            raise InputError(
                f"{source}: depths_mm: {deepest:g} mm presses {indenter.name} to where its sides "
                f"turn vertical, at {indenter.equator_mm:g} mm: the level {level!r} reaches below "
                "that; this protocol needs the level 'hyperelastic'"
            )
