"""Sensor and guard in their own process: a box on sockets, and a pipe for the stage's port."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from numpy.typing import NDArray

from deltact_fab.bench.rig.force.guard import GuardLimits
from deltact_fab.bench.rig.force.watchdog import Watchdog
from deltact_fab.bench.rig.stage.grbl import GRBL_COMMANDS
from deltact_fab.bench.rig.tables import ForceConfig, NetFTConfig
from deltact_fab.common.errors import SensorError
from deltact_fab.simulate.virtual.served import NetFTServer

LIMITS = GuardLimits((5.0, 5.0, 5.0))


class Bench:
    """push_n: on the box, along z. heard: what came out of the stage's port."""

    push_n = 0.0

    def __init__(self, held: ExitStack) -> None:
        self.box = box = held.enter_context(NetFTServer(self._wrench))
        self._port, self.written = os.pipe()
        held.callback(os.close, self._port)
        way = {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port}
        # This machine is busy by itself.
        self.config = ForceConfig(netft=NetFTConfig(**way, silent_s=1.0))

    def _wrench(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.tile([0.0, 0.0, self.push_n, 0.0, 0.0, 0.0], (len(t_ns), 1))

    def heard(self, within_s: float = 5.0) -> bytes:
        if not select.select([self._port], [], [], within_s)[0]:
            return b""
        return os.read(self._port, 1)

    def quiet(self) -> None:
        """Until nothing more comes out."""
        while self.heard(0.3):
            pass


@pytest.fixture
def bench() -> Iterator[Bench]:
    with ExitStack() as held:
        yield Bench(held)


def read_on(watchdog: Watchdog) -> None:
    while True:
        watchdog.read()


def test_guard_process_from_start_to_end(bench: Bench) -> None:
    """One after the other, as each start of a process takes a second."""
    watchdog = Watchdog(bench.config, LIMITS)
    watchdog.hold(bench.written, GRBL_COMMANDS)
    os.close(bench.written)

    watchdog.begin("p")
    watchdog.start()
    assert watchdog.read().force_n[-1] == pytest.approx((0, 0, 0))
    assert not watchdog.tripped
    bench.push_n = -6.0
    assert bench.heard() == b"\x85"  # nobody has asked for a sample
    while not watchdog.tripped:
        samples = watchdog.read()
    assert "Fz = -6.00 N, over the guard's 5 N" in watchdog.tripped
    assert samples.force_n[-1, 2] == -6.0
    with watchdog.easing():
        bench.quiet()
        bench.push_n = -9.0
        assert bench.heard() == b"\x85"  # more than a lift out of the gel may feel
    bench.push_n = 0.0
    while watchdog.read().force_n[-1, 2] < 0:
        pass
    watchdog.rearm()
    bench.quiet()
    assert not watchdog.tripped

    # What nobody fetches is kept.
    watchdog.start()
    begun_ns = watchdog.read().t_ns[0]
    time.sleep(1.2)
    parts = [watchdog.read() for _ in range(4)]
    assert sum(part.n_lost for part in parts) == 0
    assert parts[0].t_ns[0] - begun_ns < 1e9
    assert parts[-1].t_ns[-1] - begun_ns > 1.1e9

    # Silence stops the stage, and a start makes it good.
    bench.box.faults.silent = True
    assert bench.heard() == b"\x85"
    with pytest.raises(SensorError, match="no sample within 1000 ms"):
        read_on(watchdog)
    bench.box.faults.silent = False
    watchdog.rearm()
    watchdog.start()
    assert len(watchdog.read().t_ns)
    bench.quiet()

    # It lets go of the port, and goes on watching.
    watchdog.hold(None, GRBL_COMMANDS)
    assert os.read(bench._port, 1) == b""  # nobody else has it
    bench.push_n = -6.0
    while not watchdog.tripped:
        watchdog.read()

    watchdog._process.kill()
    with pytest.raises(SensorError, match="the guard process died"):
        read_on(watchdog)
    watchdog.close()


PROGRAM = """
import os, sys, time
from deltact_fab.bench.rig.config import ForceConfig
from deltact_fab.bench.rig.force.guard import GuardLimits
from deltact_fab.bench.rig.force.watchdog import Watchdog
from deltact_fab.bench.rig.stage.grbl import GRBL_COMMANDS
if __name__ == "__main__":
    watchdog = Watchdog(ForceConfig.model_validate_json(sys.argv[1]), GuardLimits((5.0,) * 3))
    watchdog.hold(int(sys.argv[2]), GRBL_COMMANDS)
    watchdog.start()
    print("up", flush=True)
    time.sleep(60)
"""


def test_killed_program_stops_the_stage(bench: Bench) -> None:
    words = [sys.executable, "-c", PROGRAM, bench.config.model_dump_json(), str(bench.written)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, pass_fds=[bench.written]) as program:
        os.close(bench.written)
        assert program.stdout is not None
        assert program.stdout.readline() == b"up\n"
        program.kill()
    assert bench.heard() == b"\x85"


def test_unreachable_box_reported_as_in_program(bench: Bench) -> None:
    os.close(bench.written)
    bench.box.close()
    with pytest.raises(SensorError, match=r"cannot be read .* check the box's power"):
        Watchdog(bench.config, LIMITS)
