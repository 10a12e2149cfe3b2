"""What a drawing has to say of a solid: a length for every coordinate, a label for every round.

Along each axis the coordinates of all faces and centres are nodes, and each length joins two of
them. A drawing is complete when all of them hang together with the datum: the middle of a part that
has pairs of faces about it, else its lowest face. What the part's own file says comes first, for it
knows what fits; every coordinate that is still open gets a length from the datum.

Two coordinates that lie evenly about the middle count as one, as a drawing with a centre line has
it, and so does a length whose middle is a centre. What closes a loop is said twice.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ..features import OtherFace, Round, SolidFeatures
from .dimensioning import Callouts, Told, shown

AXES = "xyz"
SAME_MM = 1e-4
ROUND_SHARE = 1e-3  # of a radius: what is equally far from the middle


@dataclass(frozen=True)
class Rounds:
    """Equal rounds, which one label tells. words: what that label says."""

    alike: tuple[Round, ...]
    words: str

    @property
    def first(self) -> Round:
        return self.alike[0]

    @property
    def about_middle(self) -> bool:
        """Whether it is one about the frame's own axis: its diameter is a length."""
        where = [c for i, c in enumerate(self.first.low_mm) if i != self.first.axis]
        return len(self.alike) == 1 and math.hypot(*where) < SAME_MM and self.first.turn_deg > 180


@dataclass(frozen=True)
class Scheme:
    """lengths: along the axes; rounds: labelled; others: equal faces of other kinds, labelled.

    middle: axes (0, 1, 2) whose datum is the middle. faults: what the drawing lacks or says twice,
    each as one sentence's beginning.
    """

    lengths: tuple[Told, ...]
    rounds: tuple[Rounds, ...]
    others: tuple[tuple[tuple[OtherFace, ...], str], ...]
    middle: tuple[int, ...]
    faults: tuple[str, ...]


def scheme(found: SolidFeatures, said: Callouts) -> Scheme:
    """The scheme of a solid whose part says what fits."""
    groups = _grouped(found, said)
    on_circle = {r for group in groups if " apart" in group.words for r in group.alike}
    lengths: list[Told] = []
    faults: list[str] = []
    middle = []
    for axis in range(3):
        chain = _Chain(axis, found, said, on_circle)
        for told in said.lengths:
            if told.axis == axis:
                faults += chain.join(told)
        chain.complete()
        lengths += chain.lengths
        if chain.even:
            middle.append(axis)
    printed = _printed(lengths, groups, said)
    open_faces: dict[tuple[object, ...], list[OtherFace]] = {}
    for other in found.other_faces:
        if not _is_told(other, found, printed):
            key = (other.kind, *(round(size, 6) for size in other.sizes[:1]))
            open_faces.setdefault(key, []).append(other)
    others = []
    for alike in open_faces.values():
        words = _face_words(alike)
        if words:
            others.append((tuple(alike), words))
        else:
            where = ", ".join(map(shown, alike[0].point))
            faults.append(f"no number for the {alike[0].kind} at ({where})")
    return Scheme(tuple(lengths), tuple(groups), tuple(others), tuple(middle), tuple(faults))


def _face_words(alike: Sequence[OtherFace]) -> str:
    """The label of equal faces of another kind; empty where no single number gives their form."""
    forms = {"SR": "SR{}", "R": "R{}", "cone": "{}° to the axis"}
    if alike[0].kind not in forms:
        return ""
    count = f"{len(alike)}× " if len(alike) > 1 else ""
    return count + forms[alike[0].kind].format(shown(alike[0].sizes[0]))


