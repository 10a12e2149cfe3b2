"""Force against depth of one indenter, solved once at finite strain and kept for every modulus.

With Poisson's ratio and friction fixed, all stresses of a neo-Hookean gel scale with its modulus:
the curve is stored for 1 MPa. Between solved depths `power_law` interpolates. Below the depth at
which the contact is some cells wide, the bonded layer's force is taken, times a factor that goes
from 1 at touch to the first solved ratio as sqrt(d): what free sides and finite strain change
grows with the contact's radius.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache as once
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import cache
from ...errors import InputError
from ...shapes import Indenter, SkinDimensions
from ..finite import FinitePress, FiniteState, HexMesh, block_mesh
from ..material import GelMaterial
from .power_law import PowerLaw, evaluated, interpolant, left_out
from .shallow import layer_forces, seen_from_mm, widest_mm

Field = NDArray[np.float64]
Point2 = tuple[float, float]
Progress = Callable[[int, int, str], None]

KIND = "gel-curve"
STEP_MM = 0.5
DEEPEST = 0.95  # of the thickness
SPAN = 0.2  # cell size over the radius of the largest ball's footprint on the tips
ACROSS = 12  # most cells across the indenter by default
LAYER_DEPTH = 0.25  # of the thickness: deepest use of the layer


@dataclass(frozen=True, eq=False)
class ForceCurve:
    """Forces on the sensor along one press and, after it, one drag at the deepest point.

    depth_mm (n,) rising from 0, force_n (n, 3) at `modulus_mpa`. shear_mm (m, 2),
    shear_force_n (m, 3): the drag; empty without one. solved_from_mm: below this depth the layer
    was used. interpolation_rel: largest change of the normal force at a solved depth when that
    depth is left out, an upper bound of the error between solved depths.
    """

    depth_mm: Field
    force_n: Field
    shear_mm: Field
    shear_force_n: Field
    modulus_mpa: float
    poisson: float
    friction: float
    spacing_mm: float
    solved_from_mm: float
    interpolation_rel: float

    def normal_n(self, depth_mm: Field) -> Field:
        """-Fz (n,) at depths (n,); 0 out of contact. InputError beyond the last solved depth."""
        return self._evaluate(depth_mm)[0]

    def slope_n_per_mm(self, depth_mm: Field) -> Field:
        """d(-Fz)/d(depth), shape of depth_mm; 0 out of contact."""
        return self._evaluate(depth_mm)[1]

    def scaled(self, modulus_mpa: float) -> ForceCurve:
        """The same curve for another modulus: forces in proportion."""
        ratio = modulus_mpa / self.modulus_mpa
        return replace(
            self,
            force_n=self.force_n * ratio,
            shear_force_n=self.shear_force_n * ratio,
            modulus_mpa=modulus_mpa,
        )

    def _evaluate(self, depth_mm: Field) -> tuple[Field, Field]:
        d = np.asarray(depth_mm, dtype=np.float64)
        last = float(self.depth_mm[-1])
        if d.size and float(d.max()) > last * (1 + 1e-9):
            raise InputError(f"force curve: depth {float(d.max()):g} mm is past its end, {last:g}")
        return evaluated(self._power_law, np.clip(d, 0, last))

    @cached_property
    def _power_law(self) -> PowerLaw:
        return interpolant(self.depth_mm[1:], -self.force_n[1:, 2])


def force_curve(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    at_mm: Point2,
    deepest_mm: float,
    *,
    shear_mm: Point2 = (0.0, 0.0),
    spacing_mm: float | None = None,
    step_mm: float | None = None,
    progress: Progress | None = None,
) -> ForceCurve:
    """The press at at_mm to deepest_mm, then the drag by shear_mm; cached without the modulus.

    spacing_mm: cells below the indenter; None: `default_spacing_mm`. step_mm: between solved
    depths; None: STEP_MM, less in a thin gel. Solved depths are multiples of it, so the last one
    may lie up to a step deeper. A series in `material.prony` is left out: a slow press.
    Raises InputError for values out of range, and what the engine raises.
    """
    thickness = skin.thickness_mm
    step = min(STEP_MM, thickness / 24) if step_mm is None else step_mm
    if not (math.isfinite(step) and 0 < step <= thickness / 4):
        raise InputError(f"force curve: 0 < step_mm <= {thickness / 4:g}: {step} fails")
    if not (math.isfinite(deepest_mm) and 0 < deepest_mm <= DEEPEST * thickness):
        raise InputError(
            f"force curve: a depth above 0 and up to {DEEPEST * thickness:g} mm, {DEEPEST:.0%} of "
            f"the gel's thickness, is needed: {deepest_mm:g} mm fails"
        )
    h = default_spacing_mm(skin, indenter) if spacing_mm is None else spacing_mm
    unit = GelMaterial(1.0, material.poisson, material.friction)
    key = _key(skin, unit, indenter, h) | {"at_mm": list(at_mm), "step_mm": step}
    first, light = _start(skin, unit, indenter, at_mm, h, step, key)
    # A second solved depth gives the slope at the first, which shallow data lean on.
    last = max(first + 1, math.ceil(deepest_mm / step - 1e-9))
    limit = math.floor(DEEPEST * thickness / step + 1e-9)
    last = min(last, limit)
    depths = [step * k for k in range(first, last + 1)]
    if deepest_mm > depths[-1] * (1 + 1e-9):
        depths.append(deepest_mm)
    tips = np.array([(*at_mm, d) for d in depths])
    forces = _pressed(skin, unit, indenter, h, step, tips, key, progress)
    drag, dragged = np.empty((0, 2)), np.empty((0, 3))
    if shear_mm != (0.0, 0.0):
        count = max(1, math.ceil(math.hypot(*shear_mm) / step))
        drag = np.linspace(0.0, 1.0, count + 1)[1:, None] * np.array(shear_mm)
        way = np.column_stack([np.array(at_mm) + drag, np.full(count, deepest_mm)])
        start = np.array([(*at_mm, 0.0), (*at_mm, deepest_mm)])
        whole = force_path(
            skin, unit, indenter, np.vstack([start, way]), spacing_mm=h, progress=progress
        )
        dragged = whole[2:]
    shallow, small = np.empty(0), np.empty((0, 3))
    if light:
        shallow, n, layer_n = np.array(light[0]), np.array(light[1]), light[2]
        grows = 1 + (-forces[0, 2] / layer_n - 1) * np.sqrt(shallow / depths[0])
        small = (n * grows)[:, None] * (forces[0] / -forces[0, 2])
    depth = np.concatenate([[0.0], shallow, depths])
    force = np.concatenate([np.zeros((1, 3)), small, forces])
    curve = ForceCurve(
        depth, force, drag, dragged, 1.0, unit.poisson, unit.friction, h, depths[0],
        left_out(depth[1:], -force[1:, 2]),
    )  # fmt: skip
    return curve.scaled(material.modulus_mpa)


def force_path(
    skin: SkinDimensions,
    material: GelMaterial,
    indenter: Indenter,
    tips_mm: Field,
    *,
    spacing_mm: float | None = None,
    step_mm: float = STEP_MM,
    progress: Progress | None = None,
) -> Field:
    """Force on the sensor (n, 3) at tips (n, 3) = (x, y, depth) met one after the other.

    Friction remembers the way, so all of it is solved, in increments of at most step_mm; cached as
    a whole, without the modulus. Raises what the engine raises.
    """
    tips = np.asarray(tips_mm, dtype=np.float64)
    h = default_spacing_mm(skin, indenter) if spacing_mm is None else spacing_mm
    unit = GelMaterial(1.0, material.poisson, material.friction)
    key = _key(skin, unit, indenter, h) | {"tips_mm": tips.tolist(), "step_mm": step_mm}
    held = cache.get(KIND, key)
    if held is None:
        press = FinitePress(_mesh(skin, indenter, tips, h), unit, indenter)
        held, state = [], press.rest(_tip(tips[0]))
        for k, tip in enumerate(tips):
            if progress:
                progress(k, len(tips), f"{indenter.name}, friction {unit.friction:g}")
            state = _followed(press, state, _tip(tip), step_mm)
            held.append(list(state.force_n))
        cache.put(KIND, key, held)
    return np.array(held, dtype=np.float64).reshape(-1, 3) * material.modulus_mpa


def default_spacing_mm(skin: SkinDimensions, indenter: Indenter) -> float:
    """A fifth of the widest ball's radius in the footprint, within what cells and gel allow."""
    h = SPAN * widest_mm(indenter, math.inf)
    h = max(h, 2 * max(indenter.footprint_half_mm) / ACROSS)
    return float(f"{min(max(h, 0.4), 2.0, skin.thickness_mm / 4):.3g}")


