"""Trajectories in the one store, keyed by what they depend on, the solver's code included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any, Literal

from ... import cache
from ...elasticity.material import GelMaterial
from ...levels import FINITE
from ...shapes import Indenter, SkinDimensions
from ..level import Choice
from ..zones import Zones
from .knots import KnotPose, ObservedChannels, SolvedKnot, Trajectory

KIND = "gel-trajectory"
KEEP_BYTES = 8 * 10**9
FIELDS: tuple[Literal["none", "last", "all"], ...] = ("none", "last", "all")
"""Each serves those before it."""


def key_of(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    choice: Choice,
    poses: Sequence[KnotPose],
) -> dict[str, Any]:
    """All that a solved knot depends on but the modulus, with which forces are in proportion.

    A linear grid knows no focus, and no level but that of finite strain parts an increment. Seconds
    matter to a gel that creeps only.
    """
    linear = choice.level != FINITE
    return cache.key(
        f"gel.{'linear' if linear else 'finite'}.gel",
        "gel.path.solver",
        skin=[skin.width_mm, skin.length_mm, skin.thickness_mm],
        poisson=material.poisson,
        friction=choice.friction,
        prony=material.prony,
        indenter=repr(indenter),
        level=choice.level,
        spacing_mm=choice.spacing_mm,
        asked_mm=choice.asked_mm,
        growth=choice.growth,
        mirrors=choice.mirrors,
        focus=None if linear else choice.focus,
        step_mm=None if linear else choice.step_mm,
        poses=[[*p.tip_mm, p.seconds] if material.prony else p.tip_mm for p in poses],
    )


def load(key: dict[str, Any], observed: ObservedChannels, count: int) -> Trajectory | None:
    """A stored trajectory of `count` knots that shows what is observed, or one that ended early.

    None where there is no whole one.
    """
    found = (_load(more, count) for more in serving(key, observed))
    return next((one for one in found if one is not None), None)


def keep(key: dict[str, Any], observed: ObservedChannels, made: Trajectory) -> bool:
    """Store a trajectory; False when the folder refuses. The longest unused make room."""
    knots = [vars(k) | {"zones": vars(k.zones)} for k in made.knots]
    value = {**vars(made), "knots": knots}
    return cache.put(KIND, key | asdict(observed), value, KEEP_BYTES)


def serving(key: dict[str, Any], observed: ObservedChannels) -> Iterator[dict[str, Any]]:
    """Keys of what is asked for, then of those that show more than that."""
    for fields in FIELDS[FIELDS.index(observed.fields) :]:
        for traction in dict.fromkeys((observed.traction, True)):
            yield key | asdict(replace(observed, fields=fields, traction=traction))


def _load(key: dict[str, Any], count: int) -> Trajectory | None:
    held = cache.get(KIND, key)
    if held is None or (len(held["knots"]) != count and held["ended"] is None):
        return None
    for knot in held["knots"]:
        knot["zones"] = Zones(**_tuples(knot["zones"]))
    held["knots"] = tuple(SolvedKnot(**_tuples(knot)) for knot in held["knots"])
    return Trajectory(**_tuples(held))


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    """With tuples again in place of the lists that JSON has."""
    return {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
