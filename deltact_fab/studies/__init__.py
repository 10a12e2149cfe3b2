"""Studies: the paper's experiments and extended ones; benchmarks of the numerical engines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .numerics.faults.rehearsal import rehearse
    from .numerics.harness import run_engines
    from .plan.report import write_plan
    from .sequential.looks import GoalLooks
    from .study.registry import STUDIES, Study, StudyRequest, find_study, run_study
    from .trial.start import try_plan
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
