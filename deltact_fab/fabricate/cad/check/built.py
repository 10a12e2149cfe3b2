"""Solids of all parts for the checks, built once, with cached results of earlier checks."""

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
from ..kernel import Extent
from ..mesh import Mesh, mesh_solid
from ..part import Part
from .row import PAPER_BASES, Bases

# By hand: coarse is enough, since rays are measured again on exact surfaces; finer costs time.
CHECK_MESH_MM = 0.05

Reporter = Callable[[str], None]
CHECK_MODULE = "fabricate.cad.check"
FACT_STORE = Store("cad-check", limit_bytes=64 * 2**20)
MAX_FACTS = 20_000  # by hand, some 40 designs of 500 facts each; more makes the file slow to read


class PartMissing(RunFailed):
    """A part that a check needs could not be built."""


class Facts:
    """Results about solids as plain data by their inputs, in the user's cache."""

    def __init__(self) -> None:
        self._facts: dict[str, Any] = FACT_STORE.read(cad_cache_key(CHECK_MODULE)) or {}
        self.computed: list[str] = []

    def get_or_compute(self, kind: str, key: Any, compute: Callable[[], Any]) -> Any:
        """Return the cached result for this key, or that of compute(); exceptions are not cached.

        kind: name of the fact; key: plain data, all inputs apart from the code.
        """
        text = json.dumps(cache_key(what=kind, key=key), sort_keys=True)
        name = hashlib.sha256(text.encode()).hexdigest()
        if name in self._facts:
            # Moved to the end: the least recently used are dropped first.
            value = self._facts.pop(name)
        else:
            value = json.loads(json.dumps(compute()))
            self.computed.append(kind)
        self._facts[name] = value
        return value

    def save(self) -> None:
        """Store new results; an unwritable cache folder is ignored."""
        if self.computed:
            newest = dict(list(self._facts.items())[-MAX_FACTS:])
            FACT_STORE.write(cad_cache_key(CHECK_MODULE), newest)


@dataclass
class BuiltDesign:
    """All parts of a design for the checks; a solid is built on first access.

    solids: ready solids by part name. facts: cache of results to use and extend; None with solids
    that were not built from this design. bases: as in `reference_designs`. report: called with the
    name of each part before it is built.
    """

    design: Design
    parts: tuple[Part, ...]
    solids: dict[str, Any] = field(default_factory=dict)
    facts: Facts | None = None
    report: Reporter | None = None
    bases: Bases = PAPER_BASES
    failures: dict[str, str] = field(default_factory=dict)
    meshes: dict[str, Mesh] = field(default_factory=dict)
    results: dict[tuple[str, tuple[str, ...]], Any] = field(default_factory=dict)
    features_of: dict[str, SolidFeatures] = field(default_factory=dict)

    def fact(
        self, kind: str, names: Sequence[str], compute: Callable[[], Any], inputs: Any = None
    ) -> Any:
        """Return the result of compute() on the solids of these parts, cached if possible.

        inputs: further inputs as plain data, always the same for one `kind` and `names`. Raises
        what compute() raises.
        """
        label = kind, tuple(names)
        if label not in self.results:
            if self.facts is None:
                self.results[label] = compute()
            else:
                key = [[part_key(self.part(name), self.design) for name in names], inputs]
                name = f"{kind}: {', '.join(names)}"
                self.results[label] = self.facts.get_or_compute(name, key, compute)
        return self.results[label]

    def part(self, name: str) -> Part:
        """Return the part of that name. Raises PartMissing if there is none."""
        for part in self.parts:
            if part.name == name:
                return part
        raise PartMissing(f"{name} could not be built")

    def solid(self, name: str) -> Any:
        """Return the solid of a part. Raises PartMissing if it cannot be built, see `failures`."""
        if name not in self.solids and name not in self.failures:
            part = self.part(name)
            if self.report is not None:
                self.report(name)
            try:
                self.solids[name] = build_from(part, part.source(self.design))[0]
            except RunFailed as error:
                self.failures[name] = str(error)
        if name in self.failures:
            raise PartMissing(f"{name} could not be built")
        return self.solids[name]

    def mesh(self, name: str) -> Mesh:
        """Return a part's closed mesh within CHECK_MESH_MM. Raises RunFailed if it is open."""
        solid = self.solid(name)
        if name not in self.meshes:
            self.meshes[name] = mesh_solid(solid, CHECK_MESH_MM, name)
        return self.meshes[name]

    def features(self, name: str) -> SolidFeatures:
        """Return the features of a part's solid."""
        if name not in self.features_of:
            self.features_of[name] = features_of(self.solid(name))
        return self.features_of[name]

    def cylinders(self, name: str) -> list[Round]:
        """Return the cylindrical features of a part along z."""

        def compute() -> list[dict[str, Any]]:
            return [asdict(r) for r in self.features(name).rounds if r.axis == 2]

        return [Round(**row) for row in self.fact("cylinders", (name,), compute)]

    def box(self, name: str) -> Extent:
        """Return the exact bounding box of a part."""

        def compute() -> Extent:
            features = self.features(name)
            return features.low_mm, features.high_mm

        low, high = self.fact("box", (name,), compute)
        return tuple(low), tuple(high)
