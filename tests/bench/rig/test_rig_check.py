"""`rig check` talks to every device: board on a terminal, box on sockets, images in a folder."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from board import board, rig_file
from click.testing import CliRunner, Result

from deltact_fab.app.cli.main import main
from deltact_fab.bench.record.images import encode_png
from deltact_fab.bench.rig.check import _stop_rows
from deltact_fab.bench.rig.config import GrblConfig, load_rig
from deltact_fab.common.errors import InputError
from deltact_fab.simulate.virtual.served import NetFTServer

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals"),
    pytest.mark.usefixtures("no_boot_loader"),
]

REST = """
max_force_n = [60.0, 60.0, 60.0]
emergency_stop = true
[force]
range_n = [25.0, 25.0, 35.0]
[force.netft]
host = "{host}"
rdt_port = {rdt_port}
http_port = {http_port}
[guard]
force_n = 15.0
[touch]
[camera]
command = ["{python}", "-m", "deltact_fab.simulate.virtual.shown", "images", "30"]
stamped = true
width_px = 64
height_px = 48
"""


@contextmanager
def bench(folder: Path, settings: dict[int, float] | None = None) -> Iterator[None]:
    """A file of a stage alone, and its board."""
    own = {1: 255, **dict.fromkeys((110, 111, 112), 6000), **(settings or {})}
    with board(own) as it:
        rig_file(folder, it.port)
        yield
        assert it.jogs == 0  # nothing has moved


def check(folder: Path, *more: str) -> Result:
    words = ["rig", "check", str(folder / "bench.toml"), "--seconds", "0.3", *more]
    return CliRunner().invoke(main, words)


def test_complete_bench_passes(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for k in range(4):
        image = np.random.default_rng(k).integers(60, 200, (48, 64, 3), dtype=np.uint8)
        (tmp_path / "images" / f"{k}.png").write_bytes(encode_png(image))
    with NetFTServer(lambda t_ns: np.zeros((len(t_ns), 6)), noise_n=0.01) as box, bench(tmp_path):
        with (tmp_path / "bench.toml").open("a") as file:
            way = {
                "python": sys.executable,
                "host": box.host,
                "rdt_port": box.rdt_port,
                "http_port": box.http_port,
            }
            file.write(REST.format(**way))
        found = json.loads(check(tmp_path, "--json").output)
    rows = {(row["device"], row["text"]): row["verdict"] for row in found["rows"]}
    assert {device for device, _ in rows} == {"stage", "force", "camera", "presses"}
    assert {v for (device, _), v in rows.items() if device in ("stage", "presses")} == {"pass"}
    texts = "\n".join(text for _, text in rows)
    for part in ("settings read", "transducer FT00001", "the guard stops the stage at 15",
                 "camera.model: not calibrated", "complete for a press"):  # fmt: skip
        assert part in texts
    ids = [check["id"] for check in found["checks"]]
    assert {"stage.answer", "camera.rate", "force.rate", "presses.rig-file"} <= set(ids)
    assert len(set(ids)) == len(ids) == len(found["rows"])
    assert found["ok"]  # a run would only warn that the camera is not calibrated
    assert {v for (device, _), v in rows.items() if device == "camera"} >= {"WARN"}


@pytest.mark.parametrize(("guard_n", "status"), [(15.0, "pass"), (34.0, "fail")])
def test_late_stop_is_held_against_range(tmp_path: Path, guard_n: float, status: str) -> None:
    path = rig_file(tmp_path, "no-port")
    rest = REST.format(host="h", rdt_port=1, http_port=2, python="p")
    limits = f"axes_n = [15.0, 15.0, {guard_n}]"
    path.write_text(path.read_text() + rest.replace("force_n = 15.0", limits))
    config, _ = load_rig(str(path))
    assert isinstance(config, GrblConfig)
    rows = {row.id: row for row in _stop_rows(config)}
    assert rows["stage.stop-force"].status == status
    assert "stage.emergency-stop" not in rows


def test_faults_are_reported_with_remedy(tmp_path: Path) -> None:
    with bench(tmp_path, {21: 0}):
        done = check(tmp_path)
    assert done.exit_code == 1
    failed = [line for line in done.output.splitlines() if line.startswith("FAIL")]
    assert [line.split()[1] for line in failed] == ["stage"] + ["presses"] * 3
    assert "set $21=1 and connect again" in failed[0]
    assert done.output.splitlines()[-1].endswith("faults: 4")


def test_missing_port_is_reported(tmp_path: Path) -> None:
    rig_file(tmp_path, str(tmp_path / "no-port"))
    done = check(tmp_path)
    assert done.exit_code == 1
    assert "cannot be opened" in done.output
    assert "check its power and cable" in done.output
    with pytest.raises(InputError, match="has no devices"):
        CliRunner().invoke(main, ["rig", "check", "virtual"], catch_exceptions=False)
