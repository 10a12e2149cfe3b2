"""The exchange of `protocol plan force` beside pyoptex's, on a problem that both can express.

A full quadratic model of two factors on a grid, independent errors, the mean predicted variance
over the grid (I-optimality), eight random starts each. Not as few runs as terms: what no press
determines has no variance in our criterion, and the prior of a force model determines all. pyoptex
wants another pandas than ours, so it is in the environment of the peers (`make peers`;
`benchmarks/peers/README.md`):

    python -m benchmarks.plan_pyoptex
"""

from __future__ import annotations

import numpy as np

from deltact_fab.common.errors import RunFailed
from deltact_fab.studies.plan.exchange import Exchange

from . import peer

LEVELS, COUNTS, STARTS = np.linspace(-1, 1, 7), (8, 10, 14, 20), 8


def quadratic(points: np.ndarray) -> np.ndarray:
    """Terms (n, 6) of the full quadratic model at points (n, 2)."""
    x, y = points.T
    return np.column_stack((np.ones(len(x)), x, y, x * y, x**2, y**2))


def variance(points: np.ndarray, grid: np.ndarray) -> float:
    """Mean predicted variance over a grid of a design, for errors of 1."""
    rows, over = quadratic(points), quadratic(grid)
    return float(np.trace(np.linalg.solve(rows.T @ rows, over.T @ over)) / len(over))


def exchanged(grid: np.ndarray, count: int) -> np.ndarray:
    """Design (count, 2) by the exchange of a plan, whose one force is the model's response."""
    rows, codes = quadratic(grid)[:, None, None, :], np.zeros(len(grid), int)
    plan = Exchange(rows, np.arange(len(grid)), codes, codes, np.array([1.0, 0, 0, 0]), 0.0)
    return grid[plan.design(count, np.random.default_rng(0), STARTS)]


def main() -> None:
    """Print the criterion of both for each number of runs."""
    grid = np.array([(x, y) for x in LEVELS for y in LEVELS])
    case = {"levels": LEVELS, "points": grid, "counts": np.array(COUNTS), "starts": STARTS}
    answer = peer.ask("pyoptex", "pyoptex_designs.py", case)
    if answer is None:
        raise RunFailed("pyoptex: not run: no .venv-peers (make peers)")
    print(f"| runs | plan | pyoptex {answer['version']} | plan less, % |\n|---|---|---|---|")
    for count in COUNTS:
        ours = variance(exchanged(grid, count), grid)
        theirs = variance(answer[f"design_{count}"], grid)
        print(f"| {count} | {ours:.4f} | {theirs:.4f} | {100 * (1 - ours / theirs):+.2f} |")


if __name__ == "__main__":
    main()
