"""Presses of a protocol as planned: names, drags, repeats, random order and reference presses."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from deltact_fab.common import Point2
from deltact_fab.sensor import parse_indenter

from .tables import PressRole, ReferencePress, Shear


@dataclass(frozen=True)
class Press:
    """One press of a protocol, as planned.

    name: `indenter/pN` with its place N in the file, `rK` after it for the Kth repeat;
    `indenter/refK` for the Kth reference press. number: N or K. at_mm: position on the face.
    depths_mm: of its stops, increasing; empty for weights. shear: at each depth. role: use of its
    data. mounting: number of the mounting of an indenter in which it is made, from 0.
    """

    name: str
    number: int
    indenter: str
    at_mm: Point2
    depths_mm: tuple[float, ...]
    shear: Shear | Point2 | None
    role: PressRole = "fit"
    mounting: int = 0

    @property
    def legs(self) -> dict[float, tuple[tuple[str, Point2], ...]]:
        """Drags by depth: names, and ends relative to the press in mm."""
        return {d: tuple(self._drags(d)) for d in self.depths_mm}

    def reach_mm(self, depth_mm: float) -> Point2:
        """Largest drag along x and y at a depth."""
        ends = [(0.0, 0.0), *(end for _, end in self.legs[depth_mm])]
        return max(abs(x) for x, _ in ends), max(abs(y) for _, y in ends)

    def as_dict(self) -> dict[str, Any]:
        """Row of the record."""
        x, y = self.at_mm
        drag = self.shear if isinstance(self.shear, tuple) else ()
        return {"name": self.name, "role": self.role, "indenter": self.indenter, "x_mm": x,
                "y_mm": y, "depths_mm": list(self.depths_mm),
                **dict(zip(("shear_x_mm", "shear_y_mm"), drag, strict=False))}  # fmt: skip

    def _drags(self, depth_mm: float) -> Iterator[tuple[str, Point2]]:
        """Yield names of the drags at a depth, and their ends relative to the press in mm.

        Returns to the centre are no stops.
        """
        shear = self.shear
        if not isinstance(shear, Shear):
            if shear is not None:
                yield f"shear-x{shear[0]:+.2f}y{shear[1]:+.2f}", shear
            return
        n, amplitude_mm = shear.points_per_side, shear.at_depth_mm(depth_mm)
        outward = shear.first == "outward"
        signs = [-1 if outward and coordinate < 0 else 1 for coordinate in self.at_mm]

        def name(axis: int, k: int) -> str:
            side = amplitude_mm * k / n
            text = f"{side:+.2f}" if k and n > 1 else "0+-"[k]
            return f"{'xy'[axis]}{text}"

        for i, j, axes in _square_spiral(n) if shear.grid else _cross_path(n, shear.axes):
            k = (signs[0] * i, signs[1] * j)
            leg = "shear-" + "".join(name(axis, k[axis]) for axis in axes)
            yield leg, (amplitude_mm * k[0] / n, amplitude_mm * k[1] / n)


def repeat_presses(presses: Sequence[tuple[Press, int]]) -> list[Press]:
    """All presses once, then those with a second repeat, and so on."""
    return [
        replace(press, name=f"{press.name}r{k}") if k > 1 else press
        for k in range(1, max((count for _, count in presses), default=0) + 1)
        for press, count in presses
        if count >= k
    ]


def shuffle_presses(presses: Sequence[Press], seed: int) -> list[Press]:
    """Presses in random order, those of role "reference" in their places.

    Sorted by a hash of seed and name: the same in every version of Python, and adding a press
    leaves the order of the others.
    """

    def draw(press: Press) -> bytes:
        return hashlib.sha256(f"{seed} {press.name}".encode()).digest()

    shuffled = iter(sorted((p for p in presses if p.role != "reference"), key=draw))
    return [press if press.role == "reference" else next(shuffled) for press in presses]


def add_references(
    presses: Sequence[Press], reference: ReferencePress, counts: Counter[str]
) -> Iterator[Press]:
    """Presses of a mounting with its reference presses. counts: of the earlier ones by indenter."""
    tip, depths_mm = presses[0].indenter, (reference.depth_mm,)
    for k, press in enumerate((*presses, None)):
        if k % reference.every == 0 or press is None:
            counts[tip] += 1
            name = f"{parse_indenter(tip).slug}/ref{counts[tip]}"
            yield Press(name, counts[tip], tip, reference.at_mm, depths_mm, None, "reference")
        if press is not None:
            yield press


def _cross_path(n: int, letters: Sequence[str]) -> Iterator[tuple[int, int, Sequence[int]]]:
    """Yield points of a cross: along each axis outwards, across to the other side, and back."""
    for axis in ("xy".index(letter) for letter in letters):
        for k in (*range(1, n + 1), *range(-1, -n - 1, -1), 0):
            yield (k, 0, (0,)) if axis == 0 else (0, k, (1,))


def _square_spiral(n: int) -> Iterator[tuple[int, int, Sequence[int]]]:
    """Yield points of a square in a spiral around (0, 0), and finally (0, 0)."""
    i = j = 0
    for ring in range(1, n + 1):
        i += 1
        yield i, j, (0, 1)
        # Up this side, then around the other three, to below the start.
        for di, dj, length in ((0, 1, 2 * ring - 1), (-1, 0, 2 * ring), (0, -1, 2 * ring),
                               (1, 0, 2 * ring)):  # fmt: skip
            for _ in range(length):
                i, j = i + di, j + dj
                yield i, j, (0, 1)
    yield 0, 0, (0, 1)