@dataclass
class _Chain:
    """The coordinates of one axis, and which of them lengths have joined."""

    axis: int
    found: SolidFeatures
    said: Callouts
    on_circle: set[Round]
    lengths: list[Told] = field(default_factory=list)

    def __post_init__(self) -> None:
        from scipy.cluster.hierarchy import DisjointSet

        k, found = self.axis, self.found
        self.planes = {_key(p.at_mm) for p in found.planes if p.axis == k}
        self.ends = {_key(found.low_mm[k]), _key(found.high_mm[k])}
        self.rounds = [r for r in found.rounds if r.axis != k]
        spheres = [c for o in found.other_faces if (c := o.centre[k]) is not None]
        self.axes = {_key(c) for axis, c in self.said.axes if axis == k}
        self.centres = self.axes | {_key(c) for c in spheres}
        self.centres |= {_key(r.low_mm[k]) for r in self.rounds if not r.rounds_an_edge}
        self.nodes = self.planes | self.ends | self.centres
        self.nodes |= {_key(r.low_mm[k]) for r in self.rounds}
        # What one number gives: the same place on either side, or about each of several axes.
        self.same = DisjointSet({-n for n in self.nodes} | self.nodes)
        # What lengths have joined.
        self.joined = DisjointSet()
        self.even = any(node > 0 and self._paired(node) for node in self.nodes)
        self.datum = 0 if self.even or 0 in self.centres else min(self.ends)
        for node in self.nodes:
            if node > 0 and self._paired(node):
                self.same.merge(node, -node)
            if (alike := self._alike(node)) is not None:
                self.same.merge(node, alike)
        self._join_rounds()

    def _join_rounds(self) -> None:
        """What radius and depth, which labels tell, join without a length."""
        k = self.axis
        for r in self.rounds:
            at = _key(r.low_mm[k])
            bounds = self.ends if r.full_turn else self.ends | self.planes
            for side in (-1, 1):
                edge = _key(r.low_mm[k] + side * r.radius_mm)
                if edge in bounds and not (r.full_turn and r.hole):
                    self._union(at, edge)
            if r in self.on_circle:
                self._union(at, self.datum)
        for o in self.found.other_faces:
            centre = o.centre[k]
            if centre is not None:
                for side in (-1, 1):
                    edge = _key(centre + side * o.sizes[0])
                    if edge in self.ends | self.planes:
                        self._union(_key(centre), edge)
        for r in self.found.rounds:
            if r.axis == k and r.blind:
                self._union(_key(r.low_mm[k]), _key(r.high_mm[k]))

    def join(self, told: Told) -> Iterator[str]:
        """Take a length of the part's own; the faults in it."""
        a, b = _key(told.a_mm), _key(told.b_mm)
        name = f"{shown(told.value_mm)} along {AXES[self.axis]}"
        for end in (a, b):
            if not self._reach(end):
                yield f"{name} ends at {shown(end * SAME_MM)}, where the part has nothing"
        middle = self._middle(a, b)
        ends = self._find(a), self._find(b)
        if middle is not None and self.same.connected(a, b):
            ends = ends[0], self._find(middle)
        if ends[0] == ends[1]:
            yield f"{name} follows from what is said already"
        self._add(told)

    def complete(self) -> None:
        """A length for every coordinate that is still open, and the whole size."""
        self._in_rows()
        self._across_slots()

        def rank(n: int) -> tuple[bool, bool, bool, int, int]:
            """Of what hangs together a centre is placed, else what is even about the middle."""
            return n not in self.axes, n not in self.centres, not self._paired(n), -abs(n), n

        for node in sorted(self.nodes, key=rank):
            if not self._is_said(node):
                self._open(self.datum, node)
        low, high = min(self.ends) * SAME_MM, max(self.ends) * SAME_MM
        told = {_key(t.value_mm) for t in self.lengths}
        if _key(high - low) not in told and not self._is_diameter(low, high):
            self.lengths.append(Told(self.axis, low, high, fitted=False, auxiliary=True))

    def _is_diameter(self, low_mm: float, high_mm: float) -> bool:
        """Whether a round about the middle is as wide as the part."""
        return any(
            _key(2 * r.radius_mm) == _key(high_mm - low_mm) and r.turn_deg > 180
            for r in self.rounds
        )

    def _open(self, a: int, b: int) -> None:
        if self._paired(b):
            a, b = -abs(b), abs(b)
        if a != b:
            low, high = sorted((a, b))
            self._add(Told(self.axis, low * SAME_MM, high * SAME_MM, fitted=False))

    def _in_rows(self) -> None:
        """Three and more centres at equal steps, in a row, are one length."""
        rows: dict[tuple[object, ...], set[int]] = {}
        for r in self.rounds:
            rest = (_key(c) for i, c in enumerate(r.low_mm) if i not in (self.axis, r.axis))
            row = rows.setdefault((r.axis, r.hole, r.turn_deg > 180, *rest), set())
            row.add(_key(r.low_mm[self.axis]))
        for row in rows.values():
            loose = sorted(n for n in row if not self._is_said(n) and not self._paired(n))
            steps = {round((b - a) * SAME_MM, 3) for a, b in pairwise(loose)}
            if len(loose) > 2 and len(steps) == 1:
                before = f"{len(loose) - 1} × {shown(steps.pop())} = "
                a, b = loose[0] * SAME_MM, loose[-1] * SAME_MM
                self.lengths.append(Told(self.axis, a, b, before=before, fitted=False))
                for node in loose:
                    self._union(node, loose[0])

    def _across_slots(self) -> None:
        """Two faces that look at each other evenly about a centre are one length."""
        k, faces = self.axis, self.found.planes
        lows = {_key(p.at_mm) for p in faces if p.axis == k and p.up}
        highs = {_key(p.at_mm) for p in faces if p.axis == k and not p.up}
        for centre in sorted(self.centres - {0}):
            for high in sorted(h for h in highs if h > centre):
                low = 2 * centre - high
                joined = {self._find(n) for n in (low, high)}
                if low in lows and not joined & {self._find(centre), self._find(self.datum)}:
                    self._add(Told(k, low * SAME_MM, high * SAME_MM, fitted=False))
                    break

    def _add(self, told: Told) -> None:
        self.lengths.append(told)
        a, b = _key(told.a_mm), _key(told.b_mm)
        self._union(a, b)
        if (middle := self._middle(a, b)) is not None:
            self._union(a, middle)

    def _middle(self, a: int, b: int) -> int | None:
        """The centre about which a length lies evenly."""
        at = (a + b) // 2
        known = self.centres | ({0} if self.even else set())
        return at if (a + b) % 2 == 0 and at in known else None

    def _reach(self, end: int) -> bool:
        """Whether something is there: a node, the middle, or the side of a round."""
        if end in self.nodes or (end == 0 and self.even):
            return True
        for r in (*self.rounds, *self.found.edges):
            at = _key(r.low_mm[self.axis])
            if r.axis != self.axis and abs(abs(end - at) - _key(r.radius_mm)) <= 1:
                if r.length_mm > 0:  # its own label says its radius
                    self._union(at, end)
                return True
        return False

    def _paired(self, node: int) -> bool:
        """Whether the same lies as far on the other side of the middle."""
        if node == 0 or -node not in self.nodes:
            return False
        return (node in self.planes) == (-node in self.planes) and self._rounds_at(
            node
        ) == self._rounds_at(-node)

    def _rounds_at(self, node: int) -> set[tuple[int, ...]]:
        k = self.axis
        return {
            (r.axis, _key(r.radius_mm), *(_key(c) for i, c in enumerate(r.low_mm) if i != k))
            for r in self.rounds
            if _key(r.low_mm[k]) == node
        }

    def _alike(self, node: int) -> int | None:
        """The same place about the first of the axes that the part declares as alike."""
        if len(self.axes) < 2 or node in self.ends | self.axes:
            return None
        first = min(self.axes)
        nearest = min(self.axes, key=lambda a: (abs(node - a), a))
        same = node - nearest + first
        return same if nearest != first and same in self.nodes else None

    def _is_said(self, node: int) -> bool:
        return self._find(node) == self._find(self.datum)

    def _find(self, node: int) -> int:
        self.same.add(node)
        alike = self.same[node]
        self.joined.add(alike)
        return int(self.joined[alike])

    def _union(self, a: int, b: int) -> None:
        self.joined.merge(self._find(a), self._find(b))


