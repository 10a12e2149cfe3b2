"""A measurement over several cores: while one image is followed, the next is made ready."""

from __future__ import annotations

from collections.abc import Iterator
from queue import Empty, Queue
from threading import Lock, Thread
from types import TracebackType
from typing import Literal

from ...aliases import Array
from .measurement import ImageTask, Measurement, Step
from .outputs import Result

Policy = Literal["every", "newest"]
_Belt = Queue[ImageTask | None]  # None: nothing more will come
_KEPT = 64  # results of a live source that wait to be read


class Pipeline:
    """Runs the parts of one measurement in a thread each.

    policy: "every" image is measured, `submit` waits for room: for files. "newest": an image that
    waits gives way to a newer one, and so does a result that no one reads: for cameras; `dropped`
    counts both. While it is open the measurement's own `update` is refused; `reset` works.

        with Pipeline(measurement) as p:
            for image in images:
                p.submit(image)
        for result in p.results():
            ...
    """

    def __init__(self, measurement: Measurement, policy: Policy = "every") -> None:
        measurement.take(True)
        self.measurement, self.policy = measurement, policy
        self._giving, self._closed, self._fell = Lock(), False, {0: 0, -1: 0}
        steps = measurement.steps()
        self._belts: list[_Belt] = [*(Queue(1) for _ in steps), Queue()]
        self._threads = [
            Thread(target=self._work, args=(step, *ends), daemon=True)
            for step, *ends in zip(steps, self._belts, self._belts[1:], strict=False)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def dropped(self) -> int:
        """Images and results that gave way so far."""
        return sum(self._fell.values())

    def submit(self, image: Array, t_s: float | None = None) -> None:
        """Give one image, as to `Measurement.update`; it must not be changed afterwards.

        What is wrong with it is raised where its result is asked for. Raises RuntimeError when the
        pipeline is closed.
        """
        job = self.measurement.job(image, t_s)
        with self._giving:
            if self._closed:
                raise RuntimeError("the pipeline is closed")
            self._make_room(0, 1)
            self._belts[0].put(job)

    def result(self, timeout_s: float | None = None) -> Result | None:
        """The next result, in the order of the images; None when closed and none is left.

        Raises what the stages raise of its image, TimeoutError when none came in time.
        """
        try:
            job = self._belts[-1].get(timeout=timeout_s)
        except Empty:
            raise TimeoutError from None
        if job is None:
            self._belts[-1].put(None)  # for whoever asks again
            return None
        if job.error is not None:
            raise job.error
        return job.result

    def results(self) -> Iterator[Result]:
        """All results until the pipeline closes. Raises as `result`; may then be called again."""
        while (result := self.result()) is not None:
            yield result

    def close(self) -> None:
        """Finish what was given and let the measurement go; results can still be read.

        From any thread, and more than once.
        """
        with self._giving:
            first, self._closed = not self._closed, True
            if first:
                self._belts[0].put(None)
        for thread in self._threads:
            thread.join()
        if first:
            self.measurement.take(False)

    def __enter__(self) -> Pipeline:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _make_room(self, which: int, size: int) -> None:
        """On a belt of a live source: what waits longest falls off."""
        while self.policy == "newest" and self._belts[which].qsize() >= size:
            try:
                self._belts[which].get_nowait()
            except Empty:  # taken meanwhile
                return
            self._fell[which] += 1

    def _work(self, step: Step, before: _Belt, after: _Belt) -> None:
        while (job := before.get()) is not None:
            if job.error is None:
                try:
                    step(job)
                except Exception as why:  # whoever asks for the result gets it
                    job.error = why
            if after is self._belts[-1]:
                self._make_room(-1, _KEPT)
            after.put(job)
        after.put(None)
