"""The head of calibration files: whose they are, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from deltact_fab.errors import InputError
from deltact_fab.measure.sensor_id import (
    CalibrationSource,
    Head,
    SensorId,
    read_calibration,
    require_same,
)
from deltact_fab.optics import Pinhole

CAMERA = Pinhole(mm_per_px=0.0378, width_px=798, height_px=586, eye_distance_mm=12.85)
SENSOR = SensorId.of(CAMERA, {"law": "algorithm1", "seed": 7}, "deltact", "A1")
HEAD = Head("force", SENSOR, CalibrationSource(("run-1",), True, "0.1.0", 3))


def test_a_file_gives_back_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    tables = {"model": {"name": "sums", "gain": [1.5, -2e-7]}, "empty": {}}
    path.write_text(HEAD.toml(tables))
    assert read_calibration(path, "force") == (HEAD, tables)
    bare = replace(HEAD, sensor=SensorId.of(CAMERA))
    path.write_text(bare.toml({}))
    assert read_calibration(path) == (bare, {})


def test_another_sensor_is_told_by_what_both_know() -> None:
    require_same(SENSOR, SENSOR, "c.toml")
    require_same(SENSOR, SensorId.of(CAMERA), "c.toml")  # a bare camera knows no serial
    other = replace(SENSOR, serial="B2", camera=SensorId.of(replace(CAMERA, mm_per_px=0.04)).camera)
    with pytest.raises(InputError, match=r"^c.toml: .*serial 'A1', not 'B2'; camera .*--transfer"):
        require_same(SENSOR, other, "c.toml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("schema = 1", "schema = 99", "schema: 99, this version reads 1"),
        ('kind = "force"', 'kind = "depth"', "a calibration of depth, not of force"),
        ('kind = "force"', 'kind = "smell"', "valid: depth, force"),
        ("gain = 1.5", "gain = nan", "model.gain: not a finite number"),
        ("gain = 1.5", "gain = [1.0, [inf]]", "model.gain.1.0: not a finite number"),
        ("gain = 1.5", "gain = ", "not valid TOML"),
        ('serial = "A1"', "serial = 7", "sensor.serial"),
        ('serial = "A1"', 'colour = "red"', "sensor.colour: unknown key"),
        ('version = "0.1.0"', "", "made.version: missing key"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "calibration.toml"
    text = HEAD.toml({"model": {"gain": 1.5}})
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as why:
        read_calibration(path, "force")
    assert said in str(why.value)
    assert str(path) in str(why.value)
    assert "\n" not in str(why.value)


def test_a_file_that_is_no_calibration(tmp_path: Path) -> None:
    path = tmp_path / "camera.toml"
    path.write_text("[camera]\n")
    with pytest.raises(InputError, match="not a calibration"):
        read_calibration(path)
    with pytest.raises(InputError, match="no such file"):
        read_calibration(tmp_path / "gone.toml")
