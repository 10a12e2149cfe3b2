"""The simulated gel in words: what it cannot compute, before a run; what it solved and left out."""

from __future__ import annotations

from collections.abc import Sequence

from ..elasticity import edge_compliance
from ..elasticity.material import GelMaterial
from ..errors import InputError
from ..gel.finite.material import MAX_POISSON
from ..gel.level import Choice
from ..gel.linear.contact import SMALL_STRAIN
from ..gel.linear.validity import linear_refusal
from ..levels import LINEAR
from ..protocols.plan import Protocol
from ..rig.config import GelConfig
from ..shapes import SensorDimensions, SkinDimensions
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


def gel_left_out(presses: Presses, choices: Sequence[Choice]) -> list[str]:
    """What this scene's gel did not solve or keep, and why."""
    lines = []
    if not presses.observed:
        return ["gel: no channel asks for what it does"]
    if not presses.shears and not any(c.friction for c in choices):
        lines.append("friction: the channel 'shear' is not asked for")
    if presses.level != "hyperelastic":
        lines.append(f"finite-strain gel: the level {presses.level!r} is asked for")
    elif not presses.fields:
        lines.append("the gel's surface field: no channel asks for images")
    if not presses.tractions:
        lines.append("the face's tractions: the channel 'traction' is not asked for")
    if not presses.relaxing_s:
        lines.append("viscosity: the specimen has no Prony series")
    return lines


def gel_notes(presses: Presses, choices: Sequence[Choice], skin: SkinDimensions) -> list[str]:
    """What a reader of a run on the simulated gel must know."""
    opened = presses.opened
    solved = sum(p.solver.solves for p in opened)
    found = sum(len(p.solver.knots) for p in opened if p.solver.found is not None)
    lines = [
        f"{solved} contact problems solved, {found} found in the store (no pattern, camera or "
        "modulus matters to them); between them displacements and forces are interpolated linearly"
    ]
    if presses.level == LINEAR:
        lines.append("the linear gel ignores large strain: tenths of a mm in plane from 2 mm deep")
    lines += dict.fromkeys(f"gel: {choice.why}" for choice in choices)
    if not presses.shears and any(c.friction for c in choices):
        lines.append("friction is solved, for it changes the force of these presses")
    # From the plan, for the presses that a resumed run kept are not solved again.
    limit_mm = SMALL_STRAIN * skin.thickness_mm * (1 + 1e-9)
    if presses.level == LINEAR and max(p.deepest_mm for p in presses.paths) > limit_mm:
        lines.append("WARNING: pressed beyond 10 % of the thickness, past small strain")
    if presses.relaxing_s:
        lines.append(
            "the gel's time is the plan's: lines at their feed, rests as long as they settle; "
            "ramps of the stage and the host's delays, some hundredths of a second, are not in"
        )
    return lines + _flag_notes(presses)


def _flag_notes(presses: Presses) -> list[str]:
    """One line for each kind of flag: where, in how many states, and the last of them in full."""
    where: dict[str, list[str]] = {}
    example: dict[str, str] = {}
    for press in presses.opened:
        for name, count in press.solver.flags.items():
            where.setdefault(name, []).append(f"{count} of {press.name}")
        for flag in (f for knot in press.solver.knots for f in knot.flags):
            example[flag.partition(":")[0]] = flag
    return [
        f"WARNING: {example[name]}; states concerned: {', '.join(found)}"
        for name, found in sorted(where.items())
    ]
