"""Whether a drawing says every dimension of its part, and each of them once.

Nothing is declared: each number of the part's table is changed a little, and what the drawing
prints is compared. So a new dimension that no number on the drawing follows is found, and so is a
length that stands there twice. No CAD kernel.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from ...errors import InputError
from ..dimensions import Design
from ..part import Part
from .dimensioning import Leader, Linear
from .items import Callouts
from .projection import View
from .views import views_of

STEP = 0.05  # of a value: far more than the hundredths that are printed
LEAST = 0.05
SAME_MM = 1e-6
ROUNDED = 0.006  # half a hundredth, and a little
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
    words, numbers = _told(said)
    unsaid, followed = [], []
    moves: list[dict[int, float]] = [{} for _ in numbers]
    chains = _chains(said)
    for column, (key, changed) in enumerate(variations(part, source)):
        try:
            other = part.callouts(changed)
            other_words, others = _told(other)
        except (InputError, ValueError, ArithmeticError):
            continue
        if other_words != words:
            followed.append(key)
        elif key not in said.silent and _shape(part, changed) != _shape(part, source):
            unsaid.append(key)
        if len(others) == len(numbers):
            # Ends that only happen to lie at one place close no chain.
            chains &= _chains(other)
            for move, before, after in zip(moves, numbers, others, strict=True):
                if abs(after.value - before.value) > SAME_MM:
                    move[column] = after.value - before.value
    views = views_of(said)
    closing = [item for i, item in enumerate(_lines(said)) if i in chains]
    return Coverage(
        tuple(dict.fromkeys(unsaid)),
        tuple(_twice(numbers, moves)),
        tuple(f"{item.words(views[item.view])} ({item.view})" for item in closing),
        tuple(dict.fromkeys(followed)),
    )


def variations(part: Part, source: Any) -> Iterator[tuple[str, Any]]:
    """(key, the source with that key changed a little) for every number of the part's table."""
    if part.indenter is not None:
        yield from _of_indenter(source)
        return
    for section in part.sections:
        record = getattr(source, section)
        for f in fields(record):
            for value in _others(getattr(record, f.name), f.metadata):
                try:
                    changed = replace(record, **{f.name: value})
                except ValueError:
                    continue
                yield f"{section}.{f.name}", replace(source, **{section: changed})


def _of_indenter(dims: Any) -> Iterator[tuple[str, Any]]:
    for f in fields(dims.body):
        for value in _others(getattr(dims.body, f.name), {"low": 0.0, "high": np.inf}):
            yield f.name, replace(dims, body=replace(dims.body, **{f.name: value}))
    indenter = dims.indenter
    for name in ("stem_diameter_mm", "stem_length_mm", "reach_mm"):
        value = getattr(indenter, name) * (1 + STEP)
        yield name, replace(dims, indenter=replace(indenter, **{name: value}))
    for f in fields(indenter.tips[0]):
        values = [getattr(tip, f.name) for tip in indenter.tips]
        if not all(isinstance(value, float) for value in values) or not any(values):
            continue
        try:
            # All together: they are alike, and x and y spread by a factor.
            tips = tuple(
                replace(tip, **{f.name: value * (1 + STEP)})
                for tip, value in zip(indenter.tips, values, strict=True)
            )
            yield f"tip.{f.name}", replace(dims, indenter=replace(indenter, tips=tips))
        except ValueError:
            continue


def _others(value: Any, limits: Mapping[str, Any]) -> Iterator[Any]:
    """Another value of a bounded number; of the name of a thread, other threads."""
    if isinstance(value, str) and re.fullmatch(r"M\d(\.\d)?", value):
        yield from (name for name in ("M2", "M3", "M4") if name != value)
    if isinstance(value, bool) or not isinstance(value, int | float) or "low" not in limits:
        return
    step = 1 if isinstance(value, int) else max(LEAST, STEP * abs(value))
    yield value + step if value + step <= limits["high"] else value - step


def _shape(part: Part, source: Any) -> tuple[float, ...]:
    """Volume and size of what is made, wherever it lies."""
    try:
        expected = part.expect(source)
    except (InputError, ValueError, ArithmeticError):
        return ()
    low, high = (np.array(corner) for corner in expected.box_mm)
    return tuple(round(float(v), 6) for v in (*expected.volume_mm3, *(high - low)))


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
            words.append(item.words)
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


def _twice(numbers: list[_Number], moves: list[dict[int, float]]) -> Iterator[str]:
    """Numbers that are equal and stay so whatever changes: they are one length."""
    for i, one in enumerate(numbers):
        for j, other in enumerate(numbers[:i]):
            if None not in (one.axis, other.axis) and one.axis != other.axis:
                continue
            # A radius and its diameter are one length as well.
            if moves[i].keys() == moves[j].keys() != set() and any(
                abs(one.value - factor * other.value) < ROUNDED
                and all(abs(moves[i][k] - factor * moves[j][k]) < 2 * ROUNDED for k in moves[i])
                for factor in (1.0, 2.0, 0.5)
            ):
                yield f"{other.name} and {one.name}"


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
