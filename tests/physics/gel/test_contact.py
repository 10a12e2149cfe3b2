"""Contact with the linear gel: against references, by symmetry, Coulomb's law, and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from deltact_fab.common.aliases import Field
from deltact_fab.common.errors import InputError, SolverError
from deltact_fab.physics.gel.level import follow_path
from deltact_fab.physics.gel.linear import complementarity
from deltact_fab.physics.gel.linear.complementarity import normal_contact
from deltact_fab.physics.gel.linear.contact import ContactState, LinearContact
from deltact_fab.sensor.elasticity.block import FreeBlock
from deltact_fab.sensor.elasticity.layer import BondedLayer, flat_punch_n_per_mm
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.rigid import Indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.sensor.shapes.tips import SphereTip

SPHERE = parse_indenter("sphere:10")
DEPTH_MM = 1.2


@pytest.fixture(scope="module")
def face() -> FreeBlock:
    return FreeBlock(SkinDimensions(), GelMaterial(), spacing_mm=0.4)


def periodic(nu: float, nodes: int, padding: float = 3.0) -> BondedLayer:
    """The layer without sides, 12 mm thick, its images `padding` skins away."""
    period = (36 * padding, 36 * padding)
    return BondedLayer(GelMaterial(poisson=nu), 12.0, period, (nodes, nodes))


def along(
    contact: LinearContact,
    *tips: tuple[float, float, float],
    step_mm: float = 0.2,
    start: ContactState | None = None,
) -> ContactState:
    state = start or contact.rest()
    for tip in tips:
        *_, state = follow_path(contact, state, tip, step_mm)
    return state


@pytest.fixture(scope="module")
def sheared(face: FreeBlock) -> ContactState:
    return along(LinearContact(face, SPHERE), (0, 0, DEPTH_MM), (0.4, 0, DEPTH_MM))


# -- against references ------------------------------------------------------------------------


def cattaneo_shift_mm(
    shear_n: float, normal_n: float, radius_mm: float, material: GelMaterial, friction: float
) -> float:
    """Tangential shift of a rigid sphere on a half-space under Q <= mu N (Cattaneo, Mindlin).

    3 mu N (2 - nu)/(16 G a) (1 - (1 - Q/(mu N))^(2/3)) (Johnson, Contact Mechanics, 7.2). It
    neglects the slip across the load and, unless nu = 0.5, the coupling of normal and tangential.
    """
    limit = friction * normal_n
    full = 3 * limit * (2 - material.poisson) / (16 * material.shear_modulus_mpa * radius_mm)
    return full * (1 - (1 - shear_n / limit) ** (2 / 3))


def cattaneo_stick_radius_mm(
    shear_n: float, normal_n: float, contact_radius_mm: float, friction: float
) -> float:
    """Radius of the stick zone, a (1 - Q/(mu N))^(1/3)."""
    return contact_radius_mm * (1 - shear_n / (friction * normal_n)) ** (1 / 3)


def cattaneo_traction_mpa(
    r_mm: Field, contact_radius_mm: float, stick_radius_mm: float, normal_n: float, friction: float
) -> Field:
    """Shear traction along the load: mu p(a) less its copy on the stick zone; shape of r_mm."""
    a, c = contact_radius_mm, stick_radius_mm
    peak = friction * 3 * normal_n / (2 * math.pi * a**2)
    outer = np.sqrt(np.maximum(0.0, 1 - r_mm**2 / a**2))
    inner = c / a * np.sqrt(np.maximum(0.0, 1 - r_mm**2 / c**2)) if c > 0 else 0.0
    return peak * (outer - inner)


def test_flat_punch_converges_at_first_order() -> None:
    """A sharp contact edge is off by about a tenth of a cell in radius; two grids cancel that."""
    material, h, a, period = GelMaterial(poisson=0.3), 5.0, 3.0, 30.0
    exact = 0.1 * flat_punch_n_per_mm(a, h, material)
    rng = np.random.default_rng(0)
    offsets = rng.uniform(-0.5, 0.5, (8, 2))
    errors = []
    for n in (128, 256):
        layer = BondedLayer(material, h, (period, period), (n, n))
        m = 2 * math.ceil(a / layer.spacing_mm[0] + 3)
        i = (n - m) // 2
        window, axis = layer.window(m, m), layer.x_mm[i : i + m]
        forces = []
        for x, y in offsets * layer.spacing_mm[0]:
            r = np.hypot(*np.meshgrid(axis - x, axis - y))
            p, worst, _ = normal_contact(
                window, np.zeros((m, m)), np.where(r <= a, -0.1, np.inf), 1e-7
            )
            assert worst <= 1e-7
            forces.append(p.sum() * layer.cell_mm2)
        errors.append(np.mean(forces) / exact - 1)
    assert abs(errors[1]) < 0.01
    assert 1.5 < errors[0] / errors[1] < 2.5
    assert abs(2 * errors[1] - errors[0]) < 0.005


def test_partial_slip_against_cattaneo_and_mindlin() -> None:
    """nu = 0.5 uncouples press and shear; small friction keeps the shift far below the radius."""
    material, mu, depth, n = GelMaterial(poisson=0.5), 0.01, 0.2, 256
    layer = BondedLayer(material, 40.0, (20.0, 20.0), (n, n))
    contact = LinearContact(layer, SPHERE, friction=mu, tolerance=1e-8)
    state = contact.solve(contact.rest(), (0.0, 0.0, depth))
    normal = -state.force_n[2]
    a = math.sqrt(state.contact_nodes * layer.cell_mm2 / math.pi)
    r = np.hypot(*np.meshgrid(layer.x_mm, layer.y_mm))
    # The layer and its images move the contact as a whole; a known traction shows by how much:
    # on a half-space its centre moves by pi a (2 - nu)/(8 G) (Johnson, Contact Mechanics, 7.1).
    traction = np.zeros((n, n, 3))
    traction[..., 0] = np.sqrt(np.maximum(0, 1 - r**2 / a**2))
    moved = layer.apply(traction)[n // 2 - 1 : n // 2 + 1, n // 2 - 1 : n // 2 + 1, 0].mean()
    on_half_space = math.pi * a * 1.5 / (8 * material.shear_modulus_mpa)
    extra = (moved - on_half_space) / (traction[..., 0].sum() * layer.cell_mm2)
    full = cattaneo_shift_mm(mu * normal, normal, a, material, mu) + extra * mu * normal
    for share in (0.2, 0.4, 0.6, 0.8):
        state = contact.solve(state, (share * full, 0.0, depth))
        shear = state.force_n[0]
        expected = cattaneo_shift_mm(shear, normal, a, material, mu) + extra * shear
        assert share * full == pytest.approx(expected, rel=0.01)
        size = np.hypot(state.shear_mpa[..., 0], state.shear_mpa[..., 1])
        stick = size < mu * state.pressure_mpa * (1 - 1e-6)
        found = math.sqrt(stick.sum() * layer.cell_mm2 / math.pi)
        radius = cattaneo_stick_radius_mm(shear, normal, a, mu)
        assert found == pytest.approx(radius, abs=layer.spacing_mm[0] / 2)
        q = cattaneo_traction_mpa(r, a, radius, normal, mu)
        assert np.linalg.norm(state.shear_mpa[..., 0] - q) < 0.05 * np.linalg.norm(q)


# -- the conditions of contact -------------------------------------------------------------------


def test_every_condition_holds_at_every_node(face: FreeBlock) -> None:
    indenter = parse_indenter("4dots")
    contact = LinearContact(face, indenter)
    before = along(contact, (0, 0, 1.0), (0.2, 0.1, 1.0))
    tip = (0.3, 0.15, 1.0)
    state = contact.solve(before, tip)
    tractions = np.concatenate([state.shear_mpa, -state.pressure_mpa[..., None]], axis=-1)
    u = face.apply(tractions)
    assert np.allclose(u, state.displacement_mm, atol=1e-12)
    xx, yy = np.meshgrid(face.x_mm, face.y_mm)
    drag = face.apply(np.concatenate([state.drag_mpa, 0 * u[..., 2:]], axis=-1))[..., :2]
    assert np.allclose(drag, state.drag_mm, atol=1e-12)
    gap = indenter.height_mm(xx + drag[..., 0] - tip[0], yy + drag[..., 1] - tip[1])
    gap = gap - tip[2] - u[..., 2]
    touching = state.pressure_mpa > 0
    assert state.pressure_mpa.min() == 0
    assert gap.min() >= -2e-6
    assert np.abs(gap[touching]).max() <= 2e-6
    moved = u[..., :2] - before.displacement_mm[..., :2]
    alone = state.shear_mpa - state.drag_mpa
    # With the travel of the indenter, and what the same pressures would do without it.
    for q, slip in (
        (state.shear_mpa, moved - [0.1, 0.05]),
        (alone, moved - (drag - before.drag_mm)),
    ):
        bound = 0.5 * state.pressure_mpa
        size, slid = np.hypot(q[..., 0], q[..., 1]), np.hypot(slip[..., 0], slip[..., 1])
        assert np.all(size <= bound * (1 + 1e-12))
        stick = touching & (size < bound * (1 - 1e-3))
        assert stick.sum() > 10
        assert slid[stick].max() < 1e-5
        slides = touching & (size > bound * (1 - 1e-9))
        assert q is alone or slides.sum() > 10
        fast = slides & (slid > 1e-4)
        assert ((q * slip).sum(-1)[fast] < -0.999 * (size * slid)[fast]).all()


def test_force_signs_and_mirror(face: FreeBlock, sheared: ContactState) -> None:
    """A press pushes the sensor down; +x drags it to +x; -x is the mirror image."""
    contact = LinearContact(face, SPHERE)
    press = along(contact, (0, 0, DEPTH_MM))
    assert press.force_n[2] < -1
    assert np.abs(press.force_n[:2]).max() < 1e-6
    assert np.abs(press.torque_nmm).max() < 1e-5
    assert sheared.force_n[0] > 0.5
    assert abs(sheared.force_n[1]) < 1e-6
    back = along(contact, (0, 0, DEPTH_MM), (-0.4, 0, DEPTH_MM))
    assert back.force_n[0] == pytest.approx(-sheared.force_n[0], rel=1e-5)
    assert back.force_n[2] == pytest.approx(sheared.force_n[2], rel=1e-5)
    flip = sheared.displacement_mm[:, ::-1] * [-1, 1, 1]
    assert np.abs(back.displacement_mm - flip).max() < 1e-5


def test_unloading_leaves_nothing_and_forgets(face: FreeBlock) -> None:
    contact = LinearContact(face, SPHERE)
    state = along(contact, (0, 0, 1.0), (0.3, 0, 1.0), (0.3, 0, 0.0))
    assert state.force_n == (0.0, 0.0, 0.0)
    assert not state.displacement_mm.any()
    again = contact.solve(state, (0.3, 0, 0.5))
    fresh = contact.solve(contact.rest((0.3, 0, 0.0)), (0.3, 0, 0.5))
    assert again.force_n == fresh.force_n


def test_stuck_nodes_stay_in_contact(face: FreeBlock) -> None:
    """What sticks moves with the indenter, so a small shear must not change which nodes touch, nor
    a large one the normal force (at the very edge points always slip)."""
    contact = LinearContact(face, SPHERE, friction=5.0)
    press = along(contact, (0, 0, 0.8))
    shear = along(contact, (0.15, 0, 0.8), start=press)
    changed = (shear.pressure_mpa > 0) != (press.pressure_mpa > 0)
    assert changed.sum() <= 0.05 * press.contact_nodes
    drag = along(contact, (0.6, 0, 0.8), start=shear)
    assert drag.force_n[2] == pytest.approx(press.force_n[2], rel=0.005)
    assert drag.contact_nodes == pytest.approx(press.contact_nodes, rel=0.07)
    sticks = np.hypot(*np.moveaxis(drag.shear_mpa, -1, 0)) < 4.9 * drag.pressure_mpa
    sticks &= press.pressure_mpa > 0
    assert sticks.sum() > 0.7 * press.contact_nodes
    assert drag.drag_mm[sticks] == pytest.approx(np.tile([0.6, 0.0], (sticks.sum(), 1)), abs=0.02)


def test_frictionless_drag_has_no_history(face: FreeBlock) -> None:
    contact = LinearContact(face, SPHERE, friction=0.0)
    dragged = along(contact, (0, 0, 0.8), (2.0, 0, 0.8))
    fresh = along(contact, (2.0, 0, 0.8))
    assert dragged.force_n == pytest.approx(fresh.force_n, rel=1e-5)


# -- what is not asked, and what is refused ----------------------------------------------------


def test_large_strain_is_flagged(face: FreeBlock) -> None:
    contact = LinearContact(face, SPHERE, friction=0)
    assert not contact.solve(contact.rest(), (0, 0, 1.2)).diagnostics.flags
    assert contact.solve(contact.rest(), (0, 0, 1.21)).diagnostics.flags


@pytest.mark.parametrize(
    ("name", "tip", "error", "words"),
    [
        ("sphere:10", (0.0, 0.0, 3.01), InputError, "25%.*use level hyperelastic"),
        ("sphere:10", (19.0, 0.0, 1.0), InputError, "off the face"),
        ("sphere:3", (0.0, 0.0, 1.6), InputError, "its rim"),
        ("sphere:10", (0.0, 0.0, 0.001), SolverError, "no grid node"),
        ("sphere:10", (0.0, math.nan, 1.0), InputError, "finite"),
    ],
)
def test_refusals(
    face: FreeBlock, name: str, tip: tuple[float, float, float], error: type[Exception], words: str
) -> None:
    contact = LinearContact(face, parse_indenter(name), friction=0)
    with pytest.raises(error, match=words) as caught:
        contact.solve(contact.rest(), tip)
    assert "\n" not in str(caught.value)


def test_contact_at_tip_rim_is_refused() -> None:
    """A grid that puts the contact within one node of the equator cannot tell where it ends."""
    skin = SkinDimensions(10, 10, 3, edge_fillet_mm=0.1, protrusion_mm=2)
    face = FreeBlock(skin, GelMaterial(poisson=0.499), spacing_mm=0.2)
    contact = LinearContact(face, Indenter("bead", (SphereTip(0, 0, 0.7),)), friction=0)
    with pytest.raises(SolverError, match="reaches the edge of bead"):
        contact.solve(contact.rest(), (0.0, 0.0, 0.69))


def test_a_folding_face_is_refused(face: FreeBlock, monkeypatch: pytest.MonkeyPatch) -> None:
    contact = LinearContact(face, SPHERE, friction=30.0)
    monkeypatch.setattr(contact, "max_alternations", 10)
    with pytest.raises(SolverError, match=r"det\(I \+ grad u\)|do not agree"):
        along(contact, (0, 0, 2.0), (4.0, 0, 2.0))


def test_too_few_iterations_raise(face: FreeBlock, monkeypatch: pytest.MonkeyPatch) -> None:
    contact = LinearContact(face, SPHERE)
    monkeypatch.setattr(contact, "max_alternations", 1)
    with pytest.raises(SolverError, match="do not agree after 1 "):
        contact.solve(contact.rest(), (0, 0, 1.0))
    monkeypatch.setattr(complementarity, "MAX_CONTACT_ITERATIONS", 3)
    with pytest.raises(SolverError, match="not converged after 3"):
        contact.solve(contact.rest(), (0, 0, 1.0))


# -- the references themselves: a published table

POISSON = (0.3, 0.4, 0.45, 0.5)
# Flat punch on a bonded layer; Hayes et al. (J. Biomech. 5, 1972) agree to 0.3 % for a/h <= 1.
FACTORS = {
    0.2: (1.2066, 1.2323, 1.2523, 1.2806),
    0.6: (1.7848, 1.9178, 2.0328, 2.2129),
    1.0: (2.4835, 2.7938, 3.0914, 3.6187),
    2.0: (4.3532, 5.2985, 6.4206, 9.1495),
}


@pytest.mark.parametrize("ratio", FACTORS)
def test_flat_punch_table(ratio: float) -> None:
    """kappa in 4 G a kappa/(1 - nu)."""
    found = [
        flat_punch_n_per_mm(ratio, 1.0, GelMaterial(2 * (1 + nu), nu)) * (1 - nu) / (4 * ratio)
        for nu in POISSON
    ]
    assert [round(f, 4) for f in found] == list(FACTORS[ratio])
