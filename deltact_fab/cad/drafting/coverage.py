"""Whether a drawing says every dimension of its part, and each of them once.

Nothing is declared: each number of the part's table is changed a little, and what the drawing
prints is compared with what that does to volume and size. What changes these while all printed
numbers stay is not said, be it one key or several together; numbers that move as one are one length
said twice. No CAD kernel.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..design import IndenterDimensions
from ..dimensions import Design
from ..part import Part
from .dimensioning import Leader, Linear, exactly, shown
from .items import Callouts
from .projection import View
from .views import views_of

STEP = 1e-4  # mm, or whatever a key's unit is
SAME_MM = 1e-6
SAME_RATE = 1e-3  # of two derivatives
RANK = 1e-4  # of the largest singular value: below, numbers are one number
UNSAID = 3e-3  # of the steepest change of volume or size
# Not what counts equal features: `4× Ø1.8`, `6.4 (4×)`, `2 × 2 cavities`.
_NUMBER = re.compile(r"(?<![\d.])\d+(?:\.\d+)?(?![\d.]|\s*×)")


@dataclass(frozen=True)
class Coverage:
    """What a drawing lacks, each as one sentence's beginning: a key, or two printed numbers.

    unsaid: keys that shape the part while no number follows them. twice: lengths told twice.
    chains: lengths that follow from others on the same axis; a bracket would mark them auxiliary.
    followed: keys that some number follows.
    """

    unsaid: tuple[str, ...]
    twice: tuple[str, ...]
    chains: tuple[str, ...]
    followed: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Everything is said, once."""
        return not (self.unsaid or self.twice or self.chains)


def coverage(part: Part, design: Design) -> Coverage:
    """Hold the drawing of a part against the part's table. Raises ValueError without a drawing."""
    if part.callouts is None:
        raise ValueError(f"{part.name}: no drawing")
    source = part.source(design)
    said = part.callouts(source)
    names = [number.name for number in _told(said)[1]]
    with exactly():
        words, numbers = _told(part.callouts(source))
        shape = _shape(part, source)
        chains = _chains(said)
        unsaid, followed, rates = [], [], []
        for key, changed, step in variations(part, source):
            try:
                other = part.callouts(changed)
                changed_shape = _shape(part, changed)
            except (InputError, ValueError, ArithmeticError):
                continue
            other_words, others = _told(other)
            rate = _rate(key, (numbers, shape), (others, changed_shape), step)
            if other_words != words:
                followed.append(key)
            elif key not in said.silent and (
                not np.allclose(changed_shape, shape, rtol=1e-9)
                or not _same_parameters(part, source, changed)
            ):
                unsaid.append(key)
            if rate is None:
                continue
            # Ends that only happen to lie at one place close no chain.
            chains &= _chains(other)
            rates.append(rate)
        noted = sum(len(_NUMBER.findall(note)) for note in said.notes)
        masked = list(_masked(rates, noted))
        if masked:
            masked = list(_masked(_from_both_sides(part, source, rates, (numbers, shape)), noted))
    closing = [item for i, item in enumerate(_lines(said)) if i in chains]
    views = views_of(said)
    unsaid += [key for key in masked if key not in said.silent]
    return Coverage(
        tuple(dict.fromkeys(unsaid)),
        tuple(_twice(names, numbers, rates)),
        tuple(f"{item.words(views[item.view])} ({item.view})" for item in closing),
        tuple(dict.fromkeys(followed)),
    )


@dataclass(frozen=True)
class _Rates:
    """What a key does to the printed numbers and to the shape; small: by a derivative."""

    key: str
    moves: list[float]
    shape: NDArray[np.float64]
    small: bool


_Drawn = tuple[list["_Number"], NDArray[np.float64]]  # what is printed, and the shape


def _rate(key: str, before: _Drawn, after: _Drawn, step: float) -> _Rates | None:
    """What a step of a key does; None where a number comes or goes."""
    if len(before[0]) != len(after[0]):
        return None
    moves = [(b.value - a.value) / step for a, b in zip(before[0], after[0], strict=True)]
    return _Rates(key, moves, (after[1] - before[1]) / step, abs(step) == STEP)


