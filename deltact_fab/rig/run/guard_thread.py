"""The guard armed where there is no run: one thread that reads the force sensor meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from ...errors import DeltactFabError
from ..interface import Clock, ForceSensor, Guard, Stage
from .loop import Loop
from .streams import ForceStream

NAME = "force sensor"
ANSWER_S = 10.0
END_S = 5.0


@dataclass(frozen=True)
class Watch:
    """What is felt meanwhile. stream: None where nothing watches. trouble: why it was stopped."""

    stream: ForceStream | None = None
    trouble: list[BaseException] = field(default_factory=list)


@contextmanager
def watched(
    stage: Stage, clock: Clock, force: ForceSensor | None, guard: Guard | None
) -> Iterator[Watch]:
    """The guard sees every sample until the block ends, as in a run; nothing is kept of them.

    The sensor is the thread's for so long, and stopped after that. Without a sensor or a guard
    nothing watches. Raises SensorError, the stage stopped, beyond a limit or for a lost sensor.
    """
    if force is None or guard is None:
        yield Watch()
        return
    stream = ForceStream(force, guard, clock, lambda name, text: None)
    stream.keeping = False
    watch = Watch(stream)
    trouble = watch.trouble

    def failed(why: BaseException) -> None:
        stage.cancel()
        trouble.append(why)

    loop = Loop(NAME, stream.step, failed)
    try:
        loop.ask(force.start, ANSWER_S, going=True)
        try:
            yield watch
        except DeltactFabError as why:
            if trouble:  # what stopped it, rather than what that came to
                raise trouble[0] from why
            raise
        if trouble:
            raise trouble[0]
    finally:
        with suppress(DeltactFabError):
            loop.ask(force.stop, ANSWER_S, going=False)
        loop.end(END_S)
