"""What a real rig must have before it presses, and before it is left alone."""

from __future__ import annotations

from ...errors import InputError
from ...protocols.plan import Protocol
from ...shapes import SensorDimensions
from ...shapes.indenter import parse as parse_indenter
from ..config import GrblConfig
from .config import TouchConfig
from .touch import MOST


def unmet(
    config: GrblConfig, protocol: Protocol, sensor: SensorDimensions, unattended: bool
) -> list[str]:
    """Why this rig must not press, or not alone, a line each, to follow the rig file's name.

    Forces that are predicted against what the stage and the sensor bear are `preflight`'s affair.
    """
    force, touch = config.force, config.touch
    lines = []
    if force is None or not force.reachable:
        lines.append(
            "force: a press on a real rig needs a force sensor, for the guard and to find the "
            "face: add [force.netft] or [force.serial], or give --air, and nothing goes below the "
            "clearance plane"
        )
    elif "force" not in protocol.channels:
        lines.append(
            f"channels of {protocol.name!r}: a press on a real rig records the force that its "
            'guard watches: add "force", or give --air'
        )
    if touch is None:
        lines.append(
            "touch: missing table; a press on a real rig needs to know where the face is: add "
            "[touch], or give --air"
        )
    else:
        lines += _outside(touch, protocol, sensor)
        if force is not None:
            lines += _above_the_guard(config, touch)
    if unattended and len(protocol.indenters) > 1:
        lines.append(
            f"--unattended: {protocol.name!r} holds {len(protocol.indenters)} indenters, and "
            "nobody is there to change them: a protocol of one"
        )
    return lines


def undeclared_lengths(config: GrblConfig, protocol: Protocol) -> list[str]:
    """Indenters of unknown length, where there is more than one: what is searched has to do."""
    missing = [name for name in protocol.indenters if name not in config.tools]
    if len(protocol.indenters) < 2 or not missing or config.touch is None:
        return []
    return [
        f'[tools."{missing[0]}"] length_mm is not declared'
        + (f" (nor {len(missing) - 1} more)" if len(missing) > 1 else "")
        + f": its tip is looked for within touch.search_mm = {config.touch.search_mm:g} mm of "
        "where that of the reference is"
    ]


def _outside(touch: TouchConfig, protocol: Protocol, sensor: SensorDimensions) -> list[str]:
    """The place of the touch-off, with the indenter around it, lies on the face."""
    lines = []
    for name in protocol.indenters:
        reach = parse_indenter(name).footprint_half_mm
        for axis, (at, half, most) in enumerate(
            zip(touch.at_mm, reach, sensor.skin.opening_half_mm, strict=True)
        ):
            if abs(at) + half > most:
                lines.append(
                    f"touch.at_mm: {'xy'[axis]} = {at:g} mm: {name} reaches {abs(at) + half:g} mm "
                    f"out there, and the face ends at {most:g}"
                )
    return lines[:1]


def _above_the_guard(config: GrblConfig, touch: TouchConfig) -> list[str]:
    from ..force.guard import GuardLimits

    assert config.force is not None
    try:
        limits = GuardLimits.of(config.guard, config.force)
    except InputError as why:
        return [str(why)]
    least_n = min(*limits.force_n, limits.resultant_n)
    if MOST * touch.force_n < least_n:
        return []
    return [
        f"touch.force_n: {touch.force_n:g} N: a touch-off goes up to {MOST:g} times that, and the "
        f"guard trips at {least_n:g} N"
    ]