def _from_both_sides(
    part: Part, source: Any, rates: list[_Rates], here: _Drawn
) -> Iterator[_Rates]:
    """The same rates, each the mean of a step forwards and one backwards.

    Where two lengths are equal, the larger of them turns a corner: on either side one alone moves
    it, and which one differs from key to key. The mean is half the sum of both lengths' rates.
    """
    assert part.callouts is not None
    behind: dict[str, _Rates] = {}
    for key, changed, step in variations(part, source, -STEP):
        try:
            there = _told(part.callouts(changed))[1], _shape(part, changed)
        except (InputError, ValueError, ArithmeticError):
            continue
        if rate := _rate(key, here, there, step):
            behind[key] = rate
    for rate in rates:
        other = behind.get(rate.key, rate)
        moves = [(a + b) / 2 for a, b in zip(rate.moves, other.moves, strict=True)]
        yield replace(rate, moves=moves, shape=(rate.shape + other.shape) / 2)


def _masked(rates: Iterable[_Rates], noted: int) -> Iterator[str]:
    """Keys that together change the shape while every printed number stays.

    The gradients of volume and size have to be sums of the numbers' gradients; what is left of
    them lies along keys of which the numbers tell too few.
    """
    small = [rate for rate in rates if rate.small]
    if not small or not small[0].moves:
        return
    # The last ones stand in notes: a strain gives no length.
    numbers = np.array([rate.moves[: len(rate.moves) - noted] for rate in small]).T
    shape = np.array([rate.shape for rate in small]).T
    shape = shape / np.maximum(np.abs(shape).max(axis=1, keepdims=True), SAME_RATE)
    left = shape - shape @ np.linalg.pinv(numbers, rcond=RANK) @ numbers
    for rate, column in zip(small, np.abs(left).max(axis=0), strict=True):
        if column > UNSAID:
            yield rate.key


def variations(part: Part, source: Any, small: float = STEP) -> Iterator[tuple[str, Any, float]]:
    """(key, the source with that key changed, by how much) for all numbers of the part's table.

    small: the step of what is no whole number; where a limit is in the way it goes the other way.
    """
    if part.indenter is not None:
        yield from _of_indenter(source, small)
        return
    for section in part.sections:
        record = getattr(source, section)
        for f in fields(record):
            for value, step in _others(getattr(record, f.name), f.metadata, small):
                try:
                    changed = replace(record, **{f.name: value})
                except ValueError:
                    continue
                yield f"{section}.{f.name}", replace(source, **{section: changed}), step


def _of_indenter(dims: IndenterDimensions, small: float) -> Iterator[tuple[str, Any, float]]:
    for f in fields(dims.body):
        value = getattr(dims.body, f.name) + small
        yield f.name, replace(dims, body=replace(dims.body, **{f.name: value})), small
    indenter = dims.indenter
    for name in ("stem_diameter_mm", "stem_length_mm", "reach_mm"):
        value = getattr(indenter, name) + small
        yield name, replace(dims, indenter=replace(indenter, **{name: value})), small
    for f in fields(indenter.tips[0]):
        values = [getattr(tip, f.name) for tip in indenter.tips]
        if not all(isinstance(value, float) for value in values) or not any(values):
            continue
        # All together: they are alike, and x and y spread by a factor.
        factor = 1 + small / max(abs(value) for value in values)
        try:
            tips = tuple(
                replace(tip, **{f.name: value * factor})
                for tip, value in zip(indenter.tips, values, strict=True)
            )
        except ValueError:
            continue
        yield f"tip.{f.name}", replace(dims, indenter=replace(indenter, tips=tips)), small


def _others(value: Any, limits: Mapping[str, Any], small: float) -> Iterator[tuple[Any, float]]:
    """Another value of a bounded number; of the name of a thread, other threads."""
    if isinstance(value, str) and re.fullmatch(r"M\d(\.\d)?", value):
        yield from ((name, 1.0) for name in ("M2", "M3", "M4") if name != value)
    if isinstance(value, bool) or not isinstance(value, int | float) or "ge" not in limits:
        return
    step = 1.0 if isinstance(value, int) else small
    if not limits["ge"] <= value + step <= limits["le"]:
        step = -step
    yield type(value)(value + step), step


