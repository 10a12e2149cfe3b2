"""Dimensioning scheme of a solid: a length for every coordinate, a label for every round.

Along each axis the coordinates of faces and centres are nodes of a graph and lengths its edges. A
drawing is complete when every node is connected to the datum: the middle of a symmetric part, else
its lowest face. The callouts' fitted lengths come first; every node still open gets a length from
the datum.

Two nodes symmetric about the middle count as one, as a centre line implies; so does a length whose
middle is a centre. A length that closes a loop is redundant.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ..features import OtherFace, Round, SolidFeatures, closes
from .dimensioning import Callouts, Span, fmt

AXIS_NAMES = "xyz"
# By hand: coordinates and radii (share) that count as equal; below any process, above rounding.
GRID_MM, CIRCLE_TOLERANCE = 1e-4, 1e-3
PRINTED_MM = 0.0051  # by hand: half of the last printed digit


@dataclass(frozen=True)
class Rounds:
    """Equal rounds with one common label; words: its text."""

    members: tuple[Round, ...]
    label: str

    @property
    def first(self) -> Round:
        return self.members[0]

    @property
    def about_middle(self) -> bool:
        """True for a single round about the part's axis: its diameter is drawn as a length."""
        first = self.first
        centre = [c for i, c in enumerate(first.low_mm) if i != first.axis]
        return len(self.members) == 1 and math.hypot(*centre) < GRID_MM and first.by_diameter


@dataclass(frozen=True)
class Scheme:
    """Lengths along the axes, labelled rounds, and labels of equal faces of other kinds.

    middle: axes (0, 1, 2) whose datum is the middle. faults: missing or redundant dimensions.
    """

    lengths: tuple[Span, ...]
    rounds: tuple[Rounds, ...]
    other_faces: tuple[tuple[tuple[OtherFace, ...], str], ...]
    middle: tuple[int, ...]
    faults: tuple[str, ...]


def scheme(features: SolidFeatures, callouts: Callouts) -> Scheme:
    """Build the scheme of a solid; callouts: fitted lengths and labels of its part."""
    groups = _group_rounds(features, callouts)
    labels = {r: group.label for group in groups for r in group.members}
    lengths: list[Span] = []
    faults: list[str] = []
    middle = []
    for axis in range(3):
        chain = _Chain(axis, features, callouts, labels)
        for length in callouts.lengths:
            if length.axis == axis:
                faults += chain.join(length)
        chain.complete()
        lengths += chain.lengths
        if chain.even:
            middle.append(axis)
    texts = [*labels.values(), *(leader.text for leader in callouts.labels), *callouts.notes]
    open_faces: dict[tuple[object, ...], list[OtherFace]] = {}
    for face in features.other_faces:
        if not _is_dimensioned(face, features, "\n".join(texts)):
            key = (face.kind, *(round(size, 6) for size in face.sizes[:1]))
            open_faces.setdefault(key, []).append(face)
    labelled = []
    for faces in open_faces.values():
        words = _face_label(faces)
        if words:
            labelled.append((tuple(faces), words))
        else:
            place = ", ".join(map(fmt, faces[0].point))
            faults.append(f"no dimension for the {faces[0].kind} at ({place})")
    return Scheme(tuple(lengths), tuple(groups), tuple(labelled), tuple(middle), tuple(faults))


def _face_label(faces: Sequence[OtherFace]) -> str:
    """Label of equal faces of another kind; empty if one number does not define their form."""
    forms = {"SØ": "SØ{}", "SR": "SR{}", "R": "R{}", "cone": "{}° to the axis"}
    if faces[0].kind not in forms:
        return ""
    count = f"{len(faces)}× " if len(faces) > 1 else ""
    return count + forms[faces[0].kind].format(fmt(faces[0].sizes[0]))


