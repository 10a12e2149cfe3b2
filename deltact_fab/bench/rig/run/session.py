"""One session on an open bench: its steps carried out and recorded, or its devices asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from deltact_fab.common import Progress

from ...protocols.plan import Step
from ...record.writer import RunWriter
from ..interface import Devices, OpenBench, Rig
from ..weights import WeightsBench
from .runner import Runner, RunProgress


def carry_out_steps(
    bench: OpenBench | Devices,
    steps: Sequence[Step],
    writer: RunWriter,
    progress: Progress | None = None,
    live: Callable[[RunProgress], None] | None = None,
) -> tuple[dict[str, int], float]:
    """Carry out steps by the stage, or by a hand that lays weights on, and record them.

    live: shown what goes on. Returns frames late or lost, and the rig's seconds. Raises RunFailed
    and its kin.
    """
    start_s, counts = bench.clock.now_s(), dict[str, int]()
    if isinstance(bench, WeightsBench):
        bench.run(steps, writer, progress)
    else:
        assert isinstance(bench, Devices), "what a hand does not do, a stage does"
        runner = Runner(bench, writer, progress, live)
        runner.run(steps)
        counts = runner.counts()
    return counts, bench.clock.now_s() - start_s


def ask_devices(bench: OpenBench) -> list[str]:
    """Ask each device of a bench; returns a line for each: that it answers, and how.

    The stage is connected, its settings are judged; the camera gives an image, the force sensor
    a reading. Raises InputError, StageError, SensorError.
    """
    lines = []
    if isinstance(bench, Rig):
        bench.stage.connect()
        lines.append(f"stage: {_identity(bench.stage.identity(), 'banner', 'port')}")
    if bench.camera is not None:
        bench.camera.begin("dry-run")
        frame = bench.camera.capture()
        h, w = frame.image.shape[:2]
        age_ms = (bench.clock.now_s() - frame.t_s) * 1e3
        name = _identity(bench.camera.identity(), "name", "kind")
        lines.append(f"camera: {name}: {w} x {h} px, {age_ms:.0f} ms old")
    if bench.force is not None:
        bench.force.start()
        try:
            samples = bench.force.read()
        finally:
            bench.force.stop()
        x, y, z = samples.force_n[-1]
        name = _identity(bench.force.identity(), "kind", "serial")
        lines.append(f"force sensor: {name}: {x:+.2f}, {y:+.2f}, {z:+.2f} N, not tared")
        if samples.saturated.any():
            lines.append("force sensor: SATURATED: the guard would stop the run at once")
    return lines


def _identity(identity: dict[str, object], *keys: str) -> str:
    return " ".join(str(identity[key]) for key in keys if identity.get(key)) or "answers"