def _pressed(
    skin: SkinDimensions, unit: GelMaterial, indenter: Indenter, h: float, step: float,
    tips: Field, key: dict[str, Any], progress: Progress | None,
) -> Field:  # fmt: skip
    """Forces (n, 3) on the way in; a longer press in the cache serves a shorter one."""
    depths = [float(d) for d in tips[:, 2]]
    held = cache.get(KIND, key) or []
    known: dict[float, Any] = dict(held)
    if all(d in known for d in depths):
        return np.array([known[d] for d in depths])
    press = FinitePress(_mesh(skin, indenter, tips, h), unit, indenter)
    found: list[Any] = []
    state = press.rest((*_tip(tips[0])[:2], 0.0))
    try:
        for k, tip in enumerate(tips):
            if progress:
                progress(k, len(tips), f"{indenter.name}, friction {unit.friction:g}")
            state = _followed(press, state, _tip(tip), step)
            found.append([depths[k], list(state.force_n)])
    finally:
        # What was solved before a refusal or an interruption stays, unless more is known.
        if len(found) > len(held):
            cache.put(KIND, key, found)
    return np.array([f for _, f in found])


def _followed(
    press: FinitePress, state: FiniteState, tip: tuple[float, float, float], step: float
) -> FiniteState:
    for here in press.path(state, tip, step):
        state = here
    return state