def _key(value_mm: float) -> int:
    return round(value_mm / SAME_MM)


def _grouped(found: SolidFeatures, said: Callouts) -> list[Rounds]:
    """Equal rounds together, with their labels."""
    groups: dict[tuple[object, ...], list[Round]] = {}
    for r in found.rounds:
        key: tuple[object, ...] = (_key(r.radius_mm), r.hole, r.rounds_an_edge, r.axis == 2)
        if not r.rounds_an_edge or r.axis == 2:
            key = (*key, r.axis, r.turn_deg > 180, r.blind, _key(r.length_mm))
        groups.setdefault(key, []).append(r)
    return [Rounds(tuple(group), _words(group, found, said)) for group in groups.values()]


def _words(group: Sequence[Round], found: SolidFeatures, said: Callouts) -> str:
    first, count = group[0], len(group)
    diameter = 2 * first.radius_mm
    own = next((w for d, w in said.rounds.items() if abs(d - diameter) < 1e-6), None)
    sort = f"Ø{shown(diameter)}" if first.turn_deg > 180 else f"R{shown(first.radius_mm)}"
    words = (f"{count}× " if count > 1 else "") + sort
    if first.hole and first.turn_deg > 180:
        words += f" depth {shown(first.length_mm)}" if first.blind else " through"
    if own:
        words += f" {own}"
    return words + _circle(group, found)


