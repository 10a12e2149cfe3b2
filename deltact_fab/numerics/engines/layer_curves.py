"""The bonded layer: force on a sphere and on a flat punch against the Fredholm equation.

Both take the textbook contact, a node held against the indenter above where it rested.

A flat punch is nodes inside a circle: a staircase for an edge where the pressure is singular. The
force belongs to a circle of another radius, so it is compared at the radius of equal area (nodes
times cell), not at the nominal one. What is left falls as the spacing; with tractions and
displacements by cells instead of nodes (BondedLayer's `cells`) it is a third to a sixth of it, and
two grids of nodes remove it (Richardson). The punch is set at several places between the nodes and
the mean is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...aliases import Field
from ...elasticity.layer import BondedLayer
from ...elasticity.material import GelMaterial
from ...gel import reference
from ...gel.linear.complementarity import normal_contact
from ...gel.linear.contact import LayerContact
from ...shapes import SkinDimensions
from ...shapes.indenter import Indenter, parse
from ..engine import CurveSetting, Work

SEED = 5
SPHERE_MM = 10.0
DEPTH_MM = 1.2
PLACES = 8
PUNCH_RATIO = 2.0  # radius over thickness: 43 nodes a radius at 256 x 256
PUNCH_PERIOD = 12.0  # over thickness: 8 thicknesses to the next image
NODES, CELLS, BOTH = "nodes", "cells", "nodes, extrapolated from this grid and half"
REFERENCE_ERROR = 1e-8  # %; 48 and 96 Gauss points agree to 1e-10


@cache
def _sphere_force_n(diameter_mm: float, depth_mm: float, thickness_mm: float, nu: float) -> float:
    material = GelMaterial(poisson=nu)
    return reference.sphere_on_layer(diameter_mm / 2, depth_mm, thickness_mm, material)[0]


def skin(side_mm: tuple[float, float], thickness_mm: float) -> SkinDimensions:
    return SkinDimensions(*side_mm, thickness_mm, min(2.0, thickness_mm / 4), thickness_mm / 2)


def _frictionless(layer: BondedLayer, indenter: Indenter) -> LayerContact:
    return LayerContact(layer, indenter, observe_shear=False)


def _places(layer: BondedLayer) -> Field:
    """Places (PLACES, 2) in mm between the nodes around the centre."""
    return np.random.default_rng(SEED).uniform(-0.5, 0.5, (PLACES, 2)) * layer.spacing_mm[0]


def sphere_error_percent(
    layer: BondedLayer, depth_mm: float = DEPTH_MM, diameter_mm: float = SPHERE_MM
) -> float:
    """Root mean square error of the force in % over places between the nodes."""
    contact = _frictionless(layer, parse(f"sphere:{diameter_mm:g}"))
    exact = _sphere_force_n(diameter_mm, depth_mm, layer.thickness_mm, layer.material.poisson)
    exact *= layer.material.modulus_mpa / GelMaterial().modulus_mpa
    forces = [contact.solve(contact.rest(), (x, y, depth_mm)).force_n[2] for x, y in _places(layer)]
    return float(np.sqrt(np.mean((-np.array(forces) / exact - 1) ** 2))) * 100


def _build_sphere(nu: float, spacing_mm: float, padding: float, scratch: Path) -> Work:
    layer = BondedLayer.for_skin(SkinDimensions(), GelMaterial(poisson=nu), spacing_mm, padding)
    contact = _frictionless(layer, parse(f"sphere:{SPHERE_MM:g}"))
    return Work(
        lambda: contact.solve(contact.rest(), (0.0, 0.0, DEPTH_MM)),
        lambda state: sphere_error_percent(layer),
    )


class Punch:
    """A flat punch of radius PUNCH_RATIO on a layer of unit thickness, n x n nodes a period."""

    def __init__(self, nu: float, n: int, cells: bool = False) -> None:
        self.material = GelMaterial(poisson=nu)
        period = (PUNCH_PERIOD, PUNCH_PERIOD)
        self.layer = BondedLayer(self.material, 1.0, period, (n, n), cells=cells)
        self._m = 2 * math.ceil(PUNCH_RATIO / self.layer.spacing_mm[0] + 1)
        self._window = self.layer.window(self._m, self._m)
        first = (n - self._m) // 2
        self._axis = self.layer.x_mm[first : first + self._m]

    def press(self, at_mm: tuple[float, float] = (0.0, 0.0)) -> tuple[float, float]:
        """Force (N) at a depth of 1 mm, and the radius (mm) of equal area."""
        r = np.hypot(*np.meshgrid(self._axis - at_mm[0], self._axis - at_mm[1]))
        inside = r <= PUNCH_RATIO
        gap = np.where(inside, -1.0, np.inf)
        p, _, _ = normal_contact(self._window, np.zeros(r.shape), gap, 1e-6)
        area = float(inside.sum()) * self.layer.cell_mm2
        return float(p.sum()) * self.layer.cell_mm2, math.sqrt(area / math.pi)

    def exact_n(self, radius_mm: float) -> float:
        """Force of the reference near the nominal radius."""
        nu, g = self.material.poisson, self.material.shear_modulus_mpa
        factor = reference.flat_punch_factor(radius_mm, nu)
        return 4 * g * radius_mm * factor / (1 - nu)

    def error_percent(self, equal_area: bool = True) -> float:
        """Mean signed error in % over places between the nodes."""
        errors = []
        for x, y in _places(self.layer):
            force, radius = self.press((x, y))
            errors.append(force / self.exact_n(radius if equal_area else PUNCH_RATIO) - 1)
        return float(np.mean(errors)) * 100


@cache
def punch_error_percent(nu: float, n: int, equal_area: bool = True, cells: bool = False) -> float:
    """Mean signed error of n x n nodes, or cells, in %."""
    return Punch(nu, n, cells).error_percent(equal_area)


def extrapolated_percent(nu: float, n: int) -> float:
    """Error left by n and n/2 nodes a side together, first order removed: 2 e(n) - e(n/2)."""
    return 2 * punch_error_percent(nu, n) - punch_error_percent(nu, n // 2)


def punch_order(nu: float, n: int) -> float:
    """Observed order from n/4, n/2 and n nodes a side."""
    e = [punch_error_percent(nu, m) for m in (n // 4, n // 2, n)]
    return math.log2((e[0] - e[1]) / (e[1] - e[2]))


def _build_punch(nu: float, n: int, way: str, scratch: Path) -> Work:
    sides = (n // 2, n) if way == BOTH else (n,)
    punches = [Punch(nu, m, way == CELLS) for m in sides]

    def error(found: Any) -> float:
        if way == BOTH:
            return abs(extrapolated_percent(nu, n))
        return abs(punch_error_percent(nu, n, cells=way == CELLS))

    return Work(lambda: [p.press() for p in punches], error)


def curves(quick: bool) -> Sequence[CurveSetting]:
    """Spheres by spacing and padding; the flat punch by grid, alone and extrapolated."""
    out = []
    plan: dict[float, tuple[float, ...]] = {0.49: (2.0, 3.0, 4.0), 0.3: (3.0,), 0.5: (3.0,)}
    for nu, paddings in ({0.49: (3.0,)} if quick else plan).items():
        for padding in paddings:
            for spacing_mm in (0.5, 0.25) if quick else (0.5, 0.25, 0.18, 0.125):
                out.append(
                    CurveSetting(
                        case=f"sphere:{SPHERE_MM:g} pressed {DEPTH_MM:g} mm, nu {nu:g}",
                        series=f"padding {padding:g}",
                        name=f"{spacing_mm:g} mm",
                        unit="% of the force, rms over places",
                        reference="Fredholm equation, sphere on a bonded layer",
                        reference_error=REFERENCE_ERROR,
                        build=partial(_build_sphere, nu, spacing_mm, padding),
                    )
                )
    for nu in () if quick else (0.3, 0.45, 0.5):
        for series in (NODES, CELLS, BOTH):
            for n in (256, 512) if series == BOTH else (128, 256, 512):
                out.append(
                    CurveSetting(
                        case=f"flat punch, radius {PUNCH_RATIO:g} thicknesses, nu {nu:g}",
                        series=series,
                        name=f"{n} x {n}",
                        unit="% of the force, mean over places",
                        reference="Fredholm equation, flat punch on a bonded layer",
                        reference_error=REFERENCE_ERROR,
                        build=partial(_build_punch, nu, n, series),
                    )
                )
    return out
