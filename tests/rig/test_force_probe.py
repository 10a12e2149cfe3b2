"""What `rig check` finds at a force sensor: the simulated box on sockets, a scale on a terminal."""

from __future__ import annotations

import numpy as np
import pytest

from deltact_fab.rig.config import ForceConfig, GuardConfig
from deltact_fab.rig.force.config import NetFTConfig
from deltact_fab.rig.force.probe import probe
from deltact_fab.virtual.netft_server import NetFTServer


def served(noise_n: float = 0.01) -> NetFTServer:
    return NetFTServer(lambda t_ns: np.zeros((len(t_ns), 6)), noise_n=noise_n)


def found(box: NetFTServer, guard: GuardConfig | None = None, **own: object) -> dict[str, bool]:
    way = NetFTConfig(host=box.host, rdt_port=box.rdt_port, http_port=box.http_port, silent_s=2)
    config = ForceConfig(netft=way, **own)  # type: ignore[arg-type]
    return {row.text: row.verdict == "pass" for row in probe(config, guard, 0.3)}


def test_a_good_box_passes_with_what_it_is() -> None:
    with served() as box:
        lines = found(box)
    wrong = [text for text, passed in lines.items() if not passed]
    assert all(" late" in text or "samples a second" in text for text in wrong)  # a busy machine
    text = "\n".join(lines)
    for part in (
        "transducer FT00001, product Simulated Net F/T, box serial SIM1",
        "1e+06 counts a newton, 100000 a newton millimetre",
        "force.range_n = [25.0, 25.0, 35.0], as the transducer's",
        "of 1000 samples a second",
        "are left after the tare",
        "noise at rest 0.01",
        "the guard stops the stage at 20, 20, 28 N and 200, 200, 200 N mm",
    ):
        assert part in text


@pytest.mark.slow
def test_what_is_wrong_says_what_would_be_right() -> None:
    with served(0.0) as box:
        lines = found(box, GuardConfig(force_n=60.0), range_n=(50.0, 50.0, 70.0))
        wrong = "\n".join(text for text, passed in lines.items() if not passed)
        assert "[50.0, 50.0, 70.0]; the transducer's is [25.0, 25.0, 35.0]: write that" in wrong
        assert "do not change at all: is the transducer plugged in?" in wrong
        assert "guard: the limit 60 of Fx is over the sensor's range of 50" in wrong
        box.faults.error = True
        assert "fault, status word 0x80000000" in "\n".join(found(box))
        box.page["comrdte"] = "Disabled"
        assert list(found(box).values()) == [False]
