"""Some presses of a run alone, as the whole run has them.

What a press gives depends on the seed and its name, not on what came before it; so presses can be
carried out anywhere, in any order, and are those of the whole run but for the time of day.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import closing
from pathlib import Path
from typing import Any

from .. import catalog
from ..aliases import Progress
from ..protocols import plan
from ..record import RunWriter
from ..rig.config import VirtualConfig
from ..rig.job import RigSetup
from ..rig.run.runner import Runner
from ..virtual.rig import VirtualKind, VirtualRig
from .meta import meta_of, pattern_of
from .request import Asked


def run_presses(
    job: RigSetup,
    rig: VirtualConfig,
    source: Path,
    presses: Collection[str],
    progress: Progress | None = None,
) -> VirtualRig:
    """Carry out presses (`indenter/position`) of a job on a virtual rig into the job's folder.

    source: of the rig file, from which the paths in it count. What a run is checked for is left to
    the caller. Returns the rig, closed, for what it has to say of its gel. Raises InputError for a
    folder that is there, RunFailed.
    """
    every = plan.expand(job.protocol)
    mounted = {step.indenter for step in every if step.press in presses}
    steps = [
        step
        for step in every
        if step.press in presses or (step.kind == "change" and step.indenter in mounted)
    ]
    kind = VirtualKind(rig, source)
    asked = Asked(job, source, rig, source, kind, steps, False)
    dumped: dict[str, Any] = meta_of(asked, source.stem)
    text = catalog.as_toml(dumped["protocol"]).encode()
    writer = RunWriter.create(
        job.folder, dumped, text, pattern_of(job.recipe), steps, kind.flat(job.protocol)
    )
    try:
        with closing(kind.build(job)) as bench:
            Runner(bench.devices(), writer, progress).run(steps)
        writer.close({"presses": sorted(presses)})
    except BaseException:
        writer.abandon()
        raise
    return bench
