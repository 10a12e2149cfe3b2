"""Least squares: the figures of statsmodels, and an honest word where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.errors import InputError
from deltact_fab.measure.regression import least_squares

RNG = np.random.default_rng(7)
ROWS = 60
ONE = RNG.normal(2.0, 1.0, ROWS)
COLUMNS = np.stack((ONE, 1e4 * ONE**2, 1e-5 * ONE**3), -1)  # powers, of very unlike size
Y = COLUMNS @ np.array([1.0, -3e-5, 4e4]) + RNG.normal(0, 0.3, ROWS)
NAMES = ("D", "D^2", "D^3")


@pytest.mark.parametrize("constant", [False, True])
@pytest.mark.parametrize("level", [0.95, 0.5])
def test_statsmodels_gives_the_same_coefficients_intervals_and_r2(constant, level):
    from statsmodels.api import OLS, add_constant

    columns = add_constant(COLUMNS, prepend=False) if constant else COLUMNS
    names = (*NAMES, "1") if constant else NAMES
    # By itself statsmodels would call any columns that span a constant "with a constant".
    theirs = OLS(Y, columns, hasconst=False).fit(method="qr")
    ours = least_squares(columns, Y, names, level)
    assert ours.coefficients == pytest.approx(theirs.params, rel=1e-9)
    assert np.array(ours.intervals) == pytest.approx(theirs.conf_int(1 - level), rel=1e-8)
    assert ours.r2 == pytest.approx(theirs.rsquared, rel=1e-12)
    assert ours.adjusted_r2 == pytest.approx(theirs.rsquared_adj, rel=1e-12)
    centred = OLS(Y, columns, hasconst=True).fit(method="qr")
    assert ours.centred_r2 == pytest.approx(centred.rsquared, rel=1e-9)
    if constant:  # only then are its degrees of freedom those of a model with one
        assert ours.adjusted_centred_r2 == pytest.approx(centred.rsquared_adj, rel=1e-9)
    assert ours.rmse == pytest.approx(np.sqrt(np.mean(theirs.resid**2)), rel=1e-9)
    assert ours.condition_raw == pytest.approx(np.linalg.cond(columns), rel=1e-6)
    assert ours.condition_scaled < 1e3 < 1e8 < ours.condition_raw


def test_a_column_that_others_give_is_left_out_by_name():
    copies = np.column_stack((COLUMNS, COLUMNS[:, 0] + 1e-4 * COLUMNS[:, 1], np.zeros(ROWS)))
    names = (*NAMES, "mix", "dead")
    fit = least_squares(copies, Y, names)
    plain = least_squares(COLUMNS, Y, NAMES)
    assert fit.dropped == ("mix", "dead")
    assert fit.notes == (
        "mix is given by D, D^2 and left out",
        "dead is 0 throughout and left out",
    )
    assert fit.coefficients == pytest.approx((*plain.coefficients, 0, 0), rel=1e-9)
    assert fit.adjusted_r2 == pytest.approx(plain.adjusted_r2)
    assert fit.free == plain.free


def test_no_force_and_constant_force_have_no_r2_rather_than_a_wrong_one():
    none = least_squares(COLUMNS, np.zeros(ROWS), NAMES)
    assert none.coefficients == (0, 0, 0)
    assert none.rmse == 0
    assert none.r2 is none.adjusted_r2 is none.centred_r2 is None
    assert none.notes == ("y is 0 throughout: the coefficients say nothing",)
    constant = least_squares(COLUMNS, np.full(ROWS, 0.3), NAMES)
    assert constant.centred_r2 is constant.adjusted_centred_r2 is None
    assert constant.r2 is not None
    offset = least_squares(np.column_stack((COLUMNS, np.ones(ROWS))), Y, (*NAMES, "one"))
    assert offset.notes == ("one is the same throughout: its coefficient is an offset",)
    nothing = least_squares(np.zeros((ROWS, 3)), Y, NAMES)
    assert nothing.dropped == NAMES
    assert nothing.rmse == pytest.approx(np.sqrt(np.mean(Y**2)))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_by_row_and_column(bad):
    columns = COLUMNS.copy()
    columns[5, 1] = bad
    with pytest.raises(InputError, match=r"D\^2: row 5: (nan|inf)"):
        least_squares(columns, Y, NAMES)
    with pytest.raises(InputError, match="y: row 0"):
        least_squares(COLUMNS, np.full(ROWS, bad), NAMES)


def test_as_many_columns_as_rows_fit_anything_and_are_refused():
    with pytest.raises(InputError, match="3 rows for 3 columns; at least 4 are needed"):
        least_squares(COLUMNS[:3], Y[:3], NAMES)
