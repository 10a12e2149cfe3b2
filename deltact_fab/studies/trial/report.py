"""Trial of a plan: how often its goal is reached on drawn sensors, beside what it promises."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deltact_fab.common import Progress

EQUAL_SHARE = 0.1  # by hand: of the error, within which images and noise count as equal
SHARE_LEVEL = 0.95  # definition: of the interval of a share


def share_interval(count: int, times: int) -> tuple[float, float]:
    """Exact binomial interval (Clopper and Pearson) of a share of trials."""
    from scipy.stats import binomtest

    low, high = binomtest(count, times).proportion_ci(SHARE_LEVEL)
    return float(low), float(high)


@dataclass(frozen=True)
class ImageCheck:
    """Errors of the same sensors by images of all presses, and by measured noise instead."""

    by_images: Sequence[float]
    by_noise: Sequence[float]

    @property
    def ratio(self) -> tuple[float, float, float]:
        """Error by noise over that by images, less 1, and its 90 % interval.

        Two one-sided tests at 5 % find both equal if the interval is within EQUAL_SHARE.
        """
        from scipy.stats import ttest_1samp

        logs = np.log(self.by_noise) - np.log(self.by_images)
        low, high = ttest_1samp(logs, 0.0).confidence_interval(0.9)
        return math.expm1(float(logs.mean())), math.expm1(float(low)), math.expm1(float(high))

    @property
    def equal(self) -> bool:
        """True if images and noise give the same error."""
        return max(abs(self.ratio[1]), abs(self.ratio[2])) <= EQUAL_SHARE

    @property
    def line(self) -> str:
        value, low, high = self.ratio
        differs = low > EQUAL_SHARE or high < -EQUAL_SHARE
        return (
            f"measured noise instead of images, {len(self.by_images)} sensors: error {value:+.1%} "
            f"[{low:+.1%} to {high:+.1%}]; equal within {EQUAL_SHARE:.0%}: "
            f"{'yes' if self.equal else 'NO' if differs else 'not shown'}"
        )


@dataclass(frozen=True)
class TrialReport:
    """Trials beside the promise of a plan.

    promise: table of the plan. reached: number of trials that reach the goal. trials: number of
    all; one that fails has not reached it. noun: of a trial, plural. figures: of the sensors, by
    number, in the promise's unit. failed: reasons of those without one. images: check of the noise;
    None without. invented: number of differences between sides that are the same; None without
    sides. remarks: on the method.
    """

    name: str
    promise: Any
    reached: int
    trials: int
    noun: str
    figures: Mapping[int, float]
    failed: Mapping[int, str] = field(default_factory=dict)
    images: ImageCheck | None = None
    invented: int | None = None
    remarks: Sequence[str] = ()

    @property
    def in_interval(self) -> int:
        """Number of sensors whose figure is within the promised interval."""
        low, high = self.promise.interval
        return sum(low <= figure <= high for figure in self.figures.values())

    @property
    def as_promised(self) -> bool:
        """True if the promised chance is within the interval of the share that reached the goal."""
        low, high = share_interval(self.reached, self.trials)
        return low <= self.promise.chance <= high

    @property
    def lines(self) -> list[str]:
        """Verdict, then what it rests on."""
        promise, (low, high) = self.promise, share_interval(self.reached, self.trials)
        lines = [
            f"{self.name}: goal {promise.goal:g} {promise.unit} reached by {self.reached} of "
            f"{self.trials} {self.noun} [{low:.2f} to {high:.2f}], promised {promise.chance:.2f}: "
            f"{'as promised' if self.as_promised else 'NOT as promised'}"
        ]
        if self.invented is None:
            low, middle, high = np.quantile([*self.figures.values()] or [0.0], (0.025, 0.5, 0.975))
            lines.append(
                f"{promise.measure}: {middle:.2g} {promise.unit} [{low:.2g} to {high:.2g}]; within "
                f"the promised interval {self.in_interval} of {self.trials}"
            )
        else:
            lines.append(
                f"same against same: a difference invented in {self.invented} of {self.trials}"
            )
        lines += [] if self.images is None else [self.images.line]
        return [*lines, *self.remarks, *(f"sensor {n}: {text}" for n, text in self.failed.items())]

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        images, names = self.images, ("value", "low", "high")
        return {
            "promise": self.promise.model_dump(mode="json"),
            "simulated": True,
            "trials": self.trials,
            "noun": self.noun,
            "reached": self.reached,
            "reached_interval": share_interval(self.reached, self.trials),
            "as_promised": self.as_promised,
            "in_interval": None if self.invented is not None else self.in_interval,
            "invented": self.invented,
            "images": None if images is None else dict(zip(names, images.ratio, strict=True)),
            "equal_images": None if images is None else images.equal,
            "figures": dict(self.figures),
            "failed": dict(self.failed),
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True)
class TrialJobs:
    """Executor, progress and announcements of a trial's jobs. say: prints a line."""

    executor: Executor | None = None
    progress: Progress | None = None
    say: Callable[[str], None] = lambda text: None
