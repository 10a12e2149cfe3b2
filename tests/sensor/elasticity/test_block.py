"""The finite block: its operator, its limits, plain finite elements, and contact up to the edge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RectBivariateSpline

from deltact_fab.common.errors import InputError
from deltact_fab.physics.gel.finite.assembly import BulkAssembly, MatrixPattern
from deltact_fab.physics.gel.finite.linear import make_solver
from deltact_fab.physics.gel.finite.material import NeoHooke
from deltact_fab.physics.gel.finite.mesh import block_mesh
from deltact_fab.physics.gel.finite.press import FinitePress
from deltact_fab.physics.gel.level import follow_path
from deltact_fab.physics.gel.linear.contact import ContactState, LinearContact
from deltact_fab.sensor.elasticity.block import FreeBlock
from deltact_fab.sensor.elasticity.edge_compliance import free_sides
from deltact_fab.sensor.elasticity.layer import BondedLayer
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions

SKIN = SkinDimensions()
GEL = GelMaterial()
SPHERE = parse_indenter("sphere:10")


@pytest.fixture(scope="module")
def block() -> FreeBlock:
    return FreeBlock(SKIN, GEL, spacing_mm=0.5, cell_mm=1.5)


def pressed(
    gel: FreeBlock | BondedLayer,
    x: float,
    y: float,
    depth: float = 2.0,
    name: str = "sphere:10",
    **how: object,
) -> ContactState:
    contact = LinearContact(gel, parse_indenter(name), **{"friction": 0.0, **how})  # type: ignore[arg-type]
    return contact.solve(contact.rest(), (x, y, depth))


def normal_n(*args: object, **how: object) -> float:
    return -pressed(*args, **how).force_n[2]  # type: ignore[arg-type]


# -- the operator ------------------------------------------------------------------------------


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_work_is_mutual_and_positive(block: FreeBlock, seed: int) -> None:
    """Maxwell and Betti, with all three components, and energy that no load makes negative."""
    rng = np.random.default_rng(seed)
    one, two = rng.standard_normal((2, *block.shape, 3))
    u, v = block.apply(one), block.apply(two)
    size = np.linalg.norm(u) * np.linalg.norm(two)
    assert abs(np.vdot(two, u) - np.vdot(one, v)) < 1e-10 * size
    assert np.vdot(one, u) > 0
    assert np.vdot(two, v) > 0


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), row=st.integers(0, 50), column=st.integers(0, 50))
def test_window_is_the_face_cut_out(block: FreeBlock, seed: int, row: int, column: int) -> None:
    my, mx = 17, 14
    window = block.window(my, mx, row, column)
    at = (slice(row, row + my), slice(column, column + mx))
    t = np.random.default_rng(seed).standard_normal((3, my, mx))
    whole = np.moveaxis(block.apply_patch(t, row, column)[at], -1, 0)
    assert whole[2] == pytest.approx(
        window.normal_of_pressure(t[2]) - window.normal_of_shear(t[:2]), abs=1e-10
    )
    assert whole[:2] == pytest.approx(
        window.shear_of_shear(t[:2]) - window.shear_of_pressure(t[2]), abs=1e-10
    )
    assert np.vdot(t[2], window.normal_of_pressure(t[2])) > 0
    assert np.vdot(t[:2], window.shear_of_shear(t[:2])) > 0


def test_sides_only_soften() -> None:
    """The slab is the block and more gel, so their difference has no negative eigenvalue."""
    sides = free_sides(SkinDimensions(width_mm=20, length_mm=16), 0.4999, 2.0)
    for i in range(4):
        q = sides.quarters.shape[-1]
        part = np.transpose(sides.quarters[:, :, i], (0, 2, 1, 3)).reshape(3 * q, 3 * q)
        values = np.linalg.eigvalsh(part)
        assert values[0] > -1e-9 * values[-1]
        assert values[-1] > 0


# -- against plain finite elements -----------------------------------------------------------------


@pytest.mark.parametrize(("component", "even"), [(0, (True, False)), (2, (False, True))])
def test_smooth_load_against_plain_finite_elements(component: int, even: tuple[bool, bool]) -> None:
    """Four loads, mirrored in x and y with either sign, on a quarter meshed at a 12th of a height.

    That mesh alone is about 0.5 % too stiff here, by its change from twice its cells.
    """
    skin = SkinDimensions(width_mm=18, length_mm=17, thickness_mm=6, protrusion_mm=5)
    step, half = 0.5, skin.opening_half_mm
    x, y = (np.arange(0, s + 1e-9, step) for s in half)
    mesh = block_mesh(skin, step, mirrors=(True, True))

    def load(xx: np.ndarray, yy: np.ndarray) -> np.ndarray:
        r2 = (np.abs(xx) - 5) ** 2 + (np.abs(yy) - 4) ** 2
        return 0.1 * np.maximum(0, 1 - r2 / 3**2) ** 2

    free = np.ones(mesh.nodes_mm.shape, dtype=bool)
    free[mesh.base] = False
    for axis in (0, 1):
        # Where the mirrored load's own component is even, the component across the plane is held.
        normal_held = even[axis] != (component == axis)
        held = [(i == axis) == normal_held for i in range(3)]
        on = mesh.nodes_mm[:, axis] == 0
        free[on] &= ~np.array(held)
    pattern = MatrixPattern(mesh, free)
    bulk = BulkAssembly(mesh, NeoHooke.from_material(GEL), pattern)
    stiffness = bulk.evaluate(np.zeros(free.shape)).data
    assert stiffness is not None
    solver = make_solver()
    solver.factorise(pattern.matrix(stiffness))
    force = np.zeros(free.shape)
    g, corner = 1 / np.sqrt(3), np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for point in g * corner:
        shape = np.prod(1 + point * corner, axis=1) / 4
        at = np.einsum("a,fai->fi", shape, mesh.nodes_mm[mesh.faces])
        part = load(at[:, 0], at[:, 1])[:, None] * shape * step**2 / 4
        np.add.at(force[:, component], mesh.faces, part)
    found = np.zeros(free.shape)
    found[free] = solver.solve(force[free])
    reference = found[-len(x) * len(y) :].reshape(len(y), len(x), 3)

    # A spacing whose nodes stand midway between nodes of the mesh: compare their means.
    gel = FreeBlock(skin, GEL, 0.25, 0.75)
    assert gel.spacing_mm == pytest.approx((0.25, 17 / 72), rel=1e-12)
    xx, yy = np.meshgrid(gel.x_mm, gel.y_mm)
    signed = np.ones(gel.shape)
    for axis, at in ((0, xx), (1, yy)):
        if not even[axis]:
            signed *= np.sign(at)
    tractions = np.zeros((*gel.shape, 3))
    tractions[..., component] = signed * load(xx, yy)
    u = gel.apply(tractions)
    inner = (slice(0, -1), slice(0, -1))
    ours = np.stack(
        [RectBivariateSpline(gel.y_mm, gel.x_mm, u[..., i])(y[:-1], x[:-1]) for i in range(3)],
        axis=-1,
    )
    assert np.abs(ours - reference[inner]).max() < 0.02 * np.abs(reference).max()
    weight = load(*np.meshgrid(x[:-1], y[:-1]))
    work = (weight * ours[..., component]).sum()
    assert work == pytest.approx((weight * reference[inner][..., component]).sum(), rel=0.01)


# -- presses -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("nu", "within"), [(0.49, 2e-3)])
def test_wide_gel_is_the_layer(nu: float, within: float) -> None:
    """Sides 40 mm away; nearly incompressible gel feels them from farther than a soft one."""
    wide, gel = SkinDimensions(width_mm=80, length_mm=80), GelMaterial(poisson=nu)
    layer = BondedLayer(gel, wide.thickness_mm, (240.0, 240.0), (480, 480))
    block = FreeBlock(wide, gel, 0.5, 4.0)
    assert normal_n(block, 0.1, 0.1) == pytest.approx(normal_n(layer, 0.1, 0.1), rel=within)


def test_sides_take_force_off(block: FreeBlock) -> None:
    """sphere:15 at 2 mm. In the middle a disc of equal area, an axisymmetric solution of its own
    (tests/physics/finite/test_linear_levels.py), has 0.9724."""
    layer = BondedLayer(GEL, SKIN.thickness_mm, (108.0, 102.0), (204, 216))
    for x, like in ((0.0, 0.9724), (10.0, 0.898)):
        force = normal_n(block, x, 0, name="sphere:15")
        assert force / normal_n(layer, x, 0, name="sphere:15") == pytest.approx(like, abs=0.005)
    corner = normal_n(block, 13, 12) / normal_n(layer, 13, 12)
    assert 0.6 < corner < 0.8


def test_force_converges_with_the_cells() -> None:
    forces = {
        cell: [
            normal_n(FreeBlock(SKIN, GEL, 0.5, cell), x, y)
            for x, y in ((0.0, 0.0), (10.0, 0.0), (14.0, 13.0))
        ]
        for cell in (3.0, 2.0)
    }
    fine = np.array(forces[2.0])
    assert np.abs(np.array(forces[3.0]) / fine - 1).max() < 0.02
    # In the middle the disc's of equal area (tests/physics/finite/test_linear_levels.py), the
    # others with cells of 1 mm, which take seconds to build.
    assert fine == pytest.approx([8.056, 7.597, 5.116], rel=6e-3)


def test_no_load_beyond_the_edge(block: FreeBlock) -> None:
    """A tip at the very corner: a quarter of the sphere is above gel, and that can be pressed."""
    half = SKIN.opening_half_mm
    state = pressed(block, *half, depth=1.0)
    assert state.pressure_mpa.shape == block.shape
    assert abs(block.x_mm).max() + block.spacing_mm[0] / 2 == pytest.approx(half[0])
    assert abs(block.y_mm).max() + block.spacing_mm[1] / 2 == pytest.approx(half[1])
    assert state.pressure_mpa[-1, -1] > 0
    centre = normal_n(block, 0, 0, depth=1.0)
    assert 0 < -state.force_n[2] < centre / 4


@pytest.mark.evidence
def test_light_presses_against_finite_strain() -> None:
    """Cells of 0.5 mm in the finite mesh; cells of 0.35 mm give 0.5 % less force."""
    press = FinitePress(block_mesh(SKIN, 0.5, (-2.0, 2.0, -2.0, 2.0)), GEL, SPHERE, friction=0)
    gel = FreeBlock(SKIN, GEL, 0.125, 1.5)
    *_, state = follow_path(press, press.rest(), (0.0, 0.0, 0.5), 0.5)
    assert -state.force_n[2] == pytest.approx(normal_n(gel, 0, 0, depth=0.5), rel=0.02)


# -- refusals -------------------------------------------------------------------------------------


def test_refusals() -> None:
    with pytest.raises(InputError, match=r"poisson <= 0\.4999 is needed: 0\.5 fails"):
        FreeBlock(SKIN, GelMaterial(poisson=0.5))
    with pytest.raises(InputError, match=r"cell_mm must be 0\.45 to 8\.5 mm"):
        FreeBlock(SKIN, GEL, cell_mm=0.1)
    with pytest.raises(InputError, match="spacing_mm must be"):
        FreeBlock(SKIN, GEL, spacing_mm=0.0, cell_mm=3.0)
