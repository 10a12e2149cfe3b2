"""The settling study on what it is made from: stops, protocols, the page; its gel is in `_slow`."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.analysis.relaxation import Series
from deltact_fab.errors import InputError
from deltact_fab.protocols import plan
from deltact_fab.study import gel_remarks
from deltact_fab.study.registry import STUDIES
from deltact_fab.study.settling import series_of, shipped
from deltact_fab.study.settling_stops import enough_s, follow, judged, simulated, slow_force

GEL = Series((0.1,), (2.0,))
COARSE = {"spacing_mm": 1.0, "press_increment_mm": 0.5, "shear_increment_mm": 1.0}
SKIN = {"width_mm": 36.0, "length_mm": 34.0, "thickness_mm": 12.0}


def way(depths: list[float], settle_s: float) -> dict:
    """A press of the linear gel with drags, as a job follows it."""
    protocol, _ = plan.load("settling")
    data = protocol.model_dump(mode="json", exclude={"description"})
    data |= {"depths_mm": depths, "capture": {"settle_s": settle_s}}
    data["specimen"] |= {"gel_model": "linear", "prony": []}
    return follow({"protocol": data, "skin": SKIN, "gel": COARSE, "press": "sphere-15/p1"})


@pytest.fixture(scope="module")
def elastic() -> dict:
    return way([0.5, 1.0], 1.0)


def test_a_way_is_followed_stop_by_stop(elastic: dict) -> None:
    stops = elastic["stops"]
    assert [stop["id"].split("/", 2)[2] for stop in stops] == [
        "d0.50/press", "d0.50/shear-x+", "d0.50/shear-x-", "d0.50/shear-x0",
        "d1.00/press", "d1.00/shear-x+", "d1.00/shear-x-", "d1.00/shear-x0",
    ]  # fmt: skip
    assert [stop["rests_s"] for stop in stops] == [1.0, 1.0, 1.0, 0.0] * 2
    force = elastic["force_n"]
    assert force[0] == pytest.approx([0, 0, 0])
    press, right, left = (force[stop["arrived"]] for stop in stops[:3])
    assert press[2] < -0.5
    assert press[2] == pytest.approx(right[2], rel=0.02)
    assert right[0] > 0.1
    assert right[0] == pytest.approx(-left[0], rel=0.05)
    # At the feed of the protocol: .5 mm in a second, then .2 mm each way.
    t = [elastic["t_s"][stop["arrived"]] for stop in stops[:3]]
    assert t == pytest.approx([1.0, 1.4, 2.2])


def viscous(elastic: dict, rest_s: float) -> dict:
    """What a gel that relaxes just as the closed form has it would give on the same way."""
    t, force, stops, now = [0.0], [elastic["force_n"][0]], [], 0.0
    parts = np.diff(np.concatenate([[0.0], np.geomspace(0.01, rest_s, 80)]))
    for n in range(1, len(elastic["t_s"])):
        now += elastic["t_s"][n] - elastic["t_s"][n - 1]
        t.append(now)
        force.append(elastic["force_n"][n])
        for stop in elastic["stops"]:
            if stop["arrived"] == n:
                arrived = len(t) - 1
                for part in parts if stop["rests_s"] else ():
                    now += part
                    t.append(now)
                    force.append(elastic["force_n"][n])
                stops.append({**stop, "arrived": arrived, "left": len(t) - 1})
    slow = np.array(force)
    return {"t_s": np.array(t), "force_n": slow + GEL.excess(t, slow), "stops": stops}


def test_stops_of_a_gel_that_follows_the_closed_form_wait_as_long_as_it_says(elastic: dict) -> None:
    found = viscous(elastic, rest_s=40.0)
    assert slow_force(found, elastic)[-1] == pytest.approx(elastic["force_n"][-1])
    stops = simulated(found, elastic, GEL)
    assert [stop.kind for stop in stops] == ["press", "shear", "shear"] * 2
    assert [stop.group for stop in stops] == ["0.5 mm"] * 3 + ["1 mm"] * 3
    for stop in stops:
        assert stop.excess_n == pytest.approx(stop.series_n, abs=1e-6)
        share, row = stop.excess_n[0] / stop.steady_n, stop.row()
        if share > 0.02:
            assert row["wait_2_percent_s"] == pytest.approx(2 * np.log(share / 0.02), rel=0.01)
        assert row["wait_5_percent_s"] <= row["wait_2_percent_s"] < row["wait_1_percent_s"]


def test_half_and_twice_the_modulus_move_newtons_and_no_share(elastic: dict) -> None:
    soft = {**elastic, "force_n": elastic["force_n"] / gel_remarks.MODULUS_FACTOR}
    one, other = (
        [stop.row() for stop in simulated(viscous(way_, 40.0), way_, GEL)]
        for way_ in (elastic, soft)
    )
    for a, b in zip(one, other, strict=True):
        assert a["wait_2_percent_s"] == pytest.approx(b["wait_2_percent_s"], rel=1e-9)
        assert a["at_once_n"] == pytest.approx(gel_remarks.MODULUS_FACTOR * b["at_once_n"])


def test_a_protocol_is_judged_by_the_closed_form_and_rests_make_it_better(elastic: dict) -> None:
    rows = [judged(elastic, GEL, rest) for rest in (0.0, 1.0, 5.0, 60.0)]
    worst = [row["worst_percent"] for row in rows]
    assert worst == sorted(worst, reverse=True)
    assert worst[0] > 3
    assert worst[-1] < 1e-6
    # The first press, by hand: a ramp of a second, then the rest.
    alone = judged(way([0.5], 1.0), GEL, 1.0)
    stop = elastic["stops"][0]
    part = elastic["t_s"] <= elastic["t_s"][stop["arrived"]]
    t, force = elastic["t_s"][part], elastic["force_n"][part]
    first = GEL.excess([*t, t[-1] + 1.0], [*force, force[-1]])[-1]
    assert alone["worst_n"] >= np.linalg.norm(first) > 0
    # What all stops have in common is taken out of the scatter.
    assert 0 < rows[1]["normal_scatter_n"] < rows[1]["worst_n"]
    assert 0 < rows[1]["normal_common_percent"] < worst[1]
    enough = enough_s(elastic, GEL)
    assert judged(elastic, GEL, enough)["worst_percent"] == pytest.approx(2, rel=0.02)


@pytest.mark.slow
def test_every_protocol_whose_stops_rest_can_be_judged() -> None:
    settle, jobs = shipped({"skin": SKIN, "gel": COARSE})
    assert {"force-calibration", "force-calibration-small", "ball-press", "twist"} <= set(settle)
    assert not {"settling", "demo", "smoke"} & set(settle)
    for (name, own), job in zip(settle.items(), jobs, strict=True):
        assert own > 0
        assert 1 < judged(job.work(job.given), GEL, own)["worst_percent"] < 20, name


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
