"""Fault rehearsal: a few steps of two presses on a cheap bench in lockstep, with the real host,
force client, guard, runner and record; no gel is solved.

A board outlives the sessions that drive it: the next session finds it as a fault left it.
"""

from __future__ import annotations

import itertools
import math
import resource
import signal
import threading
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partialmethod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltact_fab.bench import (
    CameraFrame,
    Devices,
    FeedImage,
    ForceConfig,
    ForceGuard,
    GrblStage,
    GuardLimits,
    NetFTSensor,
    Protocol,
    RigConfig,
    RunWriter,
    SerialScale,
    Step,
    StreamCamera,
    carry_out_steps,
    expand_protocol,
)
from deltact_fab.common import Image, InputError, SensorError, to_ns
from deltact_fab.sensor import StageFrame

from .clock import VirtualClock
from .controller import GrblController
from .grbl_lines import grbl_settings
from .netft import BoxFaults, Datagram, NetFTBox
from .rig import VirtualForce
from .wire import SerialLink, WireExchange

# By hand, for short rehearsals; the deepest press reaches this share of the guard's limit.
DRAGS_PER_PRESS = 1
MIN_SETTLE_S = 0.2
DEEPEST_FORCE_SHARE = 0.1
SCALE_RATE_HZ = 80.0  # HX711 datasheet: 10 or 80; at 10 a read would hold up the stage
NEWTONS_PER_GRAM = 9.80665e-3  # definition
BOX_FAULT_NAMES = ("silent", "late_s", "error", "saturated", "drop_every", "frozen", "stuck")
_FILE_SIZE_LIMIT = resource.getrlimit(resource.RLIMIT_FSIZE)


@dataclass(frozen=True)
class FaultScenario:
    """A lab's protocol, cut short, on the stage of its rig file.

    text: of the protocol. settings: of the controller, None for its usual ones.
    """

    text: bytes
    steps: tuple[Step, ...]
    frame: StageFrame
    settings: Mapping[int, float] | None
    force: ForceConfig
    limits: GuardLimits

    @classmethod
    def from_protocol(cls, protocol: Protocol, text: bytes, rig: RigConfig) -> FaultScenario:
        """The scenario of a protocol on a rig. Raises InputError for no press."""
        stage = rig.stage
        limits = stage.travel_mm, stage.max_feed_mm_min, stage.acceleration_mm_s2
        settings = {**grbl_settings(*limits), 27: stage.pull_off_mm}
        force = rig.force or ForceConfig()
        guard = GuardLimits.from_config(rig.guard, force)
        return cls(text, _shorten(expand_protocol(protocol)), stage.frame, settings, force, guard)

    @property
    def second(self) -> str:
        """The press in which faults strike: the last."""
        return self.steps[-1].press

    @property
    def limit_n(self) -> float:
        """Trip level of the guard along z."""
        return min(self.limits.force_n[2], self.limits.resultant_n)

    @property
    def hertz(self) -> float:
        """N / mm^1.5 of a gel that the deepest press does not trip the guard on."""
        deepest_mm = max(-step.target_mm[2] for step in self.steps)
        return DEEPEST_FORCE_SHARE * self.limit_n / max(deepest_mm, 0.1) ** 1.5


def _shorten(steps: Sequence[Step]) -> tuple[Step, ...]:
    """The first press and the deepest other; of each its lowest depth, DRAGS, frames at rest.

    A frame in mid-move has another place each time, by what a host's clock makes of it.
    """
    presses = [list(part) for _, part in itertools.groupby(steps, lambda step: step.press)]
    changes = {part[0].indenter: part[0] for part in presses if part[0].kind == "change"}
    presses = [part for part in presses if part[0].kind != "change"]
    if not presses:
        raise InputError("the protocol has no press")
    deepest = min(presses[1:] or presses, key=lambda part: min(s.target_mm[2] for s in part))
    shortened: list[Step] = []
    for part in (presses[0], deepest) if len(presses) > 1 else (deepest,):
        if not shortened or shortened[-1].indenter != part[0].indenter:
            shortened.append(changes[part[0].indenter])
        low = [i for i, step in enumerate(part) if step.kind == "press"][-1]
        for i, step in enumerate(part):
            skipped = step.kind in ("press", "shear") and not low <= i <= low + DRAGS_PER_PRESS
            if not skipped:
                settle_s = max(step.settle_s, MIN_SETTLE_S) if step.frames else 0.0
                shortened.append(replace(step, frames=min(step.frames, 1), settle_s=settle_s))
    return tuple(shortened)


