"""Relaxation in closed form, and the series found again in forces that were made from it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.relaxation import (
    BIN_S,
    ForceHistory,
    ForceRest,
    RelaxationFit,
    Series,
    StraightPress,
)
from deltact_fab.studies.study.settling import settling_time_s

GEL = Series((0.08, 0.05), (0.4, 6.0))


def left(series: Series, t_s: np.ndarray, steady_n: np.ndarray) -> np.ndarray:
    """What a force has over steady_n (n, 3), which is straight between the times t_s (n,)."""
    found = np.zeros_like(steady_n)
    for g, tau in series.pairs:
        q = np.zeros(3)
        for n in range(1, len(t_s)):
            x = (t_s[n] - t_s[n - 1]) / tau
            q = q * np.exp(-x) - np.expm1(-x) / x * (steady_n[n] - steady_n[n - 1])
            found[n] += g * q
    return found


def boltzmann(series: Series, t_s: float, rate, until_s: float) -> float:
    """The excess by the convolution itself: sum of g, integral of exp(-(t - s) / tau) dF(s)."""
    return sum(
        g * quad(lambda s, tau=tau: np.exp(-(t_s - s) / tau) * rate(s), 0, min(t_s, until_s))[0]
        for g, tau in series.pairs
    )


def test_ramp_and_hold_match_closed_form():
    ramp_s, t = 3.2, np.array([0.0, 0.5, 1.0, 3.2, 3.3, 4.0, 10.0, 60.0])
    steady = np.outer(np.minimum(t / ramp_s, 1.0), [0.0, 0.0, 7.0])
    excess = left(GEL, t, steady)[:, 2]
    for k, at in enumerate(t):
        told = boltzmann(GEL, at, lambda s: 7.0 / ramp_s, ramp_s)
        assert excess[k] == pytest.approx(told, rel=1e-7, abs=1e-12)


def test_time_to_bound_of_an_exponential():
    wait = np.concatenate([[0.0], np.geomspace(0.05, 100, 30)])
    error = 0.1 * np.exp(-wait / 3.0)
    assert settling_time_s(wait, error, 0.02) == pytest.approx(3 * np.log(5), rel=1e-9)
    assert settling_time_s(wait, error, 0.2) == 0.0
    assert np.isnan(settling_time_s(wait[:10], error[:10], 0.02))
    # It counts from when on it stays within, not when it first is.
    assert settling_time_s([0.0, 1.0, 2.0, 3.0], [0.1, 0.01, 0.1, 0.001], 0.02) > 2.0


def stops(series: Series, noise_n: float, rest_s: float, seed: int = 0) -> list[ForceRest]:
    """Rests of a press with a drag to either side, with what each still has of the one before."""
    rng = np.random.default_rng(seed)
    corners_s, corners_n = [BIN_S / 2], [(0.0, 0.0, 0.0)]  # nothing at the first time
    starts = []
    for ramp_s, force in ((3.2, (0, 0, -7.6)), (1.3, (2.4, 0, -7.6)), (2.6, (-2.4, 0, -7.6))):
        corners_s.append(corners_s[-1] + ramp_s)
        corners_n.append(force)
        starts.append(corners_s[-1])
        corners_s.append(corners_s[-1] + rest_s)
        corners_n.append(force)
    t = np.arange(0.0, corners_s[-1], BIN_S) + BIN_S / 2
    steady = np.stack([np.interp(t, corners_s, f) for f in np.array(corners_n).T], axis=1)
    force = steady + left(series, t, steady) + rng.normal(0, noise_n, steady.shape)
    way = ForceHistory("sphere-15/p1", t, force)
    found = []
    for kind, start in zip(("press", "shear", "shear"), starts, strict=True):
        at = np.searchsorted(t, [start + 0.1, start + rest_s])
        found.append(ForceRest(way, kind, kind, 1.6, slice(int(at[0]), int(at[1]))))
    return found


def test_straight_press_of_a_run(mini_run: Path, tmp_path: Path) -> None:
    found = StraightPress.from_run(mini_run, "sphere-10/p1")
    assert (found.indenter.name, found.options["at_mm"]) == ("sphere:10", (0.5, -0.5))
    assert found.options["thickness_mm"] == 12
    assert found.depth_mm.max() == pytest.approx(1.0, abs=0.01)
    assert found.dragged > 0
    assert found.normal_n.max() == pytest.approx(2.7, abs=0.2)
    assert [note.partition(":")[0] for note in found.notes][1] == "no prony in the run's specimen"
    run = shutil.copytree(mini_run, tmp_path / "run")
    meta = json.loads((run / "run.json").read_text())
    meta["protocol"]["specimen"]["prony"] = [[0.1, 1000.0]]  # slower than the press: all of it
    (run / "run.json").write_text(json.dumps(meta))
    slow = StraightPress.from_run(run, "sphere-10/p1")
    assert slow.normal_n[-1] == pytest.approx(found.normal_n[-1] / 1.1, rel=0.01)
    assert len(slow.notes) == len(found.notes) - 1


@pytest.mark.parametrize("press", [None, "sphere-10/p2"])
def test_straight_press_must_be_named(mini_run: Path, press: str | None) -> None:
    with pytest.raises(InputError, match=r"--press: must be one of sphere-10/p1, 4dots/p1 \(got"):
        StraightPress.from_run(mini_run, press)


@pytest.mark.slow
def test_series_is_recovered_from_successive_rests():
    fitted = RelaxationFit.from_rests(stops(GEL, noise_n=0.002, rest_s=30.0))
    assert len(fitted.series.shares) == 2
    assert fitted.series.shares == pytest.approx(GEL.shares, rel=0.1)
    assert fitted.series.times_s == pytest.approx(GEL.times_s, rel=0.1)
    assert fitted.rms_n == pytest.approx(0.002, rel=0.1)
    assert fitted.unsure == ()
    # Steady forces are those of the slow gel, though none of the rests is over.
    assert np.abs(fitted.steady_n[:, 2]) == pytest.approx(7.6, abs=0.02)
    assert fitted.steady_n[:, 0] == pytest.approx([0, 2.4, -2.4], abs=0.01)


def test_one_time_constant_needs_one_branch():
    one = Series((0.1,), (2.0,))
    fitted = RelaxationFit.from_rests(stops(one, noise_n=0.002, rest_s=30.0))
    assert len(fitted.series.shares) == 1
    assert fitted.series.times_s[0] == pytest.approx(2.0, rel=0.03)
    assert fitted.series.shares[0] == pytest.approx(0.1, rel=0.03)
