"""What the simulated gel cannot compute, reported before a run begins."""

from __future__ import annotations

from ..elasticity.material import GelMaterial
from ..errors import InputError
from ..gel.finite.material import MAX_POISSON
from ..gel.level import Reach
from ..gel.level_selection import linear_refusal
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
    if protocol.weights is not None:
        raise InputError(f"{source}: weights: no hand lays them on a virtual gel")
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
    material = GelMaterial(1.0, specimen.poisson, specimen.friction, specimen.prony)
    key = "specimen.prony" if specimen.prony else "depths_mm"
    for indenter in map(parse_indenter, protocol.indenters):
        reach = Reach(deepest_mm=deepest)
        if why := linear_refusal(level, sensor.skin, material, indenter, reach):
            raise InputError(
                f"{source}: {key}: {why}: the linear level {level!r} stops there; this protocol "
                "needs the level 'hyperelastic'"
            )
