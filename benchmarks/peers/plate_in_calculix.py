"""A quarter of the notched acrylic plate in CalculiX (ccx), from the command line.

Solid elements, nothing of the series of `fabricate/cad/stiffness.py`.
`tests/fabricate/cad/test_cad_stiffness.py` holds what `main` prints.

Plate and bead are C3D20R: quadratic, integrated at 8 points, so that a bead that keeps its volume
(Poisson's ratio 0.4999) does not lock. The bead is bonded to the plate and to a rigid ledge;
without a bead the plate is held on the inner edges of its ledges.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.stiffness import PlateShape, plate_of

DESIGNS = (
    (),
    ("shell.ledge_drop_mm=1.0", "shell.ledge_mm=1.5", "shell.ledge_x_mm=1.15"),
    ("shell.ledge_drop_mm=0", "shell.ledge_x_mm=0"),
)

# Corners, then middles of edges, in the order of C3D20R; in half steps of the element.
NODES = (
    (0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
    (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
    (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1),
)  # fmt: skip
LAYERS = 3  # of elements in a bead; a sixth of one's width is their breadth
BEAD_POISSON = 0.4999


@dataclass(frozen=True)
class Solution:
    """At nodes: places (n, 3) and displacements (n, 3) in mm, stresses (n, 6) in MPa."""

    places: np.ndarray
    moved: np.ndarray
    stresses: np.ndarray

    def at(self, x: float, y: float, z: float) -> int:
        return int(np.argmin(np.abs(self.places - (x, y, z)).sum(axis=1)))


def solve(
    plate: PlateShape, force_n: float, spread_mm: float, folder: Path, step_mm: float = 1.0
) -> Solution:
    """The plate from z = 0 (back) to its thickness under a press on its front, towards -z.

    The quarter x, y > 0 of a whole that is symmetric; the load is uniform on a disc about the
    middle.
    """
    axes = [_lines(plate, axis, step_mm) for axis in range(2)]
    below = np.linspace(-plate.bead_mm, 0, LAYERS + 1)[:-1] if plate.bead_mm > 0 else []
    axes.append(np.append(below, np.linspace(0, plate.thickness_mm, 3)))
    fine = [np.sort(np.concatenate([a, (a[1:] + a[:-1]) / 2])) for a in axes]
    number: dict[tuple[int, int, int], int] = {}
    elements, shares, bead = [], [], []
    (w, h), (nx, ny) = plate.half_mm, plate.notch_mm
    for i in range(len(axes[0]) - 1):
        for j in range(len(axes[1]) - 1):
            low = np.array([axes[0][i], axes[1][j]])
            size = np.array([axes[0][i + 1], axes[1][j + 1]]) - low
            middle = low + size / 2
            if middle[0] > w - nx and middle[1] > h - ny:
                continue
            for k in range(len(axes[2]) - 1):
                if k < len(below):
                    if (middle < plate.support_mm).all():
                        continue
                    bead.append(len(elements) + 1)
                at = [(2 * i + a, 2 * j + b, 2 * k + c) for a, b, c in NODES]
                elements.append([number.setdefault(key, len(number) + 1) for key in at])
                on_top = k == len(axes[2]) - 2
                shares.append(_covered(low, size, spread_mm / 2) if on_top else 0.0)
    places = np.array([[fine[a][key[a]] for a in range(3)] for key in number])
    area_mm2 = np.pi / 4 * spread_mm**2
    pressure = [force_n / area_mm2 * share for share in shares]
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n + 1}, {x:.9g}, {y:.9g}, {z:.9g}" for n, (x, y, z) in enumerate(places)]
    lines += ["*ELEMENT, TYPE=C3D20R, ELSET=PLATE"]
    for n, nodes in enumerate(elements, start=1):
        lines += [", ".join(map(str, [n, *nodes[:10]])) + ",", ", ".join(map(str, nodes[10:]))]
    acrylic = sorted({*range(1, len(elements) + 1)} - {*bead})
    modulus_mpa = plate.youngs_modulus_mpa
    for name, members, *law in (
        ("ACRYLIC", acrylic, modulus_mpa, plate.poisson),
        ("BEAD", bead, plate.bead_modulus_mpa, BEAD_POISSON),
    ):
        if members:
            lines += [f"*ELSET, ELSET={name}", *map(str, members), f"*MATERIAL, NAME={name}"]
            lines += ["*ELASTIC", ", ".join(map(str, law))]
            lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"]
    lines += ["*BOUNDARY"]
    for axis in range(2):
        lines += [f"{n + 1}, {axis + 1}" for n in np.flatnonzero(places[:, axis] == 0)]
    if plate.bead_mm > 0:
        lines += [f"{n + 1}, 1, 3" for n in np.flatnonzero(places[:, 2] < 1e-9 - plate.bead_mm)]
    else:
        edges = [abs(places[:, i] - plate.support_mm[i]) < 1e-9 for i in range(2)]
        edges[0] &= plate.support_mm[0] < w
        held = (edges[0] | edges[1]) & (places[:, 2] == 0)
        lines += [f"{n + 1}, 3" for n in np.flatnonzero(held)]
    lines += ["*STEP", "*STATIC", "*DLOAD"]
    lines += [f"{n}, P2, {p:.9g}" for n, p in enumerate(pressure, start=1) if p > 0]
    lines += ["*NODE FILE", "U, RF", "*EL FILE", "S", "*END STEP", ""]
    (folder / "plate.inp").write_text("\n".join(lines))
    done = subprocess.run(["ccx", "plate"], cwd=folder, capture_output=True, text=True, check=False)
    assert "Job finished" in done.stdout, done.stdout[-2000:]
    text = (folder / "plate.frd").read_text()
    moved, stresses = _block(text, "DISP", 3), _block(text, "STRESS", 6)
    return Solution(places, moved, stresses)


def _lines(plate: PlateShape, axis: int, step_mm: float) -> np.ndarray:
    """Planes between elements: at the notch, at the support, at the edge, and step_mm between.

    Over a ledge they are closer, for the bead.
    """
    half, support = plate.half_mm[axis], plate.support_mm[axis]
    marks = sorted({0.0, half - plate.notch_mm[axis], support, half})
    pieces = [
        np.linspace(a, b, 7 if a == support else int(np.ceil((b - a) / step_mm)) + 1)[:-1]
        for a, b in pairwise(marks)
    ]
    return np.append(np.concatenate(pieces), half)


def _covered(low: np.ndarray, size: np.ndarray, radius_mm: float) -> float:
    """Share of a rectangle that lies in a disc about the origin."""
    t = (np.arange(20) + 0.5) / 20
    x, y = np.meshgrid(low[0] + size[0] * t, low[1] + size[1] * t)
    return float((np.hypot(x, y) < radius_mm).mean())


def _block(text: str, name: str, columns: int) -> np.ndarray:
    """The nodal values of one result of a .frd file, by node."""
    rows = text.split(f" -4  {name}", 1)[1].splitlines()
    values = []
    for row in rows:
        if row.startswith(" -1"):
            values.append([float(row[13 + 12 * c : 25 + 12 * c]) for c in range(columns)])
        elif row.startswith(" -3"):
            break
    return np.array(values)


def main() -> None:
    """Deflection, that over the light holder (mm), stress below the middle (MPa) at 49 N."""
    for changes in DESIGNS:
        design = load_design(changes=changes)
        with tempfile.TemporaryDirectory() as folder:
            exact = solve(plate_of(design), 49.0, 22.0, Path(folder))
        back, sag = exact.places[:, 2] == 0, -exact.moved[:, 2]
        radius = np.hypot(*exact.places[:, :2].T)
        over = back & (radius >= design.light_bore_mm) & (radius <= design.light_radius_mm)
        stress_mpa = exact.stresses[exact.at(0, 0, 0), :2].max()
        print(f"{sag[back].max():.3f}, {sag[over].max():.3f}, {stress_mpa:.2f}  {changes}")


if __name__ == "__main__":
    main()
