"""Least squares: the figures of statsmodels, and an honest word where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.force import make_features
from deltact_fab.estimate.measure.force.model import WRENCH_AXES, ForceModel
from deltact_fab.estimate.measure.regression import MIN_PRESSES, least_squares
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions

RNG = np.random.default_rng(7)
ROWS = 60
ONE = RNG.normal(2.0, 1.0, ROWS)
COLUMNS = np.stack((ONE, 1e4 * ONE**2, 1e-5 * ONE**3), -1)  # powers, of very unlike size
PRESSES = np.sort(RNG.integers(0, 12, ROWS)).astype(str)  # of unlike length
Y = COLUMNS @ np.array([1.0, -3e-5, 4e4]) + RNG.normal(0, 0.3, 12)[PRESSES.astype(int)]
NAMES = ("D", "D^2", "D^3")
VIEW = SensorModel(Pinhole(0.04, 640, 480, 13.0), SkinDimensions())


@pytest.mark.parametrize("constant", [False, True])
def test_statsmodels_agrees_on_badly_scaled_columns(constant):
    from statsmodels.api import OLS, add_constant

    columns = add_constant(COLUMNS, prepend=False) if constant else COLUMNS
    names = (*NAMES, "1") if constant else NAMES
    # By itself statsmodels would call any columns that span a constant "with a constant".
    theirs = OLS(Y, columns, hasconst=False).fit(method="qr")
    ours = least_squares(columns, Y, names, PRESSES)
    assert ours.coefficients == pytest.approx(theirs.params, rel=1e-9)
    clustered = OLS(Y, columns, hasconst=False).fit(
        method="qr", cov_type="cluster", cov_kwds={"groups": PRESSES.astype(int)}, use_t=True
    )
    assert np.array(ours.intervals) == pytest.approx(clustered.conf_int(), rel=1e-8)
    assert ours.r2_about_zero == pytest.approx(theirs.rsquared, rel=1e-12)
    assert ours.adjusted_r2_about_zero == pytest.approx(theirs.rsquared_adj, rel=1e-12)
    centred = OLS(Y, columns, hasconst=True).fit(method="qr")
    assert ours.r2 == pytest.approx(centred.rsquared, rel=1e-9)
    assert ours.rmse == pytest.approx(np.sqrt(np.mean(theirs.resid**2)), rel=1e-9)
    assert ours.condition_raw == pytest.approx(np.linalg.cond(columns), rel=1e-6)
    assert ours.condition_scaled < 1e3 < 1e8 < ours.condition_raw


@pytest.mark.parametrize(
    ("name", "component"), [("sums", "tx"), ("paper", "fx"), ("inverse-placed", "fz")]
)
def test_statsmodels_agrees_on_force_models(name, component):
    from statsmodels.api import OLS
    from statsmodels.stats.sandwich_covariance import S_crosssection

    features = make_features(name, VIEW)
    rng = np.random.default_rng(11)
    presses = np.repeat(np.arange(14), rng.integers(3, 9, 14))
    sizes = 10.0 ** rng.uniform(-1, 2, len(features.names))
    X = sizes * rng.normal(1.0, 0.6, (len(presses), len(features.names)))
    wrench = (X / sizes) @ rng.normal(size=(len(features.names), 6))
    wrench += rng.normal(0, 0.5, (14, 6))[presses] + rng.normal(0, 0.2, wrench.shape)
    ours = ForceModel.fit(features, X, wrench, presses.astype(str))[1][component]

    labels = features.explains[component]
    columns, y = (
        X[:, [features.names.index(one) for one in labels]],
        wrench[:, WRENCH_AXES.index(component)],
    )
    size = np.sqrt(np.mean(columns[:, 0] ** 2))
    prior = {one: size * s for one, s in features.prior_scales.items() if one in labels}
    assert ours.prior == pytest.approx(prior)
    pseudo = [[value * (one == other) for other in labels] for one, value in prior.items()]
    n, k, many = len(y), len(labels), len(set(presses))
    theirs = OLS(
        np.concatenate((y, np.zeros(len(prior)))), np.vstack((columns, *pseudo)), hasconst=False
    ).fit()
    assert ours.coefficients == pytest.approx(theirs.params, rel=1e-10)
    left = theirs.resid[:n]
    meat = S_crosssection(columns * left[:, None], presses)
    bread = theirs.normalized_cov_params
    few = many / (many - 1) * (n - 1) / (n - k)
    half = stats.t.ppf(0.975, many - 1) * np.sqrt(few * np.diag(bread @ meat @ bread))
    width = np.diff(np.array(ours.intervals), axis=1)[:, 0] / 2
    assert width == pytest.approx(half, rel=1e-10)
    assert np.mean(ours.intervals, axis=1) == pytest.approx(theirs.params, rel=1e-10)
    # Of the rows measured alone.
    rss, mean = left @ left, OLS(y, np.ones(n)).fit()
    assert (ours.samples, ours.free, ours.presses) == (n, n - k, many)
    assert ours.rmse == pytest.approx(np.sqrt(rss / n), rel=1e-10)
    assert ours.r2 == pytest.approx(1 - rss / mean.ssr, rel=1e-10)
    assert ours.adjusted_r2 == pytest.approx(1 - rss / (n - k) / mean.mse_resid, rel=1e-10)


def test_few_presses_have_no_intervals():
    few = np.where(PRESSES.astype(int) < MIN_PRESSES - 1, PRESSES, "0")
    fit = least_squares(COLUMNS, Y, NAMES, few)
    assert fit.intervals is None
    assert fit.notes == ("no intervals: 10 presses are needed (got 9)",)
    assert least_squares(COLUMNS, Y, NAMES).notes[0].endswith("(got 0)")
    with pytest.raises(ValueError, match="n presses"):
        least_squares(COLUMNS, Y, NAMES, few[1:])


def test_dependent_column_is_dropped_and_named():
    copies = np.column_stack((COLUMNS, COLUMNS[:, 0] + 1e-4 * COLUMNS[:, 1], np.zeros(ROWS)))
    names = (*NAMES, "mix", "dead")
    fit = least_squares(copies, Y, names, PRESSES)
    plain = least_squares(COLUMNS, Y, NAMES, PRESSES)
    assert fit.dropped == ("mix", "dead")
    assert fit.notes == ("mix depends on D, D^2 and was dropped", "dead is zero and was dropped")
    assert fit.coefficients == pytest.approx((*plain.coefficients, 0, 0), rel=1e-9)
    assert fit.intervals[3:] == ((0, 0), (0, 0))
    assert np.array(fit.intervals[:3]) == pytest.approx(np.array(plain.intervals), rel=1e-9)
    assert fit.adjusted_r2 == pytest.approx(plain.adjusted_r2)
    assert fit.free == plain.free


def test_zero_or_constant_force_lacks_r2():
    none = least_squares(COLUMNS, np.zeros(ROWS), NAMES, PRESSES)
    assert none.coefficients == (0, 0, 0)
    assert none.rmse == 0
    assert none.r2 is none.adjusted_r2 is none.r2_about_zero is None
    assert none.notes == ("y is zero everywhere: the coefficients are meaningless",)
    constant = least_squares(COLUMNS, np.full(ROWS, 0.3), NAMES)
    assert constant.r2 is constant.adjusted_r2 is None
    assert constant.r2_about_zero is not None
    with_one = np.column_stack((COLUMNS, np.ones(ROWS)))
    offset = least_squares(with_one, Y, (*NAMES, "one"), PRESSES)
    assert offset.notes == ("one is constant: its coefficient is an offset",)
    nothing = least_squares(np.zeros((ROWS, 3)), Y, NAMES)
    assert nothing.dropped == NAMES
    assert nothing.rmse == pytest.approx(np.sqrt(np.mean(Y**2)))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_non_finite_named_by_row_column(bad):
    columns = COLUMNS.copy()
    columns[5, 1] = bad
    with pytest.raises(InputError, match=r"D\^2: row 5: (nan|inf)"):
        least_squares(columns, Y, NAMES)
    with pytest.raises(InputError, match="y: row 0"):
        least_squares(COLUMNS, np.full(ROWS, bad), NAMES)