def _mesh(skin: SkinDimensions, indenter: Indenter, tips_mm: Field, h: float) -> HexMesh:
    """Fine below the indenter's footprint, wherever it goes."""
    half_x, half_y = indenter.footprint_half_mm
    x, y = tips_mm[:, 0], tips_mm[:, 1]
    focus = (
        float(x.min()) - half_x, float(x.max()) + half_x,
        float(y.min()) - half_y, float(y.max()) + half_y,
    )  # fmt: skip
    return block_mesh(skin, h, focus)


def _start(
    skin: SkinDimensions, unit: GelMaterial, indenter: Indenter, at_mm: Point2, h: float,
    step: float, key: dict[str, Any],
) -> tuple[int, list[Any]]:  # fmt: skip
    """Number of steps to the first solved depth, and the layer's numbers above it."""
    key = key | {"part": "start"}
    held = cache.get(KIND, key)
    if held is None:
        reach = math.floor(LAYER_DEPTH * skin.thickness_mm / step + 1e-9)
        first = max(1, min(reach, round(seen_from_mm(indenter, h) / step)))
        light = layer_forces(skin, unit, indenter, at_mm, first * step)
        # Where the layer does not reach, the mesh is asked from the first step on.
        held = [first if light else 1, light]
        cache.put(KIND, key, held)
    return int(held[0]), held[1]


def _key(skin: SkinDimensions, unit: GelMaterial, indenter: Indenter, h: float) -> dict[str, Any]:
    sides = [skin.width_mm, skin.length_mm, skin.thickness_mm]
    tips: Sequence[Any] = [[type(t).__name__, asdict(t)] for t in indenter.tips]
    return {
        "sides_mm": sides,
        "poisson": unit.poisson,
        "friction": unit.friction,
        "indenter": [indenter.name, tips, indenter.reach_mm],
        "spacing_mm": h,
        "engine": _engine(),
    }


@once
def _engine() -> str:
    """Digest of everything a curve's numbers come from: this text, the engine's and the shapes'."""
    package = Path(__file__).parent
    text = hashlib.sha256()
    files = [*package.rglob("*.py"), *(package.parent / "shapes").rglob("*.py")]
    for path in sorted(files):
        text.update(path.name.encode() + b"\0" + path.read_bytes())
    return text.hexdigest()


def _tip(tip: Field) -> tuple[float, float, float]:
    return float(tip[0]), float(tip[1]), float(tip[2])
