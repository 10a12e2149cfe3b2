"""A tip that touches where it should not: lifted by force in every way that a motion can end."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import numpy as np
import pytest
from board import board
from felt import Bench, bench
from numpy.typing import NDArray

from deltact_fab.bench.rig.interface import move_to
from deltact_fab.bench.rig.run.contact import NOT_LIFTED, end_contact, lift_after_error, streaming
from deltact_fab.bench.rig.tables import ForceConfig, NetFTConfig
from deltact_fab.common.errors import SensorError, StageError, Stopped
from deltact_fab.simulate.virtual.served import NetFTServer

TOP_MM = 39.0  # of the travel less the pull-off, sensor frame


def pressed(longer_mm: float = 8.0, deep_mm: float = 2.5) -> Bench:
    """A tip longer than declared, so far in the gel while it is believed to be above it."""
    it = bench("sphere:10", longer_mm=longer_mm, guard_n=20.0)
    move_to(it.stage, (0.0, 0.0, longer_mm + 2.0), 600.0)
    it.force.begin("p")
    it.force.stop()
    move_to(it.stage, (0.0, 0.0, longer_mm - deep_mm), 60.0)
    return it


def test_long_tip_leaves_the_gel() -> None:
    it = pressed()
    with streaming(it.clock, it.force) as felt_n:
        outcome = end_contact(it.stage, felt_n, 0.1, to_mm=5.0)
    assert outcome.startswith("the tip was lifted by ")
    assert it.stage.position_mm()[2] > 8.0


@pytest.mark.parametrize(
    ("forces", "up_mm", "says"),
    [
        ([0.02], 2.0, "the tip was lifted by 2.00 mm, force 0.02 N"),
        ([4.0, 1.0, 0.04], 4.0, "the tip was lifted by 4.00 mm, force 0.04 N"),
        ([0.2, 0.19], 3.0, "the tip was lifted by 3.00 mm, force 0.19 N"),
        ([None], 2.0, "the tip was raised by 2.00 mm, contact unknown: no force reading"),
        (
            [12.0] * 9,
            5.0,
            "the tip may be in the gel: force 12.0 N, 5.00 mm higher, it has not fallen",
        ),
        ([12.0 * 0.7**k for k in range(99)], None, "the tip was lifted by "),
    ],
)
def test_outcome_says_what_was_felt(forces: list[float], up_mm: float | None, says: str) -> None:
    it = bench()
    move_to(it.stage, (0.0, 0.0, 10.0), 600.0)
    left = iter(forces)
    assert end_contact(it.stage, lambda: next(left)).startswith(says)
    if up_mm is not None:
        assert it.stage.position_mm()[2] == pytest.approx(10.0 + up_mm, abs=0.002)


def test_lift_ends_at_top_of_travel() -> None:
    it = bench()
    move_to(it.stage, (0.0, 0.0, TOP_MM - 0.5), 600.0)
    outcome = end_contact(it.stage, lambda: 3.0)
    assert outcome == (
        "the tip may be in the gel: force 3.0 N, 0.50 mm higher, at the top of the travel"
    )
    it.stage.start_move((0.0, 0.0, 10.0), 600.0)
    it.clock.sleep_s(0.5)
    it.stage.abort()
    assert end_contact(it.stage, lambda: 3.0) == NOT_LIFTED


@pytest.mark.parametrize("error", [SensorError("tripped"), StageError("late"), KeyboardInterrupt()])
def test_every_end_of_a_motion_lifts(error: BaseException) -> None:
    it = pressed()
    raised = Stopped if isinstance(error, KeyboardInterrupt) else type(error)
    lifting = lift_after_error(it.stage, it.clock, it.force, it.guard)
    with pytest.raises(raised, match=r"(tripped|late|operator); the tip was lifted by"), lifting:
        raise error
    assert it.stage.position_mm()[2] > 8.0


def test_hand_move_against_long_tip_lifts() -> None:
    it = bench("sphere:10", longer_mm=8.0, guard_n=2.0)
    move_to(it.stage, (0.0, 0.0, 12.0), 600.0)

    def watched() -> None:
        """A guard in lockstep, which no thread can be."""
        end_s = it.clock.now_s() + it.stage.start_move((0.0, 0.0, 5.0), 300.0)
        while it.clock.now_s() < end_s:
            it.stage.listen(0.005)
            it.guard.watch(it.force.read())
            if it.guard.tripped:
                raise SensorError(it.guard.tripped)

    it.force.begin("p")
    lifting = lift_after_error(it.stage, it.clock, it.force, it.guard)
    with pytest.raises(SensorError, match="over the guard's 2 N; the tip was lifted by"), lifting:
        watched()
    assert 0 < it.face.deepest_mm < 4.0
    assert it.stage.position_mm()[2] > 8.0


PROGRAM = """
import sys, time
from deltact_fab.bench.rig.force.watchdog import open_guarded
from deltact_fab.bench.rig.interface import WallClock
from deltact_fab.bench.rig.stage.grbl import GrblStage
from deltact_fab.bench.rig.tables import ForceConfig, GuardConfig
from deltact_fab.sensor.optics.camera import StageFrame
port, config, way = sys.argv[1:]
stage = GrblStage(port, WallClock(), StageFrame((-30.0, -30.0, -20.0)))
stage.connect()
force = open_guarded(ForceConfig.model_validate_json(config), GuardConfig(force_n=20.0), stage, 0.1)
stage.home()
stage.start_move((29.8, 29.8, 1.0), 1200.0)
stage.wait()
force.begin("p") if way != "jog" else force.start()
stage.start_move((29.8, 29.8, -4.0), 120.0)
print("down", flush=True)
if way == "reset":
    stage.listen(1.0)
    stage.abort()
