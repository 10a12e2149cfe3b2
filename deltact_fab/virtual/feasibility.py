"""What the simulated gel cannot compute, reported before a run begins."""

from __future__ import annotations

from ..elasticity import edge_compliance
from ..elasticity.material import GelMaterial
from ..errors import InputError
from ..gel.finite.material import MAX_POISSON
from ..gel.linear.validity import linear_refusal
from ..levels import LINEAR
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
    most = edge_compliance.MAX_POISSON if level == LINEAR else MAX_POISSON
    if specimen.poisson > most:
        raise InputError(
            f"{source}: specimen.poisson: {specimen.poisson} is over {most}: the level {level!r} "
            "stops there; .499 serves"
        )
    if level != LINEAR:
        return
    material = GelMaterial(1.0, specimen.poisson, specimen.friction, specimen.prony)
    key = "specimen.prony" if specimen.prony else "depths_mm"
    for indenter in map(parse_indenter, protocol.indenters):
        if why := linear_refusal(sensor.skin, material, indenter, deepest):
            raise InputError(
                f"{source}: {key}: {why}: the level {level!r} stops there; this protocol needs the "
                "level 'hyperelastic'"
            )