Change = Callable[[bytes], bytes]


@dataclass
class _LineFault:
    """Alter up to `remaining` lines that begin with `begins`, said from from_ns until until_ns."""

    begins: bytes
    change: Change
    from_ns: float
    until_ns: float
    remaining: float


class NoisyController(GrblController):
    _rules: tuple[_LineFault, ...] = ()
    _injected: tuple[tuple[int, bytes], ...] = ()
    first_changed_ns = 0
    """Time of the first altered line; 0: none yet."""

    def alter_lines(
        self,
        change: Change,
        begins: bytes = b"",
        at_s: float = 0.0,
        for_s: float = math.inf,
        limit: float = math.inf,
    ) -> None:
        """Pass up to `limit` lines that begin so and are said in that time through `change`."""
        from_ns = to_ns(at_s)
        self._rules += (_LineFault(begins, change, from_ns, from_ns + for_s * 1e9, limit),)

    lose = partialmethod(alter_lines, lambda line: b"")
    """The same, and the line is lost."""

    def inject(self, words: bytes, at_s: float) -> None:
        """Let the host receive bytes at a time that the controller never sent."""
        self._injected = tuple(sorted((*self._injected, (to_ns(at_s), words))))

    def clear_line_faults(self) -> None:
        """Deliver all further output unchanged."""
        self._rules, self._injected = (), ()

    def take_output(self) -> list[tuple[int, bytes]]:
        """Output as the host receives it, in order of time."""
        output = [(t_ns, self._deliver(t_ns, line)) for t_ns, line in super().take_output()]
        now_ns = self.now_ns()
        output += [(t_ns, words) for t_ns, words in self._injected if t_ns <= now_ns]
        self._injected = tuple(pair for pair in self._injected if pair[0] > now_ns)
        return sorted((pair for pair in output if pair[1]), key=lambda pair: pair[0])

    def next_event_ns(self) -> int | None:
        """Invented words reach the host at their own time, too."""
        times = [t for t in (super().next_event_ns(), *(t for t, _ in self._injected)) if t]
        return min(times, default=None)

    def _deliver(self, t_ns: int, line: bytes) -> bytes:
        for rule in self._rules:
            fits = line.strip() and line.startswith(rule.begins) and rule.remaining > 0
            if fits and rule.from_ns <= t_ns < rule.until_ns:
                rule.remaining -= 1
                self.first_changed_ns = self.first_changed_ns or t_ns
                line = rule.change(line)
        return line


TipPoint = Callable[[], tuple[float, float, float]]
ExtraForce = Callable[[float], float]


class ScalePort:
    """Open port of a simulated load cell: whole grams, a line at every tick.

    load_n: force on it at times (n,) ns. stuck: it repeats its last line.
    """

    def __init__(
        self, clock: VirtualClock, load_n: Callable[[Any], NDArray[Any]], rate_hz: float
    ) -> None:
        self._clock, self._load_n = clock, load_n
        self._line, self._waiting = b"", b""
        self.stuck, self.in_waiting = False, 1
        self.read, self.reset_input_buffer = self._next_lines, lambda: self._next_lines(0)
        self._ticks = clock.schedule(rate_hz, self._write)
        self.close = self._ticks.cancel

    def _next_lines(self, size: int) -> bytes:
        """All lines, or the next one; size: 0 for all."""
        if size and not self._waiting:
            self._clock.advance_to_ns(self._ticks.next_ns)
        waiting, self._waiting = self._waiting, b""
        return waiting

    def _write(self, t_ns: NDArray[np.int64]) -> None:
        for load_n in self._load_n(t_ns).tolist():
            if not (self.stuck and self._line):
                self._line = b"%.0f g\n" % (load_n / NEWTONS_PER_GRAM)
            self._waiting += self._line


