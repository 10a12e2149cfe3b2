"""Goals of --until: their text, the presses that can show them, and the planned looks."""

from __future__ import annotations

from typing import Any

import pytest

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.studies.sequential.goal import RunGoal, count_places, planned_looks


def protocol(fit: int = 8, test: int = 6, **keys: Any) -> Protocol:
    """Presses to fit and to validate by turns, at places of their own, along y."""
    press: list[dict[str, Any]] = []
    for k in range(max(fit, test)):
        for role in ["fit"] * (k < fit) + ["validate"] * (k < test):
            y_mm = (k + 1) / 10 + (role == "fit")
            press.append({"indenter": "sphere:6", "y_mm": y_mm, "depth_mm": 0.5, "role": role})
    drag = keys.pop("drag", {})
    for row in press:
        row |= drag.get(row["role"], {})
    data = {
        "name": "p", "press": press, "channels": ["image", "force", "shear"],
        "capture": {"settle_s": 1.0}, **keys,
    }  # fmt: skip
    return validate(Protocol, data, "p.toml")


@pytest.mark.parametrize(
    ("text", "goal"),
    [
        ("normal 0.1N", RunGoal("normal", 0.1, "N")),
        (" shear_x  2e-2 N ", RunGoal("shear_x", 0.02, "N")),
        ("torque_z 1.5 N mm", RunGoal("torque_z", 1.5, "Nmm")),
        ("torque_x 3Nmm", RunGoal("torque_x", 3.0, "Nmm")),
    ],
)
def test_goal_from_text(text: str, goal: RunGoal) -> None:
    assert RunGoal.from_text(text) == goal
    assert RunGoal.from_record(goal.as_dict()) == goal


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0.1", "must be a component and its error, as --until \"normal 0.1N\""),
        ("normal 0.1", "must be a component"),
        ("normal 0.1mm", "must be a component"),
        ("norml 0.1N", "no component; did you mean 'normal'"),
        ("normal 0N", "must be a number above 0"),
        ("normal 1.1.1N", "must be a number above 0"),
        ("normal 1e999N", "must be"),
        ("normal 0.1Nmm", "its unit is N"),
        ("torque_x 1N", "its unit is Nmm"),
    ],
)  # fmt: skip
def test_faulty_goal_is_refused(text: str, says: str) -> None:
    with pytest.raises(InputError, match=r"^--until: ") as error:
        RunGoal.from_text(text)
    assert says in str(error.value)


DRAG = {"shear_x_mm": 0.2}


@pytest.mark.parametrize(
    ("text", "keys", "says"),
    [
        ("normal 1N", {}, ""),
        ("normal 1N", {"test": 0}, 'no press of role "validate"'),
        ("normal 1N", {"fit": 0}, 'no press of role "fit"'),
        ("normal 1N", {"test": 3}, "presses to validate at 3 places or tips; at least 4"),
        ("normal 1N", {"channels": ["force"]}, "channels: add ['image']"),
        ("shear_x 1N", {}, 'no press of role "fit" varies shear_x; drag it along x'),
        ("shear_x 1N", {"drag": {"fit": DRAG}}, 'of role "validate" varies shear_x'),
        ("shear_x 1N", {"drag": {"fit": DRAG, "validate": DRAG}}, ""),
        ("shear_y 1N", {"drag": {"fit": DRAG, "validate": DRAG}}, "drag it along y"),
        ("torque_x 1Nmm", {}, ""),
        ("torque_y 1Nmm", {}, 'varies torque_y; press beside the centre'),
        ("torque_z 1Nmm", {}, "varies torque_z; drag it beside the centre"),
        ("torque_z 1Nmm", {"drag": {"fit": DRAG, "validate": DRAG}}, ""),
    ],
)  # fmt: skip
def test_presses_that_show_a_goal(text: str, keys: dict[str, Any], says: str) -> None:
    goal, plan = RunGoal.from_text(text), protocol(**keys)
    if not says:
        goal.require_shown_by(plan, "p.toml")
        return
    with pytest.raises(InputError, match=r"^p.toml: --until") as error:
        goal.require_shown_by(plan, "p.toml")
    assert says in str(error.value)


def test_mirror_images_are_one_place() -> None:
    plan = protocol(test=2)
    mirrored = [e.model_copy(update={"y_mm": -e.y_mm}) for e in plan.press]
    data = plan.model_dump(mode="json")
    data["press"] += [entry.model_dump() for entry in mirrored]
    assert count_places(validate(Protocol, data, "p").list_presses()) == 2


def test_looks_follow_blocks() -> None:
    assert planned_looks(protocol()) == [8, 14]
    assert planned_looks(protocol(fit=9, test=9)) == [8, 16, 18]
    reference = {"every": 4, "depth_mm": 0.5}
    plan = protocol(reference=reference)
    looks = planned_looks(plan)
    # ref, 4, ref | 4, ref | 4, ref | 2, ref
    assert looks == [6, 11, 16, 19]
    roles = [press.role for press in plan.list_presses()]
    assert [roles[n - 1] for n in looks] == ["reference"] * 4
