"""Mixing of fixed-point iterations."""

from __future__ import annotations

import numpy as np

from ...aliases import Field


class Mixer:
    """Anderson's mixing of a fixed-point iteration, type II, over the last few iterates.

    On a steep flank friction and height feed back on each other, with a factor near -1 in front of
    the indenter and +1 behind it: plain alternation crawls or swings there.
    """

    def __init__(self, memory: int = 6) -> None:
        self._memory = memory
        self._trials: list[Field] = []
        self._errors: list[Field] = []

    def next(self, trial: Field, found: Field) -> Field:
        """The next trial, after `trial` gave `found`; arrays of any one shape."""
        self._trials.append(found.ravel())
        self._errors.append((found - trial).ravel())
        del self._trials[: -self._memory], self._errors[: -self._memory]
        if len(self._errors) < 2:
            return found
        steps = np.stack([e - self._errors[-1] for e in self._errors[:-1]], axis=1)
        weights, *_ = np.linalg.lstsq(steps, -self._errors[-1], rcond=1e-8)
        moves = np.stack([t - self._trials[-1] for t in self._trials[:-1]], axis=1)
        return (self._trials[-1] + moves @ weights).reshape(found.shape)
