"""A design with other solids in it; what is known of the rest is kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from deltact_fab.cad.check.built import BuiltDesign


def mutated(built: BuiltDesign, solids: Mapping[str, Any]) -> BuiltDesign:
    """The same with other solids; it looks for nothing in the user's cache."""
    return replace(
        built,
        facts=None,
        solids={**built.solids, **solids},
        meshes={name: mesh for name, mesh in built.meshes.items() if name not in solids},
        found={key: found for key, found in built.found.items() if not {*key[1]} & {*solids}},
        features_of={n: seen for n, seen in built.features_of.items() if n not in solids},
    )
