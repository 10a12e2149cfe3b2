"""What the checks look at: every part's solid, made once, its mesh and its box."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...errors import RunFailed
from ..build import build_from
from ..design import IndenterList
from ..dimensions import Design
from ..features import Round, SolidFeatures, features_of
from ..mesh import Mesh, mesh_solid
from ..part import Part
from ..rays import Walls
from ..registry import listed
from ..solid_gate import Box, bounding_box
from .memo import Known
from .row import Row, from_plain, to_plain

# Rays and closure need no finer mesh: what they find is measured again on exact surfaces.
MESH_MM = 0.05

NO_PART = "could not be built"
Tell = Callable[[str], None]


@dataclass
class BuiltDesign:
    """Every part as the checks see it; a solid is made when it is first asked for.

    design: notes what is read from it (memo.py), and so do `parts` and everything that gives a
    solid or what was found on one. every: all parts. _solids: those that are there already.
    """

    design: Design
    every: tuple[Part, ...]
    _solids: dict[str, Any]
    _failed: dict[str, str] = field(default_factory=dict)
    _meshes: dict[str, Mesh] = field(default_factory=dict)
    _walls: dict[str, Walls] = field(default_factory=dict)
    _features: dict[str, SolidFeatures] = field(default_factory=dict)
    # What was read to make a part, which whoever uses it depends on as well.
    _reads: dict[str, dict[str, Any]] = field(default_factory=dict)
    known: Known | None = None
    tell: Tell | None = None

    def __post_init__(self) -> None:
        if self.known is None:
            self.known = Known(self.design, self.every)
        self.design = self.known.design

    @classmethod
    def make(
        cls,
        design: Design,
        solids: Mapping[str, Any] | None = None,
        indenters: IndenterList | None = None,
        tell: Tell | None = None,
        kept: bool = False,
    ) -> BuiltDesign:
        """The parts of a design and of a list of indenters; `solids` replace what would be built.

        tell: called with the name of each part before it is built. kept: results of earlier
        checks are used and stored, unless `solids` are given.
        """
        every = tuple(listed(indenters))
        known = Known(design, every, kept and not solids)
        return cls(design, every, dict(solids or {}), known=known, tell=tell)

    def replaced(self, solids: Mapping[str, Any]) -> BuiltDesign:
        """The same with other solids; what is known of the rest is kept."""

        def kept(known: dict[str, Any]) -> dict[str, Any]:
            return {name: value for name, value in known.items() if name not in solids}

        return BuiltDesign(
            self.design,
            self.every,
            {**self._solids, **solids},
            kept(self._failed),
            kept(self._meshes),
            kept(self._walls),
            kept(self._features),
            _reads=kept(self._reads),
        )

    @property
    def parts(self) -> tuple[Part, ...]:
        """Every part; a check that asks runs again when the list changes."""
        return self._known.parts

    @property
    def solids(self) -> dict[str, Any]:
        """Every solid that can be built, by the part's name."""
        return {p.name: self._solids[p.name] for p in self.every if not self.why_not(p.name)}

    @property
    def failed(self) -> dict[str, str]:
        """What could not be built, with its reason."""
        return {p.name: why for p in self.every if (why := self.why_not(p.name))}

    @property
    def _known(self) -> Known:
        assert self.known is not None
        return self.known

    def source(self, part: Part) -> Any:
        """What a part is made from, its reads noted."""
        return self._known.source(part)

    def result(self, name: str, compute: Callable[[], Any]) -> Any:
        """Plain data that is kept by itself: see Known.result."""
        return self._known.result(name, compute)

    def rows(self, name: str, compute: Callable[[], Iterable[Row]]) -> list[Row]:
        """The rows that compute() yields, kept likewise."""
        return from_plain(self.result(name, lambda: to_plain(compute())))

    def why_not(self, name: str) -> str:
        """Why a part cannot be built; empty when it can."""
        if name not in self._solids and name not in self._failed:
            self._build(name)
        self._known.repeat(self._reads.get(name, {}))
        if name in self._failed:
            self._known.spoil()
        return self._failed.get(name, "")

    def _build(self, name: str) -> None:
        part = next((p for p in self.every if p.name == name), None)
        if part is None:
            raise RunFailed(f"{name} {NO_PART}")
        if self.tell is not None:
            self.tell(name)
        with self._known.noting() as frame:
            try:
                self._solids[name] = build_from(part, self.source(part))[0]
            except RunFailed as why:
                self._failed[name] = str(why)
        self._reads[name] = frame[0] or {}

    def solid(self, name: str) -> Any:
        """The solid of a part. Raises RunFailed when it could not be built."""
        if self.why_not(name):
            raise RunFailed(f"{name} {NO_PART}")
        return self._solids[name]

    def mesh(self, name: str) -> Mesh:
        """Its closed mesh within MESH_MM. Raises RunFailed when it does not close."""
        solid = self.solid(name)
        if name not in self._meshes:
            self._meshes[name] = mesh_solid(solid, MESH_MM, name)
        return self._meshes[name]

    def walls(self, name: str) -> Walls:
        """Its walls, sampled."""
        solid, mesh = self.solid(name), self.mesh(name)
        if name not in self._walls:
            self._walls[name] = Walls(solid, mesh)
        return self._walls[name]

    def features(self, name: str) -> SolidFeatures:
        """What it is made of."""
        solid = self.solid(name)
        if name not in self._features:
            self._features[name] = features_of(solid)
        return self._features[name]

    def cylinders(self, name: str) -> list[Round]:
        """Its rounds along z."""
        return [r for r in self.features(name).rounds if r.axis == 2]

    def box(self, name: str) -> Box:
        """Its exact bounding box."""
        return bounding_box(self.solid(name))
