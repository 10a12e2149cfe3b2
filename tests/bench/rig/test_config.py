"""Rig files: of which kind, what they may hold, where old keys went; nothing is opened for it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import serial
from board import rig_file
from click.testing import CliRunner

from deltact_fab.app.cli.gel import path as gel_path
from deltact_fab.app.cli.rig import rig as command
from deltact_fab.bench.rig import config
from deltact_fab.common import catalog
from deltact_fab.common.errors import InputError

STAGE = """
[stage]
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [50.0, 50.0, 50.0]
"""
CAMERA = '[camera]\nmodel = "camera.toml"\n'
LENS = "[virtual.lens]\n"


def loaded(folder: Path, text: str) -> config.RigConfig:
    path = folder / "rig.toml"
    path.write_text(text)
    return config.load_rig(str(path))[0]


def test_each_kind_has_own_tables(tmp_path: Path) -> None:
    virtual = loaded(tmp_path, f'kind = "virtual"\n{STAGE}[virtual.gel]\nspacing_mm = 0.5\n')
    assert virtual.kind == "virtual"
    assert virtual.simulated
    assert virtual.virtual.gel.spacing_mm == 0.5
    grbl = loaded(tmp_path, f'kind = "grbl"\n{STAGE}port = "/dev/ttyACM0"\nbaud = 250000\n')
    assert not grbl.simulated
    assert (grbl.stage.port, grbl.stage.baud, grbl.force) == ("/dev/ttyACM0", 250000, None)
    assert grbl.stage.frame == virtual.stage.frame


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (STAGE, r"kind: missing key; valid: grbl, virtual"),
        ('kind = "gbrl"' + STAGE, r"kind: unknown kind 'gbrl'; did you mean 'grbl'\?"),
        ('kind = "grbl"' + STAGE, r"rig\.toml: stage\.port: missing key; .* as port = "),
        ('kind = "grbl"' + STAGE + 'port = "p"\n[virtual.gel]', r"virtual: unknown key"),
        (
            'kind = "grbl"' + STAGE + 'port = "p"\n' + CAMERA,
            r"camera: source: exactly one of source and command is needed",
        ),
        (
            'kind = "grbl"' + STAGE + 'port = "p"\n[camera]\nsource = "rtsp://a"\ngain = 1',
            r"camera: gain: only for a V4L2 device, and the source is rtsp://a",
        ),
        (
            'kind = "grbl"' + STAGE + 'port = "p"\n[camera]\ncommand = ["cat"]',
            r"camera: width_px, height_px: missing; a command needs them",
        ),
        ('kind = "virtual"' + STAGE + CAMERA, r"camera\.model: .* \[virtual\.lens\] .* a pinhole"),
        ('kind = "virtual"' + STAGE + "[camera]\n" + LENS, r"camera\.model: missing key"),
    ],
)
def test_bad_file_gives_one_line(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says) as why:
        loaded(tmp_path, text)
    assert "\n" not in str(why.value)


@pytest.mark.parametrize(("key", "value"), [("travel_mm", "1e300"), ("max_feed_mm_min", "nan")])
def test_stage_value_beyond_limits_is_refused(key: str, value: str, tmp_path: Path) -> None:
    lines = [f"{key} = [{value}, 1.0, 1.0]" if key in line else line for line in STAGE.split("\n")]
    with pytest.raises(InputError, match=rf"stage\.{key}\.0: "):
        loaded(tmp_path, 'kind = "virtual"' + "\n".join(lines))


def test_show_prints_both_kinds_opening_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*args: Any, **options: Any) -> None:
        raise AssertionError("a port was opened")

    monkeypatch.setattr(serial, "serial_for_url", opened)
    monkeypatch.setattr(serial.Serial, "open", opened)
    path = str(rig_file(tmp_path, "/dev/ttyACM7"))
    shown = CliRunner().invoke(command, ["show", path])
    data = json.loads(CliRunner().invoke(command, ["show", path, "--json"]).stdout)
    assert re.search(r"^stage\.port +/dev/ttyACM7$", shown.stdout, re.MULTILINE)
    assert "virtual" not in shown.stdout
    assert (data["kind"], data["stage"]["port"]) == ("grbl", "/dev/ttyACM7")
    listed = json.loads(CliRunner().invoke(command, ["list", "--json"]).stdout)
    shipped = [row["rig"] for row in listed]
    assert {"virtual", "grbl-bench"} <= set(shipped)
    for name in shipped:
        assert CliRunner().invoke(command, ["show", name]).exit_code == 0
    simulated = CliRunner().invoke(command, ["show", "virtual"]).stdout
    assert re.search(r"^virtual\.gel\.hyperelastic\.tolerance +0\.03$", simulated, re.MULTILINE)


def test_gel_path_needs_simulated_gel() -> None:
    told = CliRunner().invoke(gel_path, ["smoke", "--rig", "grbl-bench"])
    assert isinstance(told.exception, InputError)
    assert str(told.exception).endswith("kind: 'grbl' has no simulated gel; name a virtual rig")


def test_obsolete_key_of_0_2_loads(tmp_path: Path) -> None:
    shipped = catalog.find_file("protocols/rigs", "virtual").read_text()
    old = tmp_path / "old.toml"
    old.write_text(shipped + "\n[virtual.realtime]\ncamera_rate_hz = 10.0\n")
    assert config.load_rig(str(old))[0].stage == config.load_rig("virtual")[0].stage
