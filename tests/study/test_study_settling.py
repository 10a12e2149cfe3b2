"""The settling study on what it is made from: ways, stops, protocols; whole it is in `_slow`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deltact_fab.analysis.relaxation import Series
from deltact_fab.errors import InputError
from deltact_fab.protocols import plan
from deltact_fab.study import gel_remarks
from deltact_fab.study.registry import STUDIES
from deltact_fab.study.settling import fading, job_of, longest_s, series_of, shipped
from deltact_fab.study.settling_stops import enough_s, judged

GEL = Series((0.1,), (2.0,))


def way(depths: tuple[float, ...], settle_s: float = 1.0) -> dict[str, Any]:
    """The way of the protocol's ball to other depths."""
    protocol, _ = plan.load("settling")
    capture = protocol.capture.model_copy(update={"settle_s": settle_s})
    job = job_of("", protocol.model_copy(update={"depths_mm": depths, "capture": capture}))
    return job.work(job.given)


@pytest.fixture(scope="module")
def elastic() -> dict[str, Any]:
    return way((0.5, 1.0))


def test_a_way_is_followed_stop_by_stop(elastic: dict[str, Any]) -> None:
    stops = elastic["stops"]
    assert [stop["id"].split("/", 2)[2] for stop in stops] == [
        "d0.50/press", "d0.50/shear-x+", "d0.50/shear-x-",
        "d1.00/press", "d1.00/shear-x+", "d1.00/shear-x-",
    ]  # fmt: skip
    force = elastic["force_n"]
    assert force[0] == pytest.approx([0, 0, 0])
    press, right, left_ = (force[stop["arrived"]] for stop in stops[:3])
    assert press[2] < -0.5
    assert press[2] == pytest.approx(right[2], rel=0.02)
    assert right[0] > 0.1
    assert right[0] == pytest.approx(-left_[0], rel=0.05)
    # At the feed of the protocol: .5 mm in a second, then .2 mm each way.
    t = [elastic["t_s"][stop["arrived"]] for stop in stops[:3]]
    assert t == pytest.approx([1.0, 1.4, 2.2])


def test_a_stop_waits_as_long_as_its_exponential_says(elastic: dict[str, Any]) -> None:
    stops = fading(elastic, GEL)
    assert [stop.kind for stop in stops] == ["press", "shear", "shear"] * 2
    # The first press, by hand: its ramp alone.
    first, arrived = stops[0], elastic["stops"][0]["arrived"]
    ramp = slice(arrived + 1)
    by_hand = GEL.excess(elastic["t_s"][ramp], elastic["force_n"][ramp])[-1]
    assert first.excess_n[0] == pytest.approx(np.linalg.norm(by_hand[2]))
    for stop in stops:
        share, row = stop.excess_n[0] / stop.steady_n, stop.row()
        assert share > 0.02
        assert row["wait_2_percent_s"] == pytest.approx(2 * np.log(share / 0.02), rel=0.01)
        assert row["wait_5_percent_s"] <= row["wait_2_percent_s"] < row["wait_1_percent_s"]
    longest = max(stop.row()["wait_2_percent_s"] for stop in stops if stop.kind == "shear")
    assert longest_s(elastic, "shear", GEL) == longest


def test_half_and_twice_the_modulus_move_newtons_and_no_share(elastic: dict[str, Any]) -> None:
    soft = {**elastic, "force_n": elastic["force_n"] / gel_remarks.MODULUS_FACTOR}
    for a, b in zip(fading(elastic, GEL), fading(soft, GEL), strict=True):
        assert a.row()["wait_2_percent_s"] == pytest.approx(b.row()["wait_2_percent_s"], rel=1e-9)
        assert a.excess_n[0] == pytest.approx(gel_remarks.MODULUS_FACTOR * b.excess_n[0])


def test_a_protocol_is_judged_by_its_own_rests_and_longer_ones_are_better(
    elastic: dict[str, Any],
) -> None:
    rows = [judged(elastic, GEL, rest) for rest in (0.0, 1.0, 5.0, 60.0)]
    worst = [row["worst_percent"] for row in rows]
    assert worst == sorted(worst, reverse=True)
    assert worst[0] > 3
    assert worst[-1] < 1e-6
    # After short rests a stop still has what the ones before left: by hand, rest by rest.
    t, force, late = [], [], 0.0
    arrived = {stop["arrived"] for stop in elastic["stops"]}
    for n, (at, one) in enumerate(zip(elastic["t_s"], elastic["force_n"], strict=True)):
        t.append(at + late)
        force.append(one)
        if n in arrived:
            late += 1.0
            t.append(at + late)
            force.append(one)
    ends = [n for n in range(1, len(t)) if np.array_equal(force[n], force[n - 1])]
    by_hand = np.linalg.norm(GEL.excess(t, np.array(force))[ends], axis=1)
    assert rows[1]["worst_n"] == pytest.approx(by_hand.max())
    # What all stops have in common is taken out of the scatter.
    assert 0 < rows[1]["normal_scatter_n"] < rows[1]["worst_n"]
    assert 0 < rows[1]["normal_common_percent"] < worst[1]
    enough = enough_s(elastic, GEL)
    assert judged(elastic, GEL, enough)["worst_percent"] == pytest.approx(2, rel=0.02)


@pytest.mark.slow
def test_every_protocol_whose_stops_rest_can_be_judged() -> None:
    protocols = shipped()
    assert {"force-calibration", "force-calibration-small", "ball-press", "twist"} <= set(protocols)
    assert not {"demo", "smoke"} & set(protocols)
    for name, protocol in protocols.items():
        job = job_of(name, protocol)
        found = judged(job.work(job.given), GEL, min(protocol.capture.settle_s or 0, 1.0))
        assert 1 < found["worst_percent"] < 20, name


def test_a_series_is_typed_as_shares_and_times() -> None:
    protocol, _ = plan.load("settling")
    assert series_of((), protocol).pairs == protocol.specimen.prony
    assert series_of(("0.1:2", "0.05:30"), protocol).pairs == ((0.1, 2.0), (0.05, 30.0))
    for bad in ("0.1", "a:b", "0.1:"):
        with pytest.raises(InputError, match=r"--prony .*expected G:TAU_S"):
            series_of((bad,), protocol)
    with pytest.raises(InputError, match="tau_s > 0"):
        series_of(("0.1:-2",), protocol)


def test_every_study_says_what_the_modulus_changes() -> None:
    for study in STUDIES:
        assert "0.56 MPa, is known to a factor of 2" in gel_remarks.remark(study, 0.56)


def test_the_protocol_rests_long_and_has_the_feeds_of_the_calibration() -> None:
    own, of = plan.load("settling")[0], plan.load("force-calibration")[0]
    assert own.capture.settle_s >= 60
    assert "image" not in own.channels
    assert own.motion.press_feed_mm_min == of.motion.press_feed_mm_min
    assert own.motion.shear_feed_mm_min == of.motion.shear_feed_mm_min
    assert max(own.depths_mm) == max(of.depths_mm)
