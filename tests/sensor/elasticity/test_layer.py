"""The layer's operator against its differential equation, and the fast paths against the slow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from deltact_fab.common.errors import InputError
from deltact_fab.sensor.elasticity.layer import BondedLayer, surface_compliance
from deltact_fab.sensor.elasticity.material import GelMaterial


def compliance_from_ode(
    kx: float, ky: float, thickness: float, material: GelMaterial
) -> np.ndarray:
    """Complex 3 x 3 surface compliance from y' = A y, y = (u, traction on z), u = 0 at the base.

    Written so that it stays finite at nu = 0.5: the in-plane stress is taken from sigma_zz.
    """
    nu, g = material.poisson, material.shear_modulus_mpa
    k = np.array([kx, ky])
    a = np.zeros((6, 6), dtype=complex)
    # u_x' = s_xz/G - i kx u_z (and y); u_z' = (1-2nu)/(2G(1-nu)) s_zz - nu/(1-nu) i (k.u)
    a[0, 3] = a[1, 4] = 1 / g
    a[0, 2], a[1, 2] = -1j * kx, -1j * ky
    a[2, 5] = (1 - 2 * nu) / (2 * g * (1 - nu))
    a[2, 0:2] = -nu / (1 - nu) * 1j * k
    # s_xz' = -i (kx s_xx + ky s_xy), with s_xx = nu/(1-nu) s_zz + 2G/(1-nu) (e_xx + nu e_yy)
    for i, j in ((0, 1), (1, 0)):
        a[3 + i, 5] = -1j * k[i] * nu / (1 - nu)
        a[3 + i, i] = k[i] * 2 * g / (1 - nu) * k[i] + k[j] * g * k[j]
        a[3 + i, j] = k[i] * 2 * g / (1 - nu) * nu * k[j] + k[j] * g * k[i]
    a[5, 3:5] = -1j * k
    transfer = expm(a * thickness)
    return transfer[0:3, 3:6] @ np.linalg.inv(transfer[3:6, 3:6])


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49, 0.5])
@pytest.mark.parametrize("kh", [0.05, 0.3, 0.9, 2.0, 5.0])
def test_closed_form_solves_the_layer_equation(nu: float, kh: float) -> None:
    material = GelMaterial(poisson=nu)
    h, angle = 12.0, 0.7
    k = kh / h
    c = surface_compliance(np.array(k), h, material)
    x, y = np.cos(angle), np.sin(angle)
    expected = compliance_from_ode(k * x, k * y, h, material)
    closed = np.array(
        [
            [
                x * x * c.longitudinal + y * y * c.transverse,
                x * y * (c.longitudinal - c.transverse),
                -1j * x * c.coupling,
            ],
            [
                x * y * (c.longitudinal - c.transverse),
                y * y * c.longitudinal + x * x * c.transverse,
                -1j * y * c.coupling,
            ],
            [1j * x * c.coupling, 1j * y * c.coupling, c.normal],
        ]
    )
    assert np.abs(closed - expected).max() < 1e-9 * np.abs(expected).max()


def test_incompressible_compliance_vanishes_as_k_squared() -> None:
    """Lubrication limit at nu = 0.5: u_z/p = k^2 h^3/(3 G), to the last digits as k -> 0."""
    material = GelMaterial(poisson=0.5)
    k = np.array([1e-6, 1e-5, 1e-4])
    c = surface_compliance(k, 1.0, material)
    assert np.allclose(c.normal, k**2 / (3 * material.shear_modulus_mpa), rtol=1e-7, atol=0)


def test_large_wave_numbers_give_half_space() -> None:
    material = GelMaterial(poisson=0.3)
    k = np.array([1e2, 1e4])
    c = surface_compliance(k, 12.0, material)
    g = material.shear_modulus_mpa
    assert np.allclose(c.normal, 0.7 / (g * k), rtol=1e-14)
    assert np.allclose(c.longitudinal, 0.7 / (g * k), rtol=1e-14)
    assert np.allclose(c.transverse, 1 / (g * k), rtol=1e-14)
    assert np.allclose(c.coupling, 0.2 / (g * k), rtol=1e-14)


@given(nu=st.floats(0, 0.5), kh=st.floats(1e-4, 50), h=st.floats(0.1, 50), e=st.floats(0.01, 100))
def test_compliance_is_positive_definite(nu: float, kh: float, h: float, e: float) -> None:
    c = surface_compliance(np.array(kh / h), h, GelMaterial(e, nu))
    assert c.normal > 0
    assert c.longitudinal > 0
    assert c.transverse > 0
    assert c.coupling**2 < c.normal * c.longitudinal


@pytest.fixture(scope="module")
def layer() -> BondedLayer:
    return BondedLayer(GelMaterial(poisson=0.45), 5.0, (40.0, 30.0), (48, 64))


def test_uniform_traction_gives_shear_and_squeeze(layer: BondedLayer) -> None:
    t = np.broadcast_to([0.1, -0.2, -0.3], (48, 64, 3))
    u = layer.apply(t.copy())
    g = layer.material.shear_modulus_mpa
    squeeze = 5.0 * 0.1 / (2 * g * 0.55)
    assert np.allclose(u, [0.1 * 5 / g, -0.2 * 5 / g, -0.3 * squeeze], rtol=1e-12)


def test_reciprocity_and_energy_on_the_grid(layer: BondedLayer) -> None:
    rng = np.random.default_rng(1)
    t1, t2 = rng.normal(size=(2, 48, 64, 3))
    u1, u2 = layer.apply(t1), layer.apply(t2)
    assert np.vdot(t1, u2) == pytest.approx(np.vdot(t2, u1), rel=1e-10)
    assert np.vdot(t1, u1) > 0


def test_window_and_patch_operators_agree(layer: BondedLayer) -> None:
    rng = np.random.default_rng(2)
    small = rng.normal(size=(3, 16, 24))
    full = np.zeros((48, 64, 3))
    full[20:36, 10:34] = np.moveaxis(small, 0, -1)
    expected = layer.apply(full)
    assert np.allclose(layer.apply_patch(small, 20, 10), expected, atol=1e-13)
    op = layer.window(16, 24)
    in_plane = op.shear_of_shear(small[:2]) + op.shear_of_pressure(-small[2])
    depth = op.normal_of_shear(small[:2]) + op.normal_of_pressure(-small[2])
    assert np.allclose(in_plane, np.moveaxis(expected[20:36, 10:34, :2], -1, 0), atol=1e-12)
    assert np.allclose(-depth, expected[20:36, 10:34, 2], atol=1e-12)


def test_an_oversized_window_is_refused(layer: BondedLayer) -> None:
    with pytest.raises(InputError, match="half the period"):
        layer.window(30, 10)


@pytest.mark.parametrize(
    "bad",
    [{"modulus_mpa": 0.0}, {"poisson": 0.51}, {"friction": -0.1}, {"modulus_mpa": float("nan")}],
)
def test_material_refuses(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        GelMaterial(**bad)
