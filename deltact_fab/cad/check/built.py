"""What the checks look at: every part's solid, made once, its mesh and its box."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ...errors import MissingLibrary, RunFailed
from ..build import build_part
from ..checks import Box, bounding_box
from ..design import IndenterList
from ..dimensions import Design
from ..mesh import Mesh, mesh_solid
from ..part import Part
from ..registry import listed
from .cylinders import Cylinder, along_z
from .rays import Walls

if TYPE_CHECKING:
    from ..assembly import Placed

# Rays and closure need no finer mesh: what they find is measured again on exact surfaces.
MESH_MM = 0.05

Tell = Callable[[str], None]


@dataclass
class Built:
    """Solids by part name; what could not be made is in `failed` with its reason."""

    design: Design
    parts: tuple[Part, ...]
    solids: dict[str, Any]
    failed: dict[str, str] = field(default_factory=dict)
    _meshes: dict[str, Mesh] = field(default_factory=dict)
    _walls: dict[str, Walls] = field(default_factory=dict)
    _cylinders: dict[str, list[Cylinder]] = field(default_factory=dict)
    _placed: list[Placed] | None = None

    @classmethod
    def make(
        cls,
        design: Design,
        solids: Mapping[str, Any] | None = None,
        indenters: IndenterList | None = None,
        tell: Tell | None = None,
    ) -> Built:
        """Build every part that `solids` does not give."""
        given = dict(solids or {})
        built = cls(design, tuple(listed(indenters)), {})
        for part in built.parts:
            if tell is not None:
                tell(part.name)
            if part.name in given:
                built.solids[part.name] = given[part.name]
                continue
            try:
                built.solids[part.name] = build_part(part, design)[0]
            except MissingLibrary:
                raise
            except RunFailed as why:
                built.failed[part.name] = str(why)
        return built

    def replaced(self, solids: Mapping[str, Any]) -> Built:
        """The same with other solids; what is known of the rest is kept."""

        def kept(known: dict[str, Any]) -> dict[str, Any]:
            return {name: value for name, value in known.items() if name not in solids}

        return Built(
            self.design,
            self.parts,
            {**self.solids, **solids},
            kept(self.failed),
            kept(self._meshes),
            kept(self._walls),
            kept(self._cylinders),
        )

    def solid(self, name: str) -> Any:
        """The solid of a part. Raises RunFailed when it could not be built."""
        if name not in self.solids:
            raise RunFailed(f"{name} could not be built")
        return self.solids[name]

    def mesh(self, name: str) -> Mesh:
        """Its closed mesh within MESH_MM. Raises RunFailed when it does not close."""
        if name not in self._meshes:
            self._meshes[name] = mesh_solid(self.solid(name), MESH_MM, name)
        return self._meshes[name]

    def walls(self, name: str) -> Walls:
        """Its walls, sampled."""
        if name not in self._walls:
            self._walls[name] = Walls(self.solid(name), self.mesh(name))
        return self._walls[name]

    def cylinders(self, name: str) -> list[Cylinder]:
        """Its cylindrical faces along z."""
        if name not in self._cylinders:
            self._cylinders[name] = along_z(self.solid(name))
        return self._cylinders[name]

    def box(self, name: str) -> Box:
        """Its exact bounding box."""
        return bounding_box(self.solid(name))

    def placed(self) -> list[Placed]:
        """The sensor's parts in their places. Raises RunFailed when one could not be built."""
        from ..assembly import assemble

        if self._placed is None:
            sensor = {p.name: self.solid(p.name) for p in self.parts if p.group == "sensor"}
            self._placed = assemble(self.design, solids=sensor)
        return self._placed
