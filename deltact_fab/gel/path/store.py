"""Trajectories in the one store, keyed by what they depend on, the solver's code included."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from typing import Any, Literal

import numpy as np

from ... import cache, digest
from ...aliases import Field, Point
from ...elasticity.material import GelMaterial
from ...shapes import Indenter, SkinDimensions
from ..level import Choice
from .knots import InterpolationError, KnotPose, ObservedChannels, SolvedKnot, Trajectory

KIND = "gel-trajectory"
KEEP_BYTES = 8 * 10**9
FIELDS: tuple[Literal["none", "last", "all"], ...] = ("none", "last", "all")
"""Each serves those before it."""
NUMBERS = 11  # of a knot: force, torque, area, penetration, stretch, cuts, what it lacks


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
    linear = choice.level != "hyperelastic"
    return {
        "code": digest.of(f"gel.{'linear' if linear else 'finite'}.gel", "gel.path.solver"),
        "skin": [skin.width_mm, skin.length_mm, skin.thickness_mm],
        "poisson": material.poisson,
        "friction": choice.friction,
        "prony": [list(pair) for pair in material.prony],
        "indenter": repr(indenter),
        "level": choice.level,
        "spacing_mm": choice.spacing_mm,
        "asked_mm": choice.asked_mm,
        "growth": choice.growth,
        "mirrors": list(choice.mirrors),
        "focus": None if linear else list(choice.focus),
        "step_mm": None if linear else choice.step_mm,
        "poses": [[*p.tip_mm, p.seconds] if material.prony else list(p.tip_mm) for p in poses],
    }


def load(key: dict[str, Any], observed: ObservedChannels, count: int) -> Trajectory | None:
    """A stored trajectory of `count` knots that shows what is observed, or one that ended early.

    None where there is no whole one.
    """
    for more in _serving(observed):
        found = _load(key | asdict(more), count)
        if found is not None:
            return found
    return None


def keep(key: dict[str, Any], observed: ObservedChannels, made: Trajectory) -> bool:
    """Store a trajectory; False when the folder refuses. The longest unused make room."""
    numbers = [
        (*k.force_n, *k.torque_nmm, k.contact_area_mm2, k.penetration_mm,
         np.nan if k.most_stretch is None else k.most_stretch, k.cuts, k.lacking_rel)
        for k in made.knots
    ]  # fmt: skip
    arrays: dict[str, Any] = {
        "numbers": np.array(numbers, dtype=np.float64).reshape(-1, NUMBERS),
        "x_mm": made.x_mm,
        "y_mm": made.y_mm,
    }
    for name in ("displacement_mm", "traction_mpa"):
        fields = [getattr(k, name) for k in made.knots]
        some = [n for n, field in enumerate(fields) if field is not None]
        if some:
            arrays[name] = np.stack([fields[n] for n in some])
            arrays[f"{name}_of"] = np.array(some)
    packed = io.BytesIO()
    np.savez(packed, **arrays)
    note = {
        "flags": [list(k.flags) for k in made.knots],
        "between": asdict(made.between),
        "seconds": made.seconds,
        "dofs": made.dofs,
        "ended": None if made.ended is None else list(made.ended),
    }
    stored = cache.put_file(KIND, key | asdict(observed), packed.getvalue(), note)
    cache.trim(KIND, KEEP_BYTES)
    return stored


def _serving(observed: ObservedChannels) -> Iterator[ObservedChannels]:
    """What is asked for, then those that show more than that."""
    for fields in FIELDS[FIELDS.index(observed.fields) :]:
        for traction in dict.fromkeys((observed.traction, True)):
            for between in dict.fromkeys((observed.between, True)):
                yield replace(observed, fields=fields, traction=traction, between=between)


def _load(key: dict[str, Any], count: int) -> Trajectory | None:
    found = cache.get_file(KIND, key)
    if found is None:
        return None
    data, note = found
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as held:
            numbers = held["numbers"]
            shown: list[dict[str, Any]] = [{} for _ in numbers]
            for name in ("displacement_mm", "traction_mpa"):
                if name in held:
                    for n, field in zip(held[f"{name}_of"], held[name], strict=True):
                        shown[n][name] = field
            x_mm, y_mm = held["x_mm"], held["y_mm"]
        knots = tuple(
            _knot(n, flags, fields)
            for n, flags, fields in zip(numbers, note["flags"], shown, strict=True)
        )
        kind, why = note["ended"] or ("", "")
        made = Trajectory(
            knots, x_mm, y_mm, InterpolationError(**note["between"]), float(note["seconds"]),
            int(note["dofs"]), (kind, why) if kind else None,
        )  # fmt: skip
    except (ValueError, KeyError, TypeError, IndexError, zipfile.BadZipFile):
        return None
    return made if len(knots) == count or made.ended is not None else None


def _knot(numbers: Field, flags: Sequence[str], fields: dict[str, Any]) -> SolvedKnot:
    stretch = float(numbers[8])
    return SolvedKnot(
        _point(numbers[:3]),
        _point(numbers[3:6]),
        float(numbers[6]),
        fields.get("displacement_mm"),
        tuple(flags),
        fields.get("traction_mpa"),
        float(numbers[7]),
        None if np.isnan(stretch) else stretch,
        int(numbers[9]),
        float(numbers[10]),
    )


def _point(values: Sequence[float] | Field) -> Point:
    x, y, z = (float(v) for v in values)
    return x, y, z
