"""A measurement over several cores: while one image is followed, the next is made ready."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from threading import Condition, Lock, Thread
from time import monotonic
from types import TracebackType
from typing import Generic, Literal, TypeVar

from ...aliases import Array
from .measurement import ImageTask, Measurement, Step
from .result import Result

T = TypeVar("T")


class Closed(Exception):
    """Nothing more can be put on, or nothing more will come."""


class Belt(Generic[T]):
    """First in, first out. size: what it holds, None for any number. fell: how many fell off."""

    def __init__(self, size: int | None = None) -> None:
        self._size, self._items, self._open = size, deque[T](), True
        self.fell = 0
        self._changed = Condition()

    def put(self, item: T, instead: bool = False) -> None:
        """Put one on, when there is room; instead: at once, and what waits longest falls off.

        Raises Closed.
        """
        with self._changed:
            while self._open and not instead and len(self._items) == self._size:
                self._changed.wait()
            if not self._open:
                raise Closed
            if len(self._items) == self._size:
                self._items.popleft()
                self.fell += 1
            self._items.append(item)
            self._changed.notify_all()

    def get(self, timeout_s: float | None = None) -> T:
        """The next one. Raises Closed when none will come, TimeoutError when none came in time."""
        until_s = None if timeout_s is None else monotonic() + timeout_s
        with self._changed:
            while not self._items:
                if not self._open:
                    raise Closed
                left_s = None if until_s is None else until_s - monotonic()
                if left_s is not None and left_s <= 0:
                    raise TimeoutError
                self._changed.wait(left_s)
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """No more items are added; those on it can still be taken."""
        with self._changed:
            self._open = False
            self._changed.notify_all()


Policy = Literal["every", "newest"]
_KEPT = 64  # results of a live source that wait to be read


class Pipeline:
    """Runs the parts of one measurement in a thread each.

    policy: "every" image is measured, `submit` waits for room: for files. "newest": an image that
    waits gives way to a newer one, and so does a result that no one reads: for cameras; `dropped`
    counts both. While it is open the measurement's own `update` is refused; `reset` works.

        with Pipeline(measurement) as p:
            for result in p.over(images):
                ...
    """

    def __init__(self, measurement: Measurement, policy: Policy = "every") -> None:
        measurement.take(True)
        self.measurement, self.policy = measurement, policy
        self._closing, self._closed = Lock(), False
        steps = measurement.steps()
        self._belts: list[Belt[ImageTask]] = [Belt(1) for _ in steps]
        self._belts.append(Belt(_KEPT if policy == "newest" else None))
        self._threads = [
            Thread(target=self._work, args=(step, *ends), daemon=True)
            for step, *ends in zip(steps, self._belts, self._belts[1:], strict=False)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def dropped(self) -> int:
        """Images and results that gave way so far."""
        return self._belts[0].fell + self._belts[-1].fell

    def submit(self, image: Array, t_s: float | None = None) -> None:
        """Give one image, as to `Measurement.update`; it must not be changed afterwards.

        What is wrong with it is raised where its result is asked for. Raises RuntimeError when the
        pipeline is closed.
        """
        job = self.measurement.job(image, t_s)
        try:
            self._belts[0].put(job, instead=self.policy == "newest")
        except Closed:
            raise RuntimeError("the pipeline is closed") from None

    def result(self, timeout_s: float | None = None) -> Result | None:
        """The next result, in the order of the images; None when closed and none is left.

        Raises what the stages raise of its image, TimeoutError when none came in time.
        """
        try:
            job = self._belts[-1].get(timeout_s)
        except Closed:
            return None
        if job.error is not None:
            raise job.error
        return job.result

    def _next(self, timeout_s: float | None = None) -> Result:
        result = self.result(timeout_s)
        if result is None:
            raise RuntimeError("the pipeline was closed before its images were through")
        return result

    def results(self) -> Iterator[Result]:
        """All results until the pipeline closes. Raises as `result`; may then be called again."""
        while (result := self.result()) is not None:
            yield result

    def over(self, images: Iterable[Array]) -> Iterator[Result]:
        """The results of some images, which are read on while the stages run.

        With "every" a few images later; with "newest" at the first image after each is complete.
        Raises as `result`, which ends it.
        """
        waiting, fell, live = 0, self.dropped, self.policy == "newest"
        for image in images:
            self.submit(image)
            waiting += 1
            try:
                while live or waiting > len(self._belts):
                    yield self._next(0 if live else None)
                    waiting -= 1
            except TimeoutError:  # none is complete
                pass
        while waiting > self.dropped - fell:
            yield self._next()
            waiting -= 1

    def close(self) -> None:
        """Finish what was given and let the measurement go; results can still be read.

        From any thread, and more than once.
        """
        self._belts[0].close()
        for thread in self._threads:
            thread.join()
        with self._closing:
            if not self._closed:
                self._closed = True
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

    def _work(self, step: Step, before: Belt[ImageTask], after: Belt[ImageTask]) -> None:
        # The last belt of a live source gives way as the first one does.
        live = self.policy == "newest" and after is self._belts[-1]
        try:
            while True:
                job = before.get()
                if job.error is None:
                    try:
                        step(job)
                    except Exception as why:  # whoever asks for the result gets it
                        job.error = why
                after.put(job, instead=live)
        except Closed:
            after.close()