def _circle(group: Sequence[Round], found: SolidFeatures) -> str:
    """Where rounds stand evenly on a circle about the middle: a round part's holes, corners."""
    axis, r = group[0].axis, group[0].radius_mm
    plan = [i for i in range(3) if i != axis]
    at = np.array([[g.low_mm[i] for i in plan] for g in group])
    radius = np.hypot(at[:, 0], at[:, 1])
    if len(group) < 3 or np.ptp(radius) > ROUND_SHARE * radius.max():
        return ""
    if group[0].full_turn:
        evenly = any(
            o.axis == axis and not o.hole and o.full_turn and o.radius_mm > radius.max()
            and math.hypot(*(o.low_mm[i] for i in plan)) < SAME_MM
            for o in found.rounds
        )  # fmt: skip
    else:  # a corner between two faces follows from them
        edges = [{_key(p.at_mm) for p in found.planes if p.axis == i} for i in plan]
        evenly = not all(
            edges[j] & {_key(c - r), _key(c + r)} for row in at for j, c in enumerate(row)
        )
    angle = np.sort(np.degrees(np.arctan2(at[:, 1], at[:, 0])).round(6) % 360)
    step = 360 / len(group)
    if not evenly or np.abs(np.diff(angle) - step).max() > 0.01:
        return ""
    return f", on Ø{shown(2 * radius[0])}, {shown(step)}° apart, first at {shown(angle[0])}°"


def _printed(lengths: Sequence[Told], groups: Sequence[Rounds], said: Callouts) -> list[float]:
    """Every number of the drawing."""
    texts = [*(g.words for g in groups), *(i.words for i in said.labels), *said.notes]
    numbers = [float(n) for text in texts for n in re.findall(r"\d+(?:\.\d+)?", text)]
    return numbers + [told.value_mm for told in lengths]


def _is_told(other: OtherFace, found: SolidFeatures, printed: Sequence[float]) -> bool:
    """Whether a number tells a face of another kind, or what it touches does."""
    said = any(abs(size - number) < 0.006 for size in other.sizes for number in printed)
    if other.kind != "slant":
        return said
    normal, at = np.array(other.normal), np.array(other.point)
    touched = 0
    for r in found.rounds:
        away = abs(float((np.array(r.low_mm) - at) @ normal))
        touched += abs(away - r.radius_mm) < 1e-4 and abs(normal[r.axis]) < 1e-6
    return touched > 1 or (said and touched == 1)