def _shape(part: Part, source: Any) -> NDArray[np.float64]:
    """Volume and size of what is made, wherever it lies."""
    expected = part.expect(source)
    low, high = (np.array(corner) for corner in expected.box_mm)
    return np.array([*expected.volume_mm3, *(high - low)])


@dataclass(frozen=True)
class _Number:
    """A printed number: what tells which one it is, and along which axis it lies, None for all."""

    name: str
    value: float
    axis: int | None = None


def _told(said: Callouts) -> tuple[list[str], list[_Number]]:
    """What dimensions and labels print, and all numbers; without those in brackets.

    A note may quote a figure that rests on a key (the strain of a peg) and gives no length.
    """
    words: list[str] = []
    numbers: list[_Number] = []
    views = views_of(said)
    for item in said.items:
        if isinstance(item, Linear):
            view = views[item.view]
            if not item.auxiliary:
                words.append(item.words(view))
                name = f"{words[-1]} ({item.view})"
                numbers.append(_Number(name, item.value_mm(view), _axis(item, view)))
        elif isinstance(item, Leader):
            surface = (shown(item.flatness_mm), shown(item.roughness_um))
            words.append(" ".join((item.words, *surface)))
            found = _NUMBER.findall(item.words)
            numbers += [_Number(f"{n} of {item.words!r} ({item.view})", float(n)) for n in found]
    for note in said.notes:
        numbers += [_Number(f"{n} of {note!r}", float(n)) for n in _NUMBER.findall(note)]
    return words, numbers


def _lines(said: Callouts) -> list[Linear]:
    return [item for item in said.items if isinstance(item, Linear)]


def _axis(item: Linear, view: View) -> int:
    """The axis of the part along which a length is taken."""
    return int(np.argmax(np.abs(view.axes[0 if item.side in ("top", "bottom") else 1])))


def _same_parameters(part: Part, source: Any, changed: Any) -> bool:
    """Whether what the part states as made from is the same: a hole's place moves no volume."""
    before, after = (part.expect(s).parameters for s in (source, changed))
    return before.keys() == after.keys() and all(
        math.isclose(before[key], after[key], rel_tol=1e-9, abs_tol=1e-9)
        for key in before
        if isinstance(before[key], int | float)
    )


def _twice(names: list[str], numbers: list[_Number], rates: list[_Rates]) -> Iterator[str]:
    """Numbers that are equal and stay so whatever changes: they are one length."""
    if not rates:
        return
    moves = np.array([rate.moves for rate in rates]).T
    for i, one in enumerate(numbers):
        for j, other in enumerate(numbers[:i]):
            if None not in (one.axis, other.axis) and one.axis != other.axis:
                continue
            # A radius and its diameter are one length as well.
            if np.abs(moves[i]).max(initial=0.0) > SAME_RATE and any(
                abs(one.value - factor * other.value) < SAME_MM
                and np.allclose(moves[i], factor * moves[j], rtol=0, atol=SAME_RATE)
                for factor in (1.0, 2.0, 0.5)
            ):
                yield f"{names[j]} and {names[i]}"


def _chains(said: Callouts) -> set[int]:
    """Which of the lines are lengths whose two ends others have joined before on their axis."""
    views = views_of(said)
    root: dict[tuple[int, int], tuple[int, int]] = {}

    def find(node: tuple[int, int]) -> tuple[int, int]:
        while root.setdefault(node, node) != node:
            node = root[node]
        return node

    closing = set()
    for i, item in enumerate(_lines(said)):
        if not item.auxiliary:
            axis = _axis(item, views[item.view])
            a, b = (find((axis, round(end[axis] / SAME_MM))) for end in (item.a, item.b))
            if a == b:
                closing.add(i)
            root[a] = b
    return closing
