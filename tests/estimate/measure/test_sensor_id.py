"""The head of calibration files: whose they are, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.sensor_id import (
    CalibrationHead,
    CalibrationSource,
    SensorId,
    SensorModel,
    read_calibration,
    require_same_sensor,
)
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.optics.fisheye import Fisheye

CAMERA = Pinhole(mm_per_px=0.0378, width_px=798, height_px=586, eye_distance_mm=12.85)
SENSOR = SensorModel(
    CAMERA, recipe={"law": "algorithm1", "seed": 7}, design="deltact", serial="A1"
).id
HEAD = CalibrationHead("force", SENSOR, CalibrationSource(("run-1",), True, "0.1.0", 3))


def test_file_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    tables = {"model": {"name": "sums", "gain": [1.5, -2e-7]}, "empty": {}}
    path.write_text(HEAD.toml(tables))
    assert read_calibration(path, "force") == (HEAD, tables)
    bare = replace(HEAD, sensor=SensorModel(CAMERA).id)
    path.write_text(bare.toml({}))
    assert read_calibration(path) == (bare, {})


def test_other_sensor_named_by_common_keys() -> None:
    require_same_sensor(HEAD, SENSOR, "c.toml")
    require_same_sensor(HEAD, SensorModel(CAMERA).id, "c.toml")  # a bare camera knows no serial
    nearer = SensorModel(replace(CAMERA, mm_per_px=0.04)).id
    other = replace(SENSOR, serial="B2", pattern={"law": "iid", "seed": 7}, camera=nearer.camera)
    with pytest.raises(InputError) as why:
        require_same_sensor(HEAD, other, "c.toml")
    assert str(why.value) == (
        "c.toml: made on another sensor: serial 'B2' here, 'A1' in this file; pattern.law 'iid' "
        "here, 'algorithm1' in this file; camera.mm_per_px 0.04 here, 0.0378 in this file; "
        "`deltact-fab calibrate force RUN --transfer c.toml` makes one for this sensor"
    )


def test_refitted_lens_named_by_numbers(tmp_path: Path) -> None:
    """Of a file that was read again; and one of before, which kept a digest, by that."""
    lens = Fisheye()
    before = CalibrationHead("depth", SensorModel(lens, serial="A1").id, HEAD.made)
    path = tmp_path / "depth.toml"
    path.write_text(before.toml({}))
    head, _ = read_calibration(path)
    require_same_sensor(head, SensorModel(lens).id, str(path))
    again = replace(lens, f_px=lens.f_px + 1, k2=0.01, aspect=1 + 1e-9, x0_mm=0.1)
    with pytest.raises(InputError) as why:
        require_same_sensor(head, SensorModel(again).id, str(path))
    f_px, k2, aspect, rest = str(why.value).partition("camera file: ")[2].split("; ", 3)
    assert f_px == f"camera.f_px {lens.f_px + 1:.6g} here, {lens.f_px:.6g} in this file"
    assert (k2, aspect.split()[1]) == ("camera.k2 0.01 here, 0 in this file", "1.000000001")
    assert rest.startswith("1 more; ")
    assert "`deltact-fab calibrate depth RUN`" in rest
    digest = "644ff0123456"
    old = replace(head, sensor=SensorId(camera=digest))
    with pytest.raises(InputError, match=rf"camera '\w{{12}}' here, '{digest}' in this file"):
        require_same_sensor(old, SensorModel(lens).id, str(path))


def test_old_file_matches_by_digests() -> None:
    old = SensorId("deltact", "A1", pattern="bfbaacc286e0", camera="ff7980730857")
    assert not SENSOR.differences_from(old)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("schema = 1", "schema = 99", "schema: 99, this version reads 1"),
        ('kind = "force"', 'kind = "depth"', "a calibration of depth, not of force"),
        ("gain = 1.5", "gain = nan", "model.gain: not a finite number"),
        ('serial = "A1"', "serial = 7", "sensor.serial"),
        ('serial = "A1"', 'colour = "red"', "sensor.colour: unknown key"),
        ('version = "0.1.0"', "", "made.version: missing key"),
    ],
)
def test_errors_are_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
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
