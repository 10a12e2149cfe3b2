"""From the kind that a rig file names to the code that knows it."""

from __future__ import annotations

from pathlib import Path

from ..aliases import Progress
from ..errors import InputError
from ..rig.config import RigConfig
from ..rig.job import RigKind


def kind_of(
    rig: RigConfig, source: Path, realtime: bool = False, progress: Progress | None = None
) -> RigKind:
    """What a kind of rig says and builds. Only the one that is asked for is imported.

    source: of the rig file, from which the paths in it count. realtime: a virtual rig on the wall
    clock and real wires. progress: hears of what is solved before that. Raises InputError.
    """
    if rig.kind == "grbl":
        from ..rig.bench import GrblKind

        if realtime:
            raise InputError(f"{source}: --realtime is for a virtual rig; this one is real")
        return GrblKind(rig, source)
    if realtime:
        from ..virtual.realtime.rig import RealtimeKind

        return RealtimeKind(rig, source, progress)
    from ..virtual.rig import VirtualKind

    return VirtualKind(rig, source)
