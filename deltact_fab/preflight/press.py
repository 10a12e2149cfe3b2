"""Normal force of a press, coarse and on the safe side, for a modulus of 1 MPa.

Each depth gets the first answer that holds:

1. `layer`: the linear bonded layer, down to 25 % of the gel and to where a tip's sides turn
   vertical. Within some per cent of finite strain there, and without the free sides that soften a
   block, so rather high.
2. `hyperelastic`: the finite-strain press on a coarse graded mesh, friction included: at 10 mm it
   doubles the force. A coarse mesh is stiff: 1 to 6 % more force than with half the cell size
   (4dots, ellipsoid), 277 N for sphere:15 at 10 mm where 271 N is the converged figure.
   Where the indenter cuts into the mesh by over a tenth of the depth, the state counts as one of
   that much less depth: the force is then reached earlier. Beyond INSIDE, or with the force
   falling, the mesh has lost the tip and the state is not used.
3. `extrapolated`: from the last depth that could be solved, as F (d/d0)^1.7 (h - d0)/(h - d): a
   sphere's 1.5 and some more, for a layer stiffens, times the thinning of the gel under it; above
   every curve that was solved.
4. `bound`: a flat punch over the whole footprint (`reference.flat_punch_factor`), times h/(h - d);
   also the ceiling of 3.

The depth-force curve of `gel.fit.curve` is not used: it raises where the engine refuses and does
not say how far the indenter is inside the mesh, which is what decides here.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache as once
from pathlib import Path
from typing import Literal

import numpy as np

from .. import cache
from ..errors import DeltactFabError, InputError
from ..gel.material import GelMaterial
from ..shapes import Indenter, SkinDimensions

Level = Literal["layer", "hyperelastic", "extrapolated", "bound"]
Progress = Callable[[int, int, str], None]

KIND = "preflight-press"
CELLS = 6  # over the thickness: 2 mm in the standard gel
FINER = (1.0, 0.7)  # cell sizes tried, of the coarse one
ENOUGH = 0.75  # of the deepest depth: what is missing is then extrapolated by a factor of about 2
STEPS = 12  # increments over the thickness
LAYER_SPACING_MM = 0.25
INSIDE = 0.3  # of the depth; a state with more penetration is not used
NOTICED = 0.1  # of the depth; from here on penetration is taken off the depth
FALL = 0.1  # of the largest force so far; a larger fall means that the mesh has lost the tip
GROWTH = 1.7
STIFFEST_POISSON = 0.499  # force within .5 % of .4999, and the mesh level ends before .5
BOUND_MARGIN = 1.1  # friction under the punch, which its closed form leaves out


@dataclass(frozen=True)
class PressCurve:
    """Normal force of one indenter at one place.

    layer_n: depth to force where the layer answers. points: (depth_mm, force_n) of the mesh, both
    rising. ended: why the mesh stops short of the deepest one, else empty. bound_n_per_mm: of the
    punch, before thinning. Forces for 1 MPa.
    """

    thickness_mm: float
    layer_n: dict[float, float]
    points: tuple[tuple[float, float], ...]
    ended: str
    bound_n_per_mm: float

    def normal_n(self, depth_mm: float) -> tuple[float, Level]:
        """Force at a depth and where it is from."""
        if depth_mm in self.layer_n:
            return self.layer_n[depth_mm], "layer"
        h = self.thickness_mm
        ceiling = self.bound_n_per_mm * depth_mm * h / (h - depth_mm)
        if not self.points:
            return ceiling, "bound"
        d, f = (np.array(column) for column in zip(*self.points, strict=True))
        if depth_mm < d[0]:
            # A force grows faster than the depth, so the chord from touch lies above it.
            return float(f[0] * depth_mm / d[0]), "hyperelastic"
        if depth_mm <= d[-1] * (1 + 1e-9):
            return float(np.exp(np.interp(np.log(depth_mm), np.log(d), np.log(f)))), "hyperelastic"
        grown = grown_n(float(d[-1]), float(f[-1]), depth_mm, h)
        return max(float(f[-1]), min(grown, ceiling)), "extrapolated"


def grown_n(depth_mm: float, force_n: float, deeper_mm: float, thickness_mm: float) -> float:
    """A force carried on to a deeper press, on the safe side."""
    thinning = (thickness_mm - depth_mm) / (thickness_mm - deeper_mm)
    return force_n * (deeper_mm / depth_mm) ** GROWTH * thinning


def press_curve(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    depths_mm: Sequence[float],
    progress: Progress | None = None,
    solve: bool = True,
) -> PressCurve | None:
    """The curve that answers for depths_mm, cached without the modulus.

    solve False: None where the mesh level is needed and not in the cache; the layer takes less
    than a second. Raises InputError for a depth outside of the gel.
    """
    for depth in depths_mm:
        if not 0 < depth < skin.thickness_mm:
            raise InputError(
                f"preflight: a depth above 0 and below the gel's {skin.thickness_mm:g} mm is "
                f"needed: {depth:g} mm fails"
            )
    poisson = min(material.poisson, STIFFEST_POISSON)
    unit = GelMaterial(1.0, poisson, material.friction)
    key = {
        "sides_mm": [skin.width_mm, skin.length_mm, skin.thickness_mm],
        "poisson": poisson,
        "friction": unit.friction,
        "indenter": [[type(t).__name__, asdict(t)] for t in indenter.tips],
        "reach_mm": indenter.reach_mm,
        "at_mm": list(at_mm),
        "depths_mm": sorted(depths_mm),
        "source": _source(),
    }
    held = cache.get(KIND, key)
    if held is None:
        layer = _layer(skin, unit, indenter, at_mm, depths_mm)
        points: list[list[float]] = []
        ended = ""
        if len(layer) < len(set(depths_mm)):
            if not solve:
                return None
            points, ended = _mesh(skin, unit, indenter, at_mm, max(depths_mm), progress)
        held = {"layer": list(map(list, layer.items())), "points": points, "ended": ended}
        cache.put(KIND, key, held)
    return PressCurve(
        skin.thickness_mm,
        dict(held["layer"]),
        tuple((d, f) for d, f in held["points"]),
        held["ended"],
        _punch_n_per_mm(skin, unit, indenter),
    )


def _layer(
    skin: SkinDimensions,
    unit: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    depths_mm: Sequence[float],
) -> dict[float, float]:
    """Forces at those depths that the layer does not refuse."""
    from ..gel.linear.contact import LayerContact
    from ..gel.linear.layer import BondedLayer
    from ..gel.linear.limits import DEPTH_LIMIT

    most = min(DEPTH_LIMIT * skin.thickness_mm, indenter.equator_mm)
    shallow = [d for d in depths_mm if d <= most]
    if not shallow:
        return {}
    layer = BondedLayer.for_skin(skin, unit, spacing_mm=LAYER_SPACING_MM)
    contact = LayerContact(layer, indenter, observe_shear=False)
    found = {}
    for depth in shallow:
        try:
            state = contact.solve(contact.rest((*at_mm, 0.0)), (*at_mm, depth))
        except DeltactFabError:
            continue  # the mesh answers for it
        found[depth] = -state.force_n[2]
    return found


def _mesh(
    skin: SkinDimensions,
    unit: GelMaterial,
    indenter: Indenter,
    at_mm: tuple[float, float],
    deepest_mm: float,
    progress: Progress | None,
) -> tuple[list[list[float]], str]:
    """Usable points [depth, force] of the finite-strain press, and why they end early.

    Where the coarse mesh ends before ENOUGH of the deepest one, a finer one is tried as well.
    """
    h = skin.thickness_mm
    spacing = min(max(h / CELLS, max(indenter.footprint_half_mm) / 5), h / 2)
    best: tuple[list[list[float]], str] = [], ""
    for share in FINER:
        found = _attempt(skin, unit, indenter, at_mm, deepest_mm, share * spacing, progress)
        if not best[0] or (found[0] and found[0][-1][0] > best[0][-1][0]):
            best = found
        if best[0] and best[0][-1][0] >= ENOUGH * deepest_mm:
            break
    return best


def _attempt(
    skin: SkinDimensions, unit: GelMaterial, indenter: Indenter, at_mm: tuple[float, float],
    deepest_mm: float, spacing_mm: float, progress: Progress | None,
) -> tuple[list[list[float]], str]:  # fmt: skip
    from ..gel.finite import FinitePress, block_mesh

    h = skin.thickness_mm
    half_x, half_y = (half + spacing_mm for half in indenter.footprint_half_mm)
    x, y = at_mm
    step = h / STEPS
    depths = [*np.arange(step, deepest_mm - 1e-6 * h, step).tolist(), deepest_mm]
    points: list[list[float]] = []
    ended = ""
    try:
        mesh = block_mesh(skin, spacing_mm, (x - half_x, x + half_x, y - half_y, y + half_y))
        press = FinitePress(mesh, unit, indenter, tolerance=1e-5)
    except DeltactFabError as why:
        return points, str(why)
    state = press.rest((x, y, 0.0))
    for k, depth in enumerate(depths):
        if progress:
            progress(k, len(depths), f"{indenter.name} to {depth:.3g} mm")
        try:
            state = press.solve(state, (x, y, depth))
        except DeltactFabError as why:
            ended = str(why)
            if points:
                break
            # Too shallow for the mesh to see a sharp tip: from rest to the next depth at once.
            continue
        ended = _add(points, depth, -state.force_n[2], state.diagnostics.penetration_mm)
    return points, ended


def _add(points: list[list[float]], depth: float, force: float, inside_mm: float) -> str:
    """Append a state if it can be used; else, or where it counts as a shallower one, say why."""
    best = points[-1][1] if points else 0.0
    if inside_mm > INSIDE * depth:
        return f"at {depth:g} mm the indenter is {inside_mm:.2g} mm inside the coarse mesh"
    if not force > (1 - FALL) * best:
        return f"at {depth:g} mm the force on the coarse mesh falls"
    counted, why = depth, ""
    if inside_mm > NOTICED * depth:
        counted = depth - inside_mm
        why = f"at {depth:g} mm the indenter is {inside_mm:.2g} mm inside the coarse mesh"
    while points and points[-1][0] >= counted:
        points.pop()
    points.append([counted, max(best, force)])
    return why


def _punch_n_per_mm(skin: SkinDimensions, unit: GelMaterial, indenter: Indenter) -> float:
    """Stiffness of a flat punch around all of the indenter on the bonded layer."""
    from ..gel.reference import flat_punch_factor

    radius = max(math.hypot(t.x_mm, t.y_mm) + max(t.half_mm) for t in indenter.tips)
    kappa = flat_punch_factor(radius / skin.thickness_mm, unit.poisson)
    stiffness = 4 * unit.shear_modulus_mpa * radius * kappa / (1 - unit.poisson)
    return BOUND_MARGIN * stiffness


@once
def _source() -> str:
    """Digest of the texts that a curve's numbers come from."""
    package = Path(__file__).parent.parent
    text = hashlib.sha256(Path(__file__).read_bytes())
    for folder in ("gel", "shapes"):
        for path in sorted((package / folder).rglob("*.py")):
            text.update(path.name.encode() + b"\0" + path.read_bytes())
    return text.hexdigest()
