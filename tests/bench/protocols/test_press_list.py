"""Lists of presses: names, random order, repeats, mountings, reference presses, recovery."""

from __future__ import annotations

import json
import random
import re
from pathlib import Path
from typing import Any

import pytest
from rig_text import VIRTUAL_STAGE

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.limits import check_limits
from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.record.files import RUN_FORMAT, load_run_file
from deltact_fab.bench.rig.config import load_rig
from deltact_fab.common import catalog
from deltact_fab.common.checks import Check
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.paths import PACKAGE_DIR

PLACES = [[0.0, 0.0], [3.0, 0.0], [-3.0, 0.0], [0.0, 3.0]]
GRID = {"indenters": ["sphere:10", "4dots"], "positions_mm": PLACES, "depths_mm": [0.5, 1.0]}


def declare(entries: list[dict[str, Any]] | None = None, **changes: Any) -> Protocol:
    form: dict[str, Any] = GRID if entries is None else {"press": entries}
    data = {"name": "t", "channels": ["force", "shear"], "capture": {"settle_s": 1.0}}
    return catalog.validate(Protocol, data | form | changes, "t.toml")


def entry(depth_mm: float = 1.0, indenter: str = "sphere:10", **keys: Any) -> dict[str, Any]:
    return {"indenter": indenter, "depth_mm": depth_mm, **keys}


def names(protocol: Protocol) -> list[str]:
    """Of the presses, in order of the steps."""
    steps = plan.expand_protocol(protocol)
    return list(dict.fromkeys(s.press for s in steps))


def test_order_changes_no_name() -> None:
    usual = names(declare())
    orders = [names(declare(order="random", order_seed=seed)) for seed in range(6)]
    assert all(sorted(order) == sorted(usual) for order in orders)
    assert len({tuple(order) for order in orders}) > 3
    for order in orders:  # one mounting each, and its presses after it
        assert order[0] == "sphere-10/change"
        assert order[5] == "4dots/change"


def test_added_press_keeps_the_order() -> None:
    entries = [entry(0.1 * k) for k in range(1, 9)]
    first = names(declare(entries, order="random", order_seed=5))
    second = names(declare([*entries, entry(1.5)], order="random", order_seed=5))
    assert [name for name in second if name != "sphere-10/p9"] == first


def test_order_is_the_same_everywhere() -> None:
    """A hash, no generator: neither numpy's nor Python's version decides."""
    random.seed(1)
    order = names(declare([entry() for _ in range(6)], order="random", order_seed=1))
    assert [name.rpartition("/")[2] for name in order] == [
        "change", "p5", "p3", "p2", "p1", "p4", "p6"
    ]  # fmt: skip


def test_list_and_grid_are_one_form() -> None:
    grid = declare(depths_mm=[1.0])
    listed = declare([
        entry(1.0, tip, x_mm=x, y_mm=y) for tip in GRID["indenters"] for x, y in PLACES
    ])  # fmt: skip
    kinds = [
        [(s.kind, s.indenter, s.target_mm, s.settled) for s in plan.expand_protocol(p)]
        for p in (grid, listed)
    ]
    assert kinds[0] == kinds[1]
    assert names(listed)[-1] == "4dots/p8"  # by its place in the list


def test_repeats_follow_one_another_by_pass() -> None:
    order = names(declare([entry(), entry(0.5, repeats=3), entry(0.7)], repeats=2))
    assert [name.rpartition("/")[2] for name in order] == [
        "change", "p1", "p2", "p3", "p1r2", "p2r2", "p3r2", "p2r3",
    ]  # fmt: skip


def test_tip_is_mounted_twice() -> None:
    listed = names(declare([entry(), entry(1.0, "4dots"), entry()]))
    assert listed == [
        "sphere-10/change", "sphere-10/p1", "4dots/change", "4dots/p2", "sphere-10/change2",
        "sphere-10/p3",
    ]  # fmt: skip
    tips = ["sphere:10", "4dots", "sphere:10"]
    grid = declare(indenters=tips, repeats=2, order="random")
    mountings: dict[int, set[str]] = {}
    for press in grid.list_presses():
        mountings.setdefault(press.mounting, set()).add(press.name)
    assert mountings[0] == {f"sphere-10/p{n}" for n in range(1, 5)}  # a whole pass in each
    assert mountings[2] == {f"sphere-10/p{n}r2" for n in range(1, 5)}