class WatchedFaults(BoxFaults):
    """Notes when the first record was taken that tells of something wrong, or does not come."""

    limit_counts = math.inf
    first_bad_ns = 0

    def datagrams(self, t_ns: NDArray[np.int64], records: NDArray[Any]) -> list[Datagram]:
        wrong = any(getattr(self, name) for name in BOX_FAULT_NAMES)
        bad = np.abs(records["counts"][:, :3]).max(axis=1) > self.limit_counts
        if (wrong or bad.any()) and not self.first_bad_ns:
            self.first_bad_ns = int(t_ns[0 if wrong else bad.argmax()])
        return super().datagrams(t_ns, records)


class BenchFeed:
    """A feed of 32 x 24 pixels: an image depends on the press, its number there and the tip.

    It gives an image when it is told to, which makes a camera's thread repeatable.
    """

    name = "bench"
    stamps = "sender"
    check = "its cable"

    def __init__(self, clock: VirtualClock, tip_mm: TipPoint) -> None:
        self._clock = clock
        self._tip_mm = tip_mm
        self._pending = threading.Semaphore(0)
        self._press, self._k = "", 0
        self._last: Image | None = None
        self.hangs = False

    def press(self, name: str) -> None:
        self._press, self._k = name, 0

    def release_image(self, hangs: bool = False) -> None:
        """One image; hangs: from now on the last one, over and over."""
        self.hangs = hangs
        self._pending.release()

    def next(self, timeout_s: float) -> FeedImage | None:
        if not self.hangs and not self._pending.acquire(timeout=timeout_s):
            return None
        if self.hangs and self._last is not None:
            threading.Event().wait(0.01)
            return FeedImage(self._last, self._clock.now_s())
        self._k += 1
        seed = [zlib.crc32(self._press.encode()), self._k]
        image = np.random.default_rng(seed).integers(0, 200, (24, 32, 3), np.uint8)
        image[0, :3, 0] = [round(200 + 20 * p) % 256 for p in self._tip_mm()]
        self._last = image
        return FeedImage(image, self._clock.now_s())

    def identity(self) -> dict[str, Any]:
        return {"kind": "bench"}

    def close(self) -> None:
        """Nothing to release."""


class BenchCamera(StreamCamera):
    """The real camera on that feed, which gives an image as soon as one is asked for.

    faults: "stalled", "hung": from that time on (s) no image comes, or the same one over and over.
    """

    first_bad_ns = 0

    def __init__(self, clock: VirtualClock, tip_mm: TipPoint, faults: Mapping[str, float]) -> None:
        self.feed, self.clock, self.faults = BenchFeed(clock, tip_mm), clock, faults
        super().__init__(self.feed, clock)
        self.feed.release_image()
        super().capture()  # it is up: the first image may take longer than all others

    def begin(self, stream: str) -> None:
        self.feed.press(stream)
        super().begin(stream)

    def capture(self) -> CameraFrame:
        """The next image. What the camera waits in vain on the wall clock passes on the bench's."""
        now_s = self.clock.now_s()
        stalled, hung = (self.faults.get(k, math.inf) <= now_s for k in ("stalled", "hung"))
        if (stalled or hung) and not self.first_bad_ns:
            self.first_bad_ns = self.clock.now_ns()
        if not stalled:
            self.feed.release_image(hung)
        try:
            return super().capture()
        except SensorError:
            self.clock.sleep_s(self.timeout_s)
            raise


