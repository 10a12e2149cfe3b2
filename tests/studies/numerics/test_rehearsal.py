"""What of a lab's protocol is rehearsed, and which faults at which moments."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.rig import config
from deltact_fab.simulate import FaultScenario
from deltact_fab.studies.numerics.faults.kinds import FAULT_KINDS
from deltact_fab.studies.numerics.faults.rehearsal import FaultMatrix, _covering


def test_keeps_first_and_deepest_press() -> None:
    declared, path = plan.load_protocol("pattern-selection")
    found = FaultScenario.from_protocol(declared, path.read_bytes(), config.load_rig("virtual")[0])
    whole = {step.id: step for step in plan.expand_protocol(declared)}
    assert len(found.steps) < 25 < len(whole)
    assert all(step.target_mm == whole[step.id].target_mm for step in found.steps)
    assert {step.frames for step in found.steps} == {0, 1}
    lowest = min(step.target_mm[2] for step in found.steps if step.press == found.second)
    assert lowest == min(step.target_mm[2] for step in whole.values())


def test_all_faults_and_moments_are_covered() -> None:
    moments = [f"moment {k}" for k in range(14)]
    kept = _covering(list(itertools.product([fault.name for fault in FAULT_KINDS], moments)))
    assert len(set(kept)) == len(FAULT_KINDS)
    assert {fault for fault, _ in kept} == {fault.name for fault in FAULT_KINDS}
    assert {moment for _, moment in kept} == set(moments)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX limits and locks")
def test_first_press_is_always_kept(tmp_path: Path) -> None:
    declared, path = plan.load_protocol("smoke")
    keys = {"indenters": ["sphere:10"], "repeats": 2, "order": "random"}
    drawn = plan.Protocol.model_validate(declared.model_dump(mode="json") | keys)
    assert [press.name for press in drawn.list_presses()] == ["sphere-10/p1r2", "sphere-10/p1"]
    rig = config.load_rig("virtual")[0]
    matrix = FaultMatrix(tmp_path, FaultScenario.from_protocol(drawn, path.read_bytes(), rig))
    assert len(matrix.committed["steps"]) == 7