def test_reference_presses_frame_each_mounting() -> None:
    reference = {"every": 3, "depth_mm": 0.7, "at_mm": [1.0, 0.0]}
    protocol = declare(order="random", reference=reference)
    presses = protocol.list_presses()
    roles = ["reference" if p.role == "reference" else "" for p in presses[:7]]
    assert roles == ["reference", "", "", "", "reference", "", "reference"]
    assert {p.name for p in presses if p.role == "reference"} == {
        f"{slug}/ref{k}" for slug in ("sphere-10", "4dots") for k in (1, 2, 3)
    }
    assert all(
        p.depths_mm == (0.7,) and p.at_mm == (1.0, 0.0) for p in presses if p.role == "reference"
    )


def test_listed_references_keep_their_turn() -> None:
    entries = [entry(), entry(0.5), entry(0.7, role="reference"), entry(0.9), entry(1.1)]
    for seed in range(5):
        order = names(declare(entries, order="random", order_seed=seed))
        assert order[3] == "sphere-10/p3"


def test_drag_of_a_listed_press() -> None:
    protocol = declare([entry(1.0, x_mm=2.0, shear_x_mm=0.5, shear_y_mm=-0.25)])
    steps = {s.id.partition("/p1/")[2]: s for s in plan.expand_protocol(protocol)}
    assert steps["d1.00/shear-x+0.50y-0.25"].target_mm == (2.5, -0.25, -1.0)
    assert steps["after"].target_mm[:2] == (2.5, -0.25)  # straight up: no way across below
    assert steps["d1.00/shear-x+0.50y-0.25"].settled


def test_presses_from_a_table(tmp_path: Path) -> None:
    text = (
        'name = "t"\npresses = "x.csv"\nchannels = ["force", "shear"]\n[capture]\nsettle_s = 1.0\n'
    )
    (tmp_path / "t.toml").write_text(text)
    table = tmp_path / "x.csv"
    header = "indenter, x_mm, y_mm, depth_mm, shear_x_mm, repeats, role\n"
    table.write_text(header + "sphere:10, 1, 2, 0.5,,,\n4dots,,,1,0.5,2,validate\n")
    read, _ = plan.load_protocol(str(tmp_path / "t.toml"))
    expected = [entry(0.5, x_mm=1.0, y_mm=2.0),
                entry(1.0, "4dots", shear_x_mm=0.5, repeats=2, role="validate")]  # fmt: skip
    assert read == declare(expected)
    for rows, message in {
        "": "no presses",
        "sphere:10,1,2,deep": "row 2: depth_mm: 'deep' is not a number",
        "sphere:10,1,2,-1": "row 2: depth_mm: -1.0; expected",
        "sphere:10,1,2": "row 2: depth_mm: missing key",
        "spere:10,1,2,1": "row 2: indenter: .*spere",
        "sphere:10,1,2,1,0,1,fit,9": "row 2: more cells than the header",
        "sphere:10,1,2,1,0,1.5": "row 2: repeats: '1.5' is not a number",
    }.items():
        table.write_text(header + rows)
        with pytest.raises(InputError, match=rf"x\.csv: {message}"):
            plan.load_protocol(str(tmp_path / "t.toml"))
    table.write_text("indentor,depth_mm\nsphere:10,1\n")
    with pytest.raises(InputError, match=r"row 2: indentor: unknown key; .*'indenter'"):
        plan.load_protocol(str(tmp_path / "t.toml"))
    table.unlink()
    with pytest.raises(InputError, match=r"x\.csv"):
        plan.load_protocol(str(tmp_path / "t.toml"))