class FaultBench:
    """Board, force box and camera on one virtual clock; each session opens them anew.

    board: options of the controller.
    """

    def __init__(self, scenario: FaultScenario, **board: Any) -> None:
        self.scenario = scenario
        self.clock = VirtualClock()
        self.trace: list[WireExchange] = []
        start_mm = (-6.0, -6.0, -6.0)
        self.board = NoisyController(scenario.settings, self.clock, start_mm=start_mm, **board)
        self.link = SerialLink(
            self.board, self.clock, resets_on_open=False, trace=self.trace,
        )  # fmt: skip
        self.extra_n: ExtraForce = lambda t_s: 0.0  # on z beside the gel, by the time (s)
        self.box = NetFTBox(scenario.force, self.clock, 1, self._wrenches, 0.01)
        self.box.faults = self.box_faults = WatchedFaults()
        self.box_faults.limit_counts = scenario.limit_n * self.box.settings().counts_per_n
        self.scale_stuck_s = math.inf  # finite: a load cell is the force sensor, stuck from then on
        self.camera_faults: dict[str, float] = {}  # stalled or hung: from that time on, s
        self._camera_bad_ns = 0
        self.clock.sleep_s(2.0)  # the board is up

    def tip_mm(self, t_s: float | None = None) -> tuple[float, float, float]:
        """True position of the tip in the sensor frame."""
        return self.scenario.frame.to_sensor_mm(self.board.position_mm(t_s))

    def fault_ns(self, at_s: float) -> int:
        """Time at which a fault first showed: its first line, record or frame."""
        bad = (self.board.first_changed_ns, self.box_faults.first_bad_ns, self._camera_bad_ns)
        return max(round(at_s * 1e9), *bad)

    def call_at(self, t_s: float, call: Callable[[], object]) -> None:
        """Call at a time of the clock; the callee must not let time pass."""

        def fire(t_ns: NDArray[np.int64]) -> None:
            ticks.cancel()
            call()

        ticks = self.clock.schedule(1 / (t_s - self.clock.now_s()), fire)

    @staticmethod
    def fill_disk() -> None:
        """Let every further write fail as on a full disk."""
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, _FILE_SIZE_LIMIT[1]))

    @staticmethod
    def free_disk() -> None:
        """Files may grow again."""
        resource.setrlimit(resource.RLIMIT_FSIZE, _FILE_SIZE_LIMIT)

    def clear_faults(self) -> None:
        """Remove all faults; the stage is not moved."""
        self.board.clear_line_faults()
        self.board.fault("door closes")
        self.link.plug()
        for name in BOX_FAULT_NAMES:
            setattr(self.box_faults, name, 0)
        self.scale_stuck_s = math.inf
        self.camera_faults = {}
        self.extra_n = lambda t_s: 0.0

    def run(self, folder: Path, progress: Any = None) -> None:
        """One session: begin the run of that folder, or go on with it. Raises what the run does."""
        case = self.scenario
        steps = list(case.steps)
        if folder.exists():
            writer = RunWriter.resume(folder, steps)
        else:
            # Not "simulated": what is says where its truth is, and here is none.
            meta = {
                "name": folder.name, "protocol": {"name": "bench"}, "rig_name": "bench",
                "rig": {}, "sensor": {}, "camera": None, "simulated": False, "air": False,
                "seed": 1, "versions": {},
            }  # fmt: skip
            writer = RunWriter.create(folder, meta, case.text, {"dots_mm": []}, steps)
        stage = GrblStage(self.link, self.clock, case.frame)
        guard = ForceGuard(stage.cancel, case.limits, self.clock, hold=stage.hold)
        force = self._open_force()
        camera = BenchCamera(self.clock, self.tip_mm, self.camera_faults)
        try:
            devices = Devices(self.clock, stage, camera, force, lambda name: None, guard=guard)
            carry_out_steps(devices, steps, writer, progress)
            writer.close({"frames": sum(step.frames for step in steps)})
        except BaseException:
            writer.abandon()
            raise
        finally:
            self._camera_bad_ns = camera.first_bad_ns
            force.close()
            camera.close()
            stage.close()

    def _open_force(self) -> NetFTSensor | SerialScale:
        if self.scale_stuck_s == math.inf:
            return VirtualForce(self.box, self.clock, None)
        port = ScalePort(self.clock, lambda t_ns: self._wrenches(t_ns)[:, 2], SCALE_RATE_HZ)
        self.call_at(self.scale_stuck_s, lambda: setattr(port, "stuck", True))
        range_n = self.scenario.force.range_n
        table = {"serial": {"port": "simulated", "unit": "g"}, "range_n": range_n}
        return SerialScale(ForceConfig.model_validate(table), self.clock, port)

    def _wrenches(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 6) N, N mm: a Hertzian press, and friction that follows the drag."""
        times_s = [t / 1e9 for t in t_ns.tolist()]
        tips = np.array([self.tip_mm(t_s) for t_s in times_s])
        normal_n = self.scenario.hertz * np.maximum(-tips[:, 2], 0.0) ** 1.5
        out = np.zeros((len(t_ns), 6))
        out[:, 0] = 0.3 * normal_n * np.tanh(tips[:, 0])
        out[:, 2] = -normal_n - [self.extra_n(t_s) for t_s in times_s]
        return out
