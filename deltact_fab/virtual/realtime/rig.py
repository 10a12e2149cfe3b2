"""`run --realtime`: the real bench, whose devices are simulated in a process of their own."""

from __future__ import annotations

import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...aliases import Progress
from ...errors import RunFailed
from ...rig.bench import GrblRig
from ...rig.config import GrblConfig, VirtualConfig
from ...rig.interface import Camera, ForceSensor
from ...rig.job import Devices, RigSetup
from ..presolve import PressRow, solve_ahead
from ..rig import VirtualKind

END_S = 10.0
# Not `-m`, by which its classes would be those of `__main__`.
MAIN = "from deltact_fab.virtual.realtime.process import main; main()"


class RemoteBench:
    """The process below the wires, and what its host sends it outside them.

    rig: what a lab's rig file would say of its devices. Raises RunFailed when it cannot be started
    or has ended, and what it raises itself.
    """

    def __init__(self, config: VirtualConfig, job: RigSetup) -> None:
        self._lock = threading.Lock()
        # A session of its own: Ctrl-C is the host's to answer.
        self._process = subprocess.Popen(
            [sys.executable, "-c", MAIN],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            self.rig: GrblConfig = self._ask((config, job))
        except BaseException:
            self.close()
            raise

    def ask(self, what: str, **told: object) -> Any:
        """One request; see `process.LiveBench`."""
        return self._ask((what, told))

    def close(self) -> None:
        """End the process; again does nothing."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()

    def _ask(self, what: object) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            with self._lock:  # a press begins in one thread and ends in another
                pickle.dump(what, self._process.stdin)
                self._process.stdin.flush()
                answer = pickle.load(self._process.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError) as why:
            raise RunFailed(
                f"the simulated bench has ended (process {self._process.pid}, status "
                f"{self._process.poll()}): its devices are gone"
            ) from why
        if isinstance(answer, BaseException):
            raise answer
        return answer


PATIENT_FORCE = 40.0
"""Times the silence, and the age, that force samples are allowed: the box shares this computer's
processors with all that runs on it."""


class RealtimeKind(VirtualKind):
    """Implements rig.interface.RigKind: as `virtual`, carried out by the real bench."""

    def build(self, job: RigSetup, progress: Progress | None = None) -> RealtimeRig:  # type: ignore[override]
        """Solve what is not in the store, start the process, and open its devices."""
        protocol, skin = job.protocol, job.sensor.skin

        def tell(row: PressRow) -> None:
            if progress is not None and not row.found:
                progress(row.done, row.knots, f"solving {row.press}")

        if not job.air and not protocol.channels.isdisjoint(("image", "force")):
            solve_ahead(protocol, skin, self._config.virtual.gel, told=tell)
        with ExitStack() as opened:
            hands = RemoteBench(self._config, job)
            opened.callback(hands.close)
            # The process mounts what it is told to: no confirmation is needed.
            alone = replace(job, unattended=True)
            bench = GrblRig(hands.rig, Path(), alone, patience=PATIENT_FORCE)
            opened.callback(bench.close)
            return RealtimeRig(hands, bench, opened.pop_all())


class RealtimeRig:
    """Implements rig.interface.Rig: a bench on real wires, and the hands below them."""

    def __init__(self, hands: RemoteBench, bench: GrblRig, opened: ExitStack) -> None:
        """hands: mount the indenters, and know where the carriage is. opened: closes both."""
        self.hands, self._bench, self._open = hands, bench, opened
        self._told: dict[str, Any] = {}
        self._begun = ""

    def devices(self) -> Devices:
        """Those of the bench; the simulated gel is told of a press and an indenter first."""
        found = self._bench.devices()
        change = found.change_indenter

        def mounted(indenter: str) -> str | None:
            self.hands.ask("mount", indenter=indenter)
            return change(indenter)

        found.change_indenter = mounted
        if found.force is not None:
            found.force = _ToldForce(found.force, self._begin)
        if found.camera is not None:
            found.camera = _ToldCamera(found.camera, self._begin, self._end)
        return found

    def _begin(self, press: str) -> None:
        """Once a press, by the first device that begins it."""
        if press != self._begun:
            self._begun = press
            self.hands.ask("begin", press=press)

    def _end(self, press: str, frames: Mapping[str, float]) -> None:
        self.hands.ask("end", press=press, frames=dict(frames))
        self._begun = ""

    def identity(self) -> dict[str, Any]:
        """Of the devices as the bench sees them."""
        return self._bench.identity()

    def left_out(self) -> list[str]:
        """What was neither built nor solved."""
        return [*self._bench.left_out(), *self._about()["left_out"]]

    def notes(self) -> list[str]:
        """What a reader of the results must know."""
        about = self._about()
        lines = list(about["notes"])
        if about["drawn"]:
            rate_hz = about["drawn"] / about["seen_s"]
            lines.append(
                f"realtime: {rate_hz:.1f} images a second were drawn, {1e3 * about['draw_s']:.0f} "
                "ms of processor time each; an image shows the moment of its stamp"
            )
        if about["guessed"]:
            lines.append(
                "realtime: off the planned ways, as on the way out of the gel, force and surface "
                "are scaled from the last solved state and not solved; on them what a touch-off is "
                "off by, some hundredths of a millimetre, is not seen or felt"
            )
        return lines

    def close(self) -> None:
        """Close the devices, then end the process; again does nothing."""
        self._open.close()

    def _about(self) -> dict[str, Any]:
        if not self._told:
            self._told = self.hands.ask("about")
        return self._told


class _ToldForce:
    """A force sensor that announces each press to another device first."""

    def __init__(self, force: ForceSensor, begin: Callable[[str], None]) -> None:
        self._force, self._begin = force, begin
        self.start, self.stop, self.read = force.start, force.stop, force.read
        self.identity, self.close = force.identity, force.close

    def begin(self, stream: str) -> None:
        self._begin(stream)
        self._force.begin(stream)


class _ToldCamera:
    """A camera that announces each press to another device first, and its frames at its end."""

    def __init__(
        self,
        camera: Camera,
        begin: Callable[[str], None],
        end: Callable[[str, Mapping[str, float]], None],
    ) -> None:
        self._camera, self._begin, self._end = camera, begin, end
        self._stream = ""
        self.capture, self.identity, self.close = camera.capture, camera.identity, camera.close

    def begin(self, stream: str) -> None:
        self._stream = stream
        self._begin(stream)
        self._camera.begin(stream)

    def end(self, frames: Mapping[str, float]) -> None:
        self._camera.end(frames)
        self._end(self._stream, frames)
