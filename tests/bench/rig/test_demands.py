"""What a real rig must have before it presses; nothing is opened to say what is missing."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.bench.rig import config
from deltact_fab.bench.rig.tables import RegisteredTouch, RegistrationFile
from deltact_fab.bench.rig.tool.session import write_registration
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.sensor.optics.camera import StageFrame
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

PROTOCOL = """
name = "poses"
indenters = [{indenters}]
positions_mm = [[0.0, 0.0]]
depths_mm = [1.0]
channels = [{channels}]
[capture]
settle_s = 0.02
"""
STAGE = """
kind = "grbl"
[stage]
port = "/dev/not-there"
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [6000.0, 6000.0, 6000.0]
acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]
max_force_n = [60.0, 60.0, 60.0]
"""
FORCE = """
[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[force.netft]
host = "127.0.0.1"
"""
TOUCH = '[touch]\nby = "force"\n'


def refused(
    folder: Path, rig: str, indenters: str = '"sphere:10"', channels: str = '"force"', **words: bool
) -> str:
    """What `run` says, in one line, before anything is opened or written."""
    protocol, bench = folder / "p.toml", folder / "bench.toml"
    protocol.write_text(PROTOCOL.format(indenters=indenters, channels=channels))
    bench.write_text(rig)
    with pytest.raises(InputError) as why:
        run_experiment(RunRequest(str(protocol), str(bench), folder / "r", **words))  # type: ignore[arg-type]
    assert not (folder / "r").exists()
    assert "\n" not in str(why.value)
    return str(why.value)


def test_each_missing_table_is_named(tmp_path: Path) -> None:
    for rig, words in (
        (STAGE + TOUCH, "bench.toml: force: a press on a real rig needs a force sensor"),
        (STAGE + FORCE, "bench.toml: touch: missing table"),
        (STAGE + FORCE + TOUCH + "at_mm = [15.0, 0.0]\n", "sphere:10 reaches 20 mm out"),
        (STAGE + FORCE + TOUCH + "[guard]\nforce_n = 0.4\n", "the guard trips at 0.4 N"),
        (STAGE + FORCE + TOUCH + "[guard]\nforce_n = 40.0\n", "over the sensor's range"),
        (STAGE + FORCE + TOUCH + "clear_mm = 2.0\n", "touch: clear_mm: 2 is below search_mm"),
        (STAGE + FORCE + TOUCH + '[tools."ball"]\nlength_mm = 1.0\n', "indenter 'ball': unknown"),
    ):
        assert words in refused(tmp_path, rig)
    text = refused(tmp_path, STAGE + FORCE + TOUCH, channels="")
    assert 'must record the force: add "force"' in text


def test_change_of_indenter_is_refused_unattended(tmp_path: Path) -> None:
    two = '"sphere:10", "star"'
    text = refused(tmp_path, STAGE + FORCE + TOUCH, two, unattended=True)
    assert "--unattended: 'poses' mounts an indenter 2 times, which an operator must do" in text


@pytest.mark.slow
def test_protocol_check_reports_tool_lengths(tmp_path: Path) -> None:
    protocol, bench = tmp_path / "p.toml", tmp_path / "bench.toml"
    protocol.write_text(PROTOCOL.format(indenters='"sphere:10", "star"', channels='"force"'))
    bench.write_text(STAGE + FORCE + TOUCH + '[tools."sphere:10"]\nlength_mm = 0.0\n')
    words = ["protocol", "check", str(protocol), "--rig", str(bench)]
    asked = CliRunner().invoke(main, words)
    assert "pass  contact" in asked.output
    row = next(line for line in asked.output.splitlines() if "tool lengths" in line)
    *cells, basis = re.split("  +", row.strip())
    assert cells == ["WARN", "tool lengths", "unknown", "1", "<= 0"]
    assert basis.startswith('[tools."star"] length_mm is not declared')
    alone = CliRunner().invoke(main, [*words, "--unattended"])
    assert "FAIL  contact" in alone.output
    assert "mounts an indenter 2 times" in alone.output
    assert alone.exit_code == 1


def test_registration_replaces_pose_of_rig_file(tmp_path: Path) -> None:
    frame = StageFrame((-60.5, -59.0, -39.25), 0.0, (0.8, -0.5))
    row = RegisteredTouch(at_mm=(1.0, 2.0), machine_mm=(-60.0, -60.0, -39.0), spread_mm=0.004)
    found = RegistrationFile(
        date="", rig="bench.toml", indenter="sphere:10", by="force", residual_mm=0.003,
        touches=(row,) * 4, **dataclasses.asdict(frame),
    )  # fmt: skip
    bench = tmp_path / "bench.toml"
    write_registration(found, tmp_path / "reg.toml")
    bench.write_text(STAGE.replace("port =", 'registration = "reg.toml"\nport ='))
    loaded, _ = config.load_rig(str(bench))
    assert loaded.stage.frame == frame
    bench.write_text(STAGE.replace("port =", 'registration = "none.toml"\nport ='))
    with pytest.raises(InputError, match=r"stage\.registration: 'none\.toml': no such file"):
        config.load_rig(str(bench))
    (tmp_path / "reg.toml").write_text('date = "x"\n')
    bench.write_text(STAGE.replace("port =", 'registration = "reg.toml"\nport ='))
    with pytest.raises(InputError, match=r"reg\.toml: rig: missing key"):
        config.load_rig(str(bench))
    with pytest.raises(RunFailed):
        write_registration(found, tmp_path / "no" / "reg.toml")


def test_registration_needs_real_guarded_rig(tmp_path: Path) -> None:
    bench, out = tmp_path / "bench.toml", tmp_path / "reg.toml"
    bench.write_text(STAGE)
    for rig, more, words in (
        ("virtual", [], "only a real rig can be registered"),
        (str(bench), [], "no force sensor"),
        (str(bench), ["--at", "1;2"], "'--at': '1;2': must be two numbers"),
    ):
        done = CliRunner().invoke(main, ["rig", "register", rig, "-o", str(out), *more])
        assert words in (str(done.exception) + done.stderr)
        assert not out.exists()