@dataclass
class _Chain:
    """Coordinates of one axis, and their connections by lengths and by what the labels say."""

    axis: int
    features: SolidFeatures
    callouts: Callouts
    labels: Mapping[Round, str]
    lengths: list[Span] = field(default_factory=list)

    def __post_init__(self) -> None:
        from scipy.cluster.hierarchy import DisjointSet

        k, features = self.axis, self.features
        self.planes = {_key(p.at_mm) for p in features.planes if p.axis == k}
        self.ends = {_key(features.low_mm[k]), _key(features.high_mm[k])}
        self.rounds = [r for r in features.rounds if r.axis != k]
        middles = [(o.kind, c) for o in features.other_faces if (c := o.centre[k]) is not None]
        spheres = [c for kind, c in middles if kind != "R"]
        self.axes = {_key(c) for axis, c in self.callouts.axes if axis == k}
        self.centres = self.axes | {_key(c) for c in spheres}
        self.centres |= {_key(r.low_mm[k]) for r in self.rounds if not r.rounds_an_edge}
        self.nodes = self.planes | self.ends | self.centres
        self.nodes |= {_key(r.low_mm[k]) for r in self.rounds} | {_key(c) for _, c in middles}
        # A round may end without a face there, at a cone or a rounded edge.
        rims = {(e.axis, _key(e.radius_mm), *map(_key, e.low_mm)) for e in features.edges}
        self.nodes |= {
            _key(end[k])
            for r in features.rounds
            for end in (r.low_mm, r.high_mm)
            if r.axis == k and (k, _key(r.radius_mm), *map(_key, end)) in rims
        }
        # Nodes given by one number: mirrored about the middle, or repeated about several axes.
        self.same = DisjointSet({-n for n in self.nodes} | self.nodes)
        # Nodes connected by lengths.
        self.joined = DisjointSet()
        self.even = any(node > 0 and self._is_symmetric(node) for node in self.nodes)
        self.datum = 0 if self.even or 0 in self.centres else min(self.ends)
        for node in self.nodes:
            if node > 0 and self._is_symmetric(node):
                self.same.merge(node, -node)
            if (counterpart := self._counterpart(node)) is not None:
                self.same.merge(node, counterpart)
        self._join_rounds()

    def _join_rounds(self) -> None:
        """Connect nodes by the radius, circle or depth that a label says."""
        k, labels = self.axis, self.labels
        for r in self.rounds:
            if not (_says(labels[r], "Ø", 2 * r.radius_mm) or _says(labels[r], "R", r.radius_mm)):
                continue
            centre_node = _key(r.low_mm[k])
            bounds = self.ends if r.full_turn else self.ends | self.planes
            for side in (-1, 1):
                edge = _key(r.low_mm[k] + side * r.radius_mm)
                # A rounded edge touches what it bulges towards; the far side equals by chance.
                if r.rounds_an_edge and side * (r.point[k] - r.low_mm[k]) <= 0:
                    continue
                if edge in bounds and not (r.full_turn and r.hole):
                    self._union(centre_node, edge)
            if " apart" in labels[r]:
                self._union(centre_node, self.datum)
        for o in self.features.other_faces:
            centre = o.centre[k]
            if centre is not None:
                for side in (-1, 1):
                    edge = _key(centre + side * min(o.sizes))
                    if edge in self.ends | self.planes:
                        self._union(_key(centre), edge)
        # A depth locates the floor of its hole, not a face that happens to be level with it.
        deep = [r for r in labels if r.axis == k and _says(labels[r], "depth ", r.length_mm)]
        faces = [p for p in self.features.planes if p.axis == k]
        level = {_key(p.at_mm) for p in faces if not any(closes(p, r) for r in deep)}
        for r in deep:
            end = _key((r.low_mm if r.blind == "low" else r.high_mm)[k])
            if end not in level | self.centres:
                self._union(_key(r.low_mm[k]), _key(r.high_mm[k]))

    def join(self, length: Span) -> Iterator[str]:
        """Add a length of the callouts; yield its faults."""
        a, b = _key(length.a_mm), _key(length.b_mm)
        name = f"{fmt(length.value_mm)} along {AXIS_NAMES[self.axis]}"
        for end in (a, b):
            if not self._has_feature(end):
                yield f"{name} ends at {fmt(end * GRID_MM)}, where the part has no feature"
        middle = self._middle(a, b)
        ends = self._find(a), self._find(b)
        if middle is not None and self.same.connected(a, b):
            ends = ends[0], self._find(middle)
        if ends[0] == ends[1]:
            yield f"{name} is redundant: it follows from other lengths"
        self._add(length)

    def complete(self) -> None:
        """Add a length for every open coordinate, and the overall size."""
        self._add_rows()
        self._add_slots()

        def rank(n: int) -> tuple[bool, bool, bool, bool, int, int]:
            """Sort key: of connected nodes place a centre, else a face, else a symmetric one."""
            kinds = n not in self.axes, n not in self.centres, n not in self.planes
            return *kinds, not self._is_symmetric(n), -abs(n), n

        for node in sorted(self.nodes, key=rank):
            if not self._is_located(node):
                self._add_from_datum(self.datum, node)
        low, high = min(self.ends) * GRID_MM, max(self.ends) * GRID_MM
        known_lengths = {_key(t.value_mm) for t in self.lengths}
        if _key(high - low) not in known_lengths and not self._is_diameter(low, high):
            self.lengths.append(Span(self.axis, low, high, fitted=False, auxiliary=True))

    def _is_diameter(self, low_mm: float, high_mm: float) -> bool:
        """True if a round about the middle spans the part."""
        return any(
            _key(2 * r.radius_mm) == _key(high_mm - low_mm) and r.by_diameter for r in self.rounds
        )

    def _add_from_datum(self, a: int, b: int) -> None:
        if self._is_symmetric(b):
            a, b = -abs(b), abs(b)
        if a != b:
            low, high = sorted((a, b))
            self._add(Span(self.axis, low * GRID_MM, high * GRID_MM, fitted=False))

    def _add_rows(self) -> None:
        """Dimension three or more centres at equal steps in a row by one length."""
        rows: dict[tuple[object, ...], set[int]] = {}
        for r in self.rounds:
            rest = (_key(c) for i, c in enumerate(r.low_mm) if i not in (self.axis, r.axis))
            row = rows.setdefault((r.axis, r.hole, r.by_diameter, *rest), set())
            row.add(_key(r.low_mm[self.axis]))
        for row in rows.values():
            loose = sorted(n for n in row if not self._is_located(n) and not self._is_symmetric(n))
            steps = {round((b - a) * GRID_MM, 3) for a, b in pairwise(loose)}
            if len(loose) > 2 and len(steps) == 1:
                prefix = f"{len(loose) - 1} × {fmt(steps.pop())} = "
                a, b = loose[0] * GRID_MM, loose[-1] * GRID_MM
                self.lengths.append(Span(self.axis, a, b, prefix=prefix, fitted=False))
                for node in loose:
                    self._union(node, loose[0])

    def _add_slots(self) -> None:
        """Dimension two opposed faces symmetric about a centre by one length."""
        k, faces = self.axis, self.features.planes
        lows = {_key(p.at_mm) for p in faces if p.axis == k and p.up}
        highs = {_key(p.at_mm) for p in faces if p.axis == k and not p.up}
        for centre in sorted(self.centres - {0}):
            for high in sorted(h for h in highs if h > centre):
                low = 2 * centre - high
                joined = {self._find(n) for n in (low, high)}
                if low in lows and not joined & {self._find(centre), self._find(self.datum)}:
                    self._add(Span(k, low * GRID_MM, high * GRID_MM, fitted=False))
                    break

    def _add(self, length: Span) -> None:
        self.lengths.append(length)
        a, b = _key(length.a_mm), _key(length.b_mm)
        self._union(a, b)
        if (middle := self._middle(a, b)) is not None:
            self._union(a, middle)

    def _middle(self, a: int, b: int) -> int | None:
        """Return the centre at the middle of a length, if any."""
        mid = (a + b) // 2
        centres = self.centres | ({0} if self.even else set())
        return mid if (a + b) % 2 == 0 and mid in centres else None

    def _has_feature(self, end: int) -> bool:
        """True if a feature is there: a node, the middle, or the side of a round."""
        if end in self.nodes or (end == 0 and self.even):
            return True
        for r in (*self.rounds, *self.features.edges):
            centre = _key(r.low_mm[self.axis])
            if r.axis != self.axis and abs(abs(end - centre) - _key(r.radius_mm)) <= 1:
                if r.length_mm > 0:  # its label gives the radius
                    self._union(centre, end)
                return True
        return False

    def _is_symmetric(self, node: int) -> bool:
        """True if the node has a mirror image about the middle."""
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

    def _counterpart(self, node: int) -> int | None:
        """Return the matching node about the first of the callouts' repeated axes."""
        if len(self.axes) < 2 or node in self.ends | self.axes:
            return None
        first = min(self.axes)
        nearest = min(self.axes, key=lambda a: (abs(node - a), a))
        same = node - nearest + first
        return same if nearest != first and same in self.nodes else None

    def _is_located(self, node: int) -> bool:
        return self._find(node) == self._find(self.datum)

    def _find(self, node: int) -> int:
        self.same.add(node)
        root = self.same[node]
        self.joined.add(root)
        return int(self.joined[root])

    def _union(self, a: int, b: int) -> None:
        self.joined.merge(self._find(a), self._find(b))


