"""What the checks look at: every part's solid, made once, and what was found on it before."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from deltact_fab.common import RunFailed, Store, cache_key

from ..build import build_from, cad_cache_key, part_key
from ..dimensions import Design
from ..features import Round, SolidFeatures, features_of
from ..kernel import Box
from ..mesh import Mesh, mesh_solid
from ..part import Part

# Rays and closure need no finer mesh: what they find is measured again on exact surfaces.
MESH_MM = 0.05

Tell = Callable[[str], None]
CODE = "fabricate.cad.check"
STORE = Store("cad-check", limit_bytes=64 * 2**20)
MOST = 20_000  # facts; a design has some 500


class PartMissing(RunFailed):
    """A part that a check needs could not be built."""


class Facts:
    """Plain data about solids by what they were found on, in the user's cache."""

    def __init__(self) -> None:
        self._facts: dict[str, Any] = STORE.read(cad_cache_key(CODE)) or {}
        self.computed: list[str] = []

    def get_or_compute(self, kind: str, key: Any, compute: Callable[[], Any]) -> Any:
        """What compute() returned for this key before, else returns now. What raises is not kept.

        what: names the fact; key: plain data, everything that it depends on beside the code.
        """
        text = json.dumps(cache_key(what=kind, key=key), sort_keys=True)
        name = hashlib.sha256(text.encode()).hexdigest()
        if name in self._facts:
            # Last again: the longest unused go first.
            value = self._facts.pop(name)
        else:
            value = json.loads(json.dumps(compute()))
            self.computed.append(kind)
        self._facts[name] = value
        return value

    def save(self) -> None:
        """Store what is new for the next time; a folder that refuses costs time and no more."""
        if self.computed:
            newest = dict(list(self._facts.items())[-MOST:])
            STORE.write(cad_cache_key(CODE), newest)


@dataclass
class BuiltDesign:
    """Every part as the checks see it; a solid is made when it is first asked for.

    solids: those that are there already. facts: what earlier checks found, to be used and added
    to; not to be given with solids of another make. tell: called with the name of each part before
    it is built.
    """

    design: Design
    parts: tuple[Part, ...]
    solids: dict[str, Any] = field(default_factory=dict)
    facts: Facts | None = None
    tell: Tell | None = None
    failed: dict[str, str] = field(default_factory=dict)
    meshes: dict[str, Mesh] = field(default_factory=dict)
    results: dict[tuple[str, tuple[str, ...]], Any] = field(default_factory=dict)
    features_of: dict[str, SolidFeatures] = field(default_factory=dict)

    def fact(
        self, kind: str, names: Sequence[str], compute: Callable[[], Any], inputs: Any = None
    ) -> Any:
        """Plain data found on the solids of these parts: what compute() returns, now or earlier.

        given: all that it depends on besides, plain data; of one `what` and `names` always the
        same. Raises what compute() raises.
        """
        label = kind, tuple(names)
        if label not in self.results:
            if self.facts is None:
                self.results[label] = compute()
            else:
                key = [[part_key(self.part(name), self.design) for name in names], inputs]
                self.results[label] = self.facts.get_or_compute(
                    f"{kind}: {', '.join(names)}", key, compute
                )
        return self.results[label]

    def part(self, name: str) -> Part:
        """The part of that name. Raises PartMissing when there is none."""
        for part in self.parts:
            if part.name == name:
                return part
        raise PartMissing(f"{name} could not be built")

    def solid(self, name: str) -> Any:
        """The solid of a part. Raises PartMissing if it cannot be built; `failed` says why."""
        if name not in self.solids and name not in self.failed:
            part = self.part(name)
            if self.tell is not None:
                self.tell(name)
            try:
                self.solids[name] = build_from(part, part.source(self.design))[0]
            except RunFailed as error:
                self.failed[name] = str(error)
        if name in self.failed:
            raise PartMissing(f"{name} could not be built")
        return self.solids[name]

    def mesh(self, name: str) -> Mesh:
        """Its closed mesh within MESH_MM. Raises RunFailed when it does not close."""
        solid = self.solid(name)
        if name not in self.meshes:
            self.meshes[name] = mesh_solid(solid, MESH_MM, name)
        return self.meshes[name]

    def features(self, name: str) -> SolidFeatures:
        """What it is made of."""
        if name not in self.features_of:
            self.features_of[name] = features_of(self.solid(name))
        return self.features_of[name]

    def cylinders(self, name: str) -> list[Round]:
        """Its rounds along z."""

        def compute() -> list[dict[str, Any]]:
            return [asdict(r) for r in self.features(name).rounds if r.axis == 2]

        return [Round(**row) for row in self.fact("cylinders", (name,), compute)]

    def box(self, name: str) -> Box:
        """Its exact bounding box."""

        def compute() -> Box:
            features = self.features(name)
            return features.low_mm, features.high_mm

        low, high = self.fact("box", (name,), compute)
        return tuple(low), tuple(high)
