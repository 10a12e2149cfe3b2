"""How often 95 % intervals over few groups hold the truth: `python -m benchmarks.intervals`.

Synthetic: every group has an offset of its own (sd 0.5) and 20 samples (sd 1). Against
`Interval` stand the bootstraps of whole groups that scipy has. Half a minute.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from deltact_fab.estimate.analysis.intervals import Interval

TRIALS = 400
DRAWS = 500
WITHIN = 20
SEED = 0


def main() -> None:
    print(f"seed {SEED}, {TRIALS} trials, {DRAWS} draws a bootstrap")
    print(f"{'groups':>6} {'figure':>6} {'percentile':>10} {'BCa':>10} {'ours':>10}")
    for count in (3, 4, 5, 9, 20):
        for name, truth in (("mean", 0.0), ("rmse", math.sqrt(1.25))):
            held = np.mean([_held(count, name, truth, trial) for trial in range(TRIALS)], axis=0)
            print(f"{count:>6} {name:>6} " + " ".join(f"{share:>10.1%}" for share in held))


def _held(count: int, name: str, truth: float, trial: int) -> tuple[bool, bool, bool]:
    rng = np.random.default_rng([SEED, count, trial])
    groups = np.repeat(np.arange(count), WITHIN)
    sample = np.repeat(rng.normal(0, 0.5, count), WITHIN) + rng.normal(0, 1, count * WITHIN)
    power = 1 if name == "mean" else 2
    sums = (sample**power).reshape(count, WITHIN).mean(axis=1)

    def figure(drawn: np.ndarray, axis: int = -1) -> np.ndarray:
        mean = np.mean(drawn, axis=axis)
        return mean if name == "mean" else np.sqrt(mean)

    held = []
    for method in ("percentile", "BCa"):
        found = stats.bootstrap(
            (sums,), figure, n_resamples=DRAWS, method=method, vectorized=True, rng=rng
        ).confidence_interval
        held.append(bool(found.low <= truth <= found.high))
    ours = getattr(Interval, name)(sample, groups, "group")
    return held[0], held[1], bool(ours.low <= truth <= ours.high)


if __name__ == "__main__":
    main()