@pytest.mark.parametrize(
    ("presses", "changes", "message"),
    [
        ([entry()], {"depths_mm": [1.0]}, "depths_mm: not with"),
        ([entry()], {"shear": {"amplitude_mm": 1.0}}, "shear: not with"),
        ([entry()], {"presses": "x.csv"}, "presses: a file"),
        ([entry(shear_x_mm=1.0)], {"channels": ["force"]}, "channels: .*shear_x_mm"),
        ([entry(role="judge")], {}, r"press.*role: must be .*'validate'"),
        ([entry(repeats=0)], {}, r"press.*repeats: "),
        (None, {"indenters": []}, r"indenters: missing key; or list the presses as \[\[press\]\]"),
        (None, {"order": "shuffled"}, "order: must be 'file' or 'random'"),
        (None, {"reference": {"every": 0, "depth_mm": 1.0}}, "reference.every: "),
    ],
)
def test_contradictions_are_refused(
    presses: list[dict[str, Any]] | None, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        declare(presses, **changes)


def test_narrowed_to_a_part() -> None:
    part = declare().narrowed(tips=["4dots"], places_mm=[(3.0, 0.0)], stops_mm=[1.0])
    assert [(p.name, p.at_mm, p.depths_mm) for p in part.list_presses()] == [
        ("4dots/p1", (3.0, 0.0), (1.0,))
    ]
    listed = declare([entry(), entry(0.5, "4dots", x_mm=1.0), entry(0.7, "4dots")])
    assert listed.narrowed(tips=["4dots"]).stops_mm == (0.5, 0.7)
    for whole in (declare(), listed):
        with pytest.raises(InputError):
            whole.narrowed(tips=["star"])


@pytest.mark.parametrize(
    ("prony", "distance_mm", "settle_s", "status"),
    [
        ([[0.5, 20.0]], 0.0, 1.0, "warn"),
        ([[0.5, 20.0]], 0.0, 120.0, "pass"),
        ([[0.5, 20.0]], 26.0, 1.0, "pass"),  # far away
        ([[0.005, 20.0]], 0.0, 1.0, "pass"),  # hardly creeps
        ([[0.5, 0.1]], 0.0, 1.0, "pass"),  # fast
    ],
)
def test_creep_needs_rest_between_presses(
    prony: list[list[float]], distance_mm: float, settle_s: float, status: str, tmp_path: Path
) -> None:
    entries = [entry(x_mm=-distance_mm / 2), entry(x_mm=distance_mm / 2)]
    (tmp_path / "rig.toml").write_text(VIRTUAL_STAGE)
    stage = load_rig(str(tmp_path / "rig.toml"))[0].stage

    def recovery(rest_s: float) -> Check:
        capture = {"settle_s": {"rest": rest_s}}
        protocol = declare(entries, specimen={"prony": prony}, capture=capture)
        rows = check_limits(protocol, load_design("deltact"), stage)
        return next(row for row in rows if row.id == "recovery")

    row = recovery(settle_s)
    assert row.status == status
    assert ("settle_s.rest" in row.reason) == (status == "warn")
    if status == "warn":  # the rest that is told is enough, and hardly more
        more_s = float(row.reason.partition("of rest; ")[2].split()[0])
        assert recovery(settle_s + more_s).status == "pass"
        assert recovery(settle_s + more_s - 2).status == "warn"


def test_one_form_for_all_readers() -> None:
    """Nothing but the protocol itself reads how its file states the presses."""
    form = re.compile(r"\.positions_mm\b|protocol\.(indenters|depths_mm|press\b\[|grid)\b")
    readers = {
        str(file.relative_to(PACKAGE_DIR))
        for file in PACKAGE_DIR.rglob("*.py")
        if form.search(file.read_text())
    }
    assert readers == {"bench/protocols/plan.py"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"presses": 5}, r"run\.json: presses: must be a list \(got 5\)"),
        ({"presses": [5]}, r"run\.json: presses\.0: must be an object"),
        ({"presses": [{"name": "a", "role": "judge"}]}, r"presses\.0\.role: must be 'fit', 'val"),
        ({"rig": {"monitor": 5}}, r"run\.json: rig\.monitor: must be a list"),
    ],
)
def test_strange_record_is_one_line(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"format": RUN_FORMAT, **changes}))
    with pytest.raises(InputError, match=message):
        load_run_file(tmp_path, "run.json")
