"""Linear elastic layer bonded to a rigid base: surface tractions to surface displacement.

The operator is a convolution, diagonal in wave number, in closed form up to Poisson's ratio 0.5.
The surface is periodic and has no sides: `block` adds them.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from deltact_fab.common import Field, InputError

from .material import GelMaterial

Spectrum = NDArray[np.complex128]


class WaveCompliance(NamedTuple):
    """Surface compliance (mm/MPa) of one wave number k, for a wave along the first in-plane axis.

    With tractions t acting on the surface and u ~ exp(i k x):
    u_z = normal t_z + i coupling t_x,  u_x = longitudinal t_x - i coupling t_z,
    u_y = transverse t_y.
    """

    normal: Field
    longitudinal: Field
    transverse: Field
    coupling: Field


def surface_compliance(
    k_per_mm: Field, thickness_mm: float, material: GelMaterial
) -> WaveCompliance:
    """Closed-form compliance of a bonded layer at wave numbers k >= 0 of any shape.

    All ratios are scaled by 2 exp(-2 k h), so a large k h gives the half-space without overflow.
    Source: plane-strain layer solution, tested against the layer's differential equation.
    """
    nu, g = material.poisson, material.shear_modulus_mpa
    k = np.asarray(k_per_mm, dtype=np.float64)
    a = k * thickness_mm
    kappa = 3 - 4 * nu
    e = np.exp(-2 * a)
    # Twice exp(-2a) times (sinh 2a - 2a): the closed form cancels as a -> 0, the series does not.
    s = 2 * np.minimum(a, 0.5)
    series = s**3 / 6 * (1 + s**2 / 20 * (1 + s**2 / 42 * (1 + s**2 / 72 * (1 + s**2 / 110))))
    excess = np.where(a < 0.5, 2 * e * series, 1 - e**2 - 4 * a * e)
    denominator = kappa * (1 + e**2) + 2 * e * (2 * a**2 + 5 - 12 * nu + 8 * nu**2)
    normal = kappa * excess + (kappa - 1) * 4 * a * e
    longitudinal = -kappa * np.expm1(-4 * a) + 4 * a * e
    coupling = (1 - 2 * nu) * kappa * np.expm1(-2 * a) ** 2 / 2 - 2 * e * a**2
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (g * k)
        full = WaveCompliance(
            (1 - nu) * normal / denominator * scale,
            (1 - nu) * longitudinal / denominator * scale,
            np.tanh(a) * scale,
            coupling / denominator * scale,
        )
    uniform = (
        thickness_mm * (1 - 2 * nu) / (2 * g * (1 - nu)),
        thickness_mm / g,
        thickness_mm / g,
        0.0,
    )
    return WaveCompliance(*(np.where(k == 0, u, f) for f, u in zip(full, uniform, strict=True)))


class BondedLayer:
    """The periodic bonded layer on a grid of ny x nx nodes, symmetric about the origin.

    material: elastic constants. thickness_mm: from the rigid base to the resting face.
    period_mm: (x, y) period. shape: (ny, nx) nodes, both even.
    x_mm (nx,), y_mm (ny,): node coordinates in the sensor frame.
    """

    def __init__(
        self,
        material: GelMaterial,
        thickness_mm: float,
        period_mm: tuple[float, float],
        shape: tuple[int, int],
    ) -> None:
        ny, nx = shape
        self.material = material
        self.thickness_mm = float(thickness_mm)
        self.period_mm = (float(period_mm[0]), float(period_mm[1]))
        self.shape = (int(ny), int(nx))
        self.spacing_mm = (self.period_mm[0] / nx, self.period_mm[1] / ny)
        self.cell_mm2 = self.spacing_mm[0] * self.spacing_mm[1]
        self.x_mm: Field = (np.arange(nx, dtype=np.float64) - (nx - 1) / 2) * self.spacing_mm[0]
        self.y_mm: Field = (np.arange(ny, dtype=np.float64) - (ny - 1) / 2) * self.spacing_mm[1]
        self._symbols = self._build_symbols()

    def apply(self, tractions_mpa: Field) -> Field:
        """Surface displacement (ny, nx, 3) in mm of tractions (ny, nx, 3) in MPa, all (x, y, z).

        Tractions act on the sensor's surface: a pressure p is t_z = -p and gives u_z < 0 below it.
        """
        return self.apply_patch(np.moveaxis(tractions_mpa, -1, 0), 0, 0)

    def apply_patch(self, tractions_mpa: Field, row: int, column: int) -> Field:
        """Displacement (ny, nx, 3) in mm of tractions (3, my, mx) that are zero outside a patch.

        row, column: grid index of the patch's first node. Same operator as `apply`, but the
        transform skips empty rows.
        """
        (_, my, mx), (ny, nx) = tractions_mpa.shape, self.shape
        padded = np.zeros((3, my, nx))
        padded[:, :, column : column + mx] = tractions_mpa
        half = np.zeros((3, ny, nx // 2 + 1), dtype=np.complex128)
        half[:, row : row + my] = scipy.fft.rfft(padded, axis=2, workers=1)
        tx, ty, tz = scipy.fft.fft(half, axis=1, workers=1, overwrite_x=True)
        xx, yy, xy, zz, xz, yz = self._symbols
        u = np.empty_like(half)
        u[0] = xx * tx + xy * ty - 1j * xz * tz
        u[1] = xy * tx + yy * ty - 1j * yz * tz
        u[2] = zz * tz + 1j * (xz * tx + yz * ty)
        displacement = scipy.fft.irfft2(u, s=(ny, nx), axes=(1, 2), workers=1, overwrite_x=True)
        return np.moveaxis(displacement, 0, -1)

    def window(self, my: int, mx: int, row: int = 0, column: int = 0) -> WindowOperator:
        """Operator from tractions to displacements within a my x mx patch.

        row, column: of the patch's first node, unused: the layer is homogeneous.
        """
        return WindowOperator(self._kernels, my, mx)

    def _build_symbols(self) -> Field:
        """Real symbols (6, ny, nx/2 + 1): xx, yy, xy, zz and the odd xz, yz without their -i."""
        ny, nx = self.shape
        dx, dy = self.spacing_mm
        kx = 2 * np.pi * scipy.fft.rfftfreq(nx, dx)[None, :]
        ky = 2 * np.pi * scipy.fft.fftfreq(ny, dy)[:, None]
        k = np.hypot(kx, ky)
        c = surface_compliance(k, self.thickness_mm, self.material)
        safe = np.where(k == 0, 1.0, k)
        # A wave at the Nyquist number has no sign, so odd parts must vanish there.
        odd_x = np.where(np.arange(nx // 2 + 1)[None, :] == nx // 2, 0.0, kx) / safe
        odd_y = np.where(np.arange(ny)[:, None] == ny // 2, 0.0, ky) / safe
        x2 = np.where(k == 0, 0.5, (kx / safe) ** 2)
        return np.stack(
            [
                x2 * c.longitudinal + (1 - x2) * c.transverse,
                (1 - x2) * c.longitudinal + x2 * c.transverse,
                odd_x * odd_y * (c.longitudinal - c.transverse),
                c.normal,
                odd_x * c.coupling,
                odd_y * c.coupling,
            ]
        )

    @cached_property
    def _kernels(self) -> Field:
        """Point responses (6, ny, nx), offset 0 first: xx, yy, xy, zz, xz (u_x of t_z), yz."""
        spectra = self._symbols.astype(np.complex128)
        spectra[4:] *= -1j
        kernels: Field = scipy.fft.irfft2(spectra, s=self.shape, axes=(1, 2), workers=1)
        return kernels


class WindowOperator:
    """Convolution of the layer restricted to a patch of my x mx nodes.

    The periodic kernel is cut to the offsets of the patch and embedded in a transform of about
    twice the patch, so a small contact costs a small transform without truncating the
    layer. Fields are (my, mx), in-plane vectors (2, my, mx).
    """

    def __init__(self, kernels: Field, my: int, mx: int) -> None:
        ny, nx = kernels.shape[1:]
        if 2 * my > ny or 2 * mx > nx:
            raise InputError(
                f"layer: contact window of {my} x {mx} nodes exceeds half the period of "
                f"{ny} x {nx}; more padding is needed"
            )
        self.shape = (my, mx)
        self._size = (even_fast_length(2 * my), even_fast_length(2 * mx))
        small = np.zeros((6, *self._size))
        iy, ix = np.r_[0:my, 1 - my : 0], np.r_[0:mx, 1 - mx : 0]
        small[:, iy[:, None], ix[None, :]] = kernels[:, iy[:, None], ix[None, :]]
        spectra = scipy.fft.rfft2(small, axes=(1, 2), workers=1)
        # Even kernels have real spectra, odd ones imaginary; keeping only that halves the work.
        self._xx, self._yy, self._xy, self._zz = spectra[:4].real.copy()
        self._xz, self._yz = spectra[4:].imag.copy()

    def _forward(self, field: Field) -> Spectrum:
        return scipy.fft.rfft2(field, s=self._size, axes=(-2, -1), workers=1)

    def _back(self, spectrum: Spectrum) -> Field:
        my, mx = self.shape
        out = scipy.fft.irfft2(spectrum, s=self._size, axes=(-2, -1), workers=1, overwrite_x=True)
        return out[..., :my, :mx]

    def normal_of_pressure(self, pressure: Field) -> Field:
        """Depth (mm, into the gel) due to a pressure (MPa); symmetric, positive definite."""
        return self._back(self._zz * self._forward(pressure))

    def shear_of_pressure(self, pressure: Field) -> Field:
        """In-plane displacement (2, my, mx) due to a pressure."""
        f = -1j * self._forward(pressure)
        return self._back(np.stack([self._xz * f, self._yz * f]))

    def shear_of_shear(self, traction: Field) -> Field:
        """In-plane displacement due to in-plane traction; symmetric, positive definite."""
        fx, fy = self._forward(traction)
        return self._back(np.stack([self._xx * fx + self._xy * fy, self._xy * fx + self._yy * fy]))

    def normal_of_shear(self, traction: Field) -> Field:
        """Depth (mm, into the gel) due to an in-plane traction."""
        fx, fy = self._forward(traction)
        return self._back(1j * (self._xz * fx + self._yz * fy))


def even_fast_length(minimum: float) -> int:
    """Smallest even length >= `minimum` that is fast for the real transform."""
    return 2 * int(scipy.fft.next_fast_len(math.ceil(minimum / 2 - 1e-9), real=True))


PUNCH_NODES = 48  # by hand: Gauss points on the radius, ten digits up to radius/h = 2


def flat_punch_n_per_mm(radius_mm: float, thickness_mm: float, material: GelMaterial) -> float:
    """Stiffness (N/mm) of a flat cylindrical punch on the bonded layer.

    A Fredholm equation of the second kind (after Lebedev and Ufliand, J. Appl. Math. Mech. 22,
    1958): with the layer's compliance written as (1 - nu)/(G k) M(k h) and the pressure's transform
    as G/(1 - nu) int_0^a phi(t) cos(k t) dt,
        phi(t) - 2/pi int_0^a phi(s) int_0^inf (1 - M(k h)) cos(k s) cos(k t) dk ds = 2/pi,
    and F = 2 pi G/(1 - nu) int_0^a phi dt.
    """
    stiffness = material.shear_modulus_mpa / (1 - material.poisson)
    t, weight = np.polynomial.legendre.leggauss(PUNCH_NODES)
    t, weight = radius_mm * (t + 1) / 2, radius_mm * weight / 2
    # 1 - M decays as (k h)^2 exp(-2 k h): negligible at k h = 24.
    ratio = radius_mm / thickness_mm
    k, weight_k = np.polynomial.legendre.leggauss(max(96, int(48 * ratio) + 64))
    k, weight_k = 12 * (k + 1) / thickness_mm, 12 * weight_k / thickness_mm
    deficit = 1 - surface_compliance(k, thickness_mm, material).normal * stiffness * k
    waves = np.cos(np.outer(t, k))
    kernel = (waves * (2 / math.pi * weight_k * deficit)) @ waves.T
    phi = np.linalg.solve(np.eye(PUNCH_NODES) - kernel * weight, np.full(PUNCH_NODES, 2 / math.pi))
    return float(2 * math.pi * stiffness * (weight @ phi))