stage.wait()
time.sleep(60)
"""


@pytest.mark.parametrize(
    ("way", "lifts", "says"),
    [("press", True, "the program died in a press: the tip was lifted by 2 mm, force 0."),
     pytest.param("jog", False, "", marks=pytest.mark.slow),
     pytest.param("reset", False, "the tip was NOT lifted, force ", marks=pytest.mark.slow)],
)  # fmt: skip
def test_guard_lifts_after_kill_of_program(way: str, lifts: bool, says: str) -> None:
    with ExitStack() as held:
        it = held.enter_context(board())

        def wrenches(t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
            out = np.random.default_rng(int(t_ns[0]) % 2**32).normal(0, 0.01, (len(t_ns), 6))
            out[:, 2] -= 2.0 * max(-20.0 - it.at_mm()[2], 0.0)
            return out

        box = held.enter_context(NetFTServer(wrenches, ForceConfig(rate_hz=500.0)))
        net = NetFTConfig(
            host=box.host, rdt_port=box.rdt_port, http_port=box.http_port, silent_s=1.0
        )
        config = ForceConfig(rate_hz=500.0, netft=net).model_dump_json()
        words = [sys.executable, "-c", PROGRAM, it.port, config, way]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        program = held.enter_context(subprocess.Popen(words, **pipes))  # type: ignore[call-overload]
        assert program.stdout is not None
        assert program.stdout.readline() == "down\n", program.stderr.read()
        time.sleep(1.5)  # 1 mm above the face, 2 mm/s
        program.send_signal(signal.SIGKILL)
        at_mm = it.at_mm()[2]
        said = program.stderr.read()  # until the guard process, which shares it, has ended
        assert it.lowest_mm() > at_mm - 0.6 if way == "press" else True
        assert (it.at_mm()[2] > -20.1) == lifts  # below 0.1 N, and the noise
        assert says in said
    if lifts:
        assert float(re.findall(r"force ([0-9.]+) N", said)[-1]) <= 0.1  # the limit of contact
    assert bool(says) == ("guard: " in said)