def _key(value_mm: float) -> int:
    return round(value_mm / GRID_MM)


def _group_rounds(features: SolidFeatures, callouts: Callouts) -> list[Rounds]:
    """Group equal rounds with their labels."""
    groups: dict[tuple[object, ...], list[Round]] = {}
    for r in features.rounds:
        key: tuple[object, ...] = (_key(r.radius_mm), r.hole, r.rounds_an_edge, r.axis == 2)
        if not r.rounds_an_edge or r.axis == 2:
            key = (*key, r.axis, r.by_diameter, r.blind, _key(r.length_mm))
        groups.setdefault(key, []).append(r)
    return [Rounds(tuple(g), _round_label(g, features, callouts)) for g in groups.values()]


def _round_label(group: Sequence[Round], features: SolidFeatures, callouts: Callouts) -> str:
    first, count = group[0], len(group)
    diameter = 2 * first.radius_mm
    callout = next((w for d, w in callouts.rounds.items() if abs(d - diameter) < 1e-6), None)
    label = f"Ø{fmt(diameter)}" if first.by_diameter else f"R{fmt(first.radius_mm)}"
    if first.blind and _opens_in_plane(first, features):
        label += f" depth {fmt(first.length_mm)}"
    elif first.hole and first.by_diameter and not first.blind:
        label += " through"
    if callout:
        label = callout.format(label) if "{}" in callout else f"{label} {callout}"
    return (f"{count}× " if count > 1 else "") + label + _circle_text(group, features)


def _opens_in_plane(hole: Round, features: SolidFeatures) -> bool:
    """True if a depth can be measured from the face that a blind hole is made in."""
    mouth = (hole.high_mm if hole.blind == "low" else hole.low_mm)[hole.axis]
    return any(p.axis == hole.axis and _key(p.at_mm - mouth) == 0 for p in features.planes)


def _circle_text(group: Sequence[Round], features: SolidFeatures) -> str:
    """Label text of rounds evenly spaced on a circle about the middle; empty if not."""
    axis, r = group[0].axis, group[0].radius_mm
    plan = [i for i in range(3) if i != axis]
    centres = np.array([[g.low_mm[i] for i in plan] for g in group])
    radius = np.hypot(centres[:, 0], centres[:, 1])
    if len(group) < 3 or np.ptp(radius) > CIRCLE_TOLERANCE * radius.max():
        return ""
    if group[0].full_turn:
        evenly = any(
            o.axis == axis and not o.hole and o.full_turn and o.radius_mm > radius.max()
            and math.hypot(*(o.low_mm[i] for i in plan)) < GRID_MM
            for o in features.rounds
        )  # fmt: skip
    else:  # a corner between two faces follows from them
        edges = [{_key(p.at_mm) for p in features.planes if p.axis == i} for i in plan]
        evenly = not all(
            edges[j] & {_key(c - r), _key(c + r)} for row in centres for j, c in enumerate(row)
        )
    angle = np.sort(np.degrees(np.arctan2(centres[:, 1], centres[:, 0])).round(6) % 360)
    step = 360 / len(group)
    if not evenly or np.abs(np.diff(angle) - step).max() > 0.01:
        return ""
    return f", on Ø{fmt(2 * radius[0])}, {fmt(step)}° apart, first at {fmt(angle[0])}°"


def _says(text: str, sign: str, value: float) -> bool:
    """True if a text has a number after this sign, or before it (`°`), that rounds to the value."""
    number = r"(?<![\d.])(\d+(?:\.\d+)?)"
    pattern = number + sign if sign == "°" else rf"(?<!S){sign}(\d+(?:\.\d+)?)"
    return any(abs(float(n) - value) < PRINTED_MM for n in re.findall(pattern, text))


def _is_dimensioned(face: OtherFace, features: SolidFeatures, text: str) -> bool:
    """True if a printed size of its form, or a round that it touches, defines the face."""
    if face.kind in ("SØ", "SR"):
        return False  # has its own label: that of a round of the same size describes the round
    sign = {"R": "R", "curve": ""}.get(face.kind, "°")
    size_printed = any(_says(text, sign, size) for size in face.sizes)
    if face.kind != "slant":
        return size_printed
    normal, point = np.array(face.normal), np.array(face.point)
    touched = 0
    for r in features.rounds:
        distance = abs(float((np.array(r.low_mm) - point) @ normal))
        touched += abs(distance - r.radius_mm) < 1e-4 and abs(normal[r.axis]) < 1e-6
    return touched > 1 or (size_printed and touched == 1)
