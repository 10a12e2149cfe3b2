"""A force calibration's file: what was written is read, and a damaged one is refused in a line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deltact_fab.bench.record.images import encode_png
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.measure.force import load_features, make_features
from deltact_fab.estimate.measure.force.calibration import ForceCalibration, load_force
from deltact_fab.estimate.measure.force.model import WRENCH_AXES, ForceModel
from deltact_fab.estimate.measure.sensor_id import CalibrationHead, CalibrationSource, SensorModel
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions

CAMERA = Pinhole(0.0378, 798, 586, 12.85)


@pytest.fixture
def written(tmp_path: Path) -> tuple[ForceCalibration, Path]:
    rng = np.random.default_rng(0)
    head = CalibrationHead(
        "force", SensorModel(CAMERA, serial="A1").id, CalibrationSource(("run",), True, "0.1.0", 3)
    )
    blank = ForceCalibration(
        head, ForceModel("sums", (), np.zeros((6, 0)), np.zeros((6, 0, 0))), SkinDimensions(), 0.49
    )
    features = make_features("sums", blank.view(SensorModel(CAMERA)))
    X = rng.uniform(0.5, 1.5, (40, len(features.names)))
    model, _ = ForceModel.fit(features, X, rng.normal(size=(40, len(WRENCH_AXES))))
    image = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    made = ForceCalibration(
        head, model, SkinDimensions(), 0.49, {"normal": {"rmse_n": 0.2}}, rest=encode_png(image)
    )
    (tmp_path / "c.rest.png").write_bytes(made.rest or b"")
    (tmp_path / "c.toml").write_text(made.toml("c.rest.png"))
    return made, tmp_path / "c.toml"


def test_old_feature_names_are_mapped(written: tuple[ForceCalibration, Path]) -> None:
    _, path = written
    path.write_text(path.read_text().replace('"sums"', '"inverse"'))
    assert load_force(path).model.features == "inverse-placed"


def test_what_was_written_is_read(written: tuple[ForceCalibration, Path]) -> None:
    made, path = written
    read = load_force(path)
    assert read.head == made.head
    assert read.error == made.error
    assert read.view(SensorModel(CAMERA)) == made.view(SensorModel(CAMERA))
    assert (read.model.coefficients == made.model.coefficients).all()
    assert (read.model.reach == made.model.reach).all()
    image = read.view(SensorModel()).rest
    assert image is not None
    assert image.shape == (6, 8, 3)
    view = read.view(SensorModel(CAMERA))
    assert load_features(read.model, view, str(path)).names == made.model.names
    with pytest.raises(InputError, match=r"^c.toml: features .* have changed; calibrate again"):
        load_features(replace(made.model, features="paper"), view, "c.toml")
    with pytest.raises(InputError, match=r"^c.toml: .*'summs': unknown; did you mean 'sums'"):
        load_features(replace(made.model, features="summs"), view, "c.toml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("poisson = 0.49", "poisson = 0.7", "view.poisson must be between 0 and 0.5"),
        ("thickness_mm = 12.0", "thickness_mm = -1.0", "view.skin"),
        ("fz = [", "fy2 = [", "fz: missing"),
        ("fz = [", "fz = [nan, ", "model.coefficients.fz.0: not a finite number"),
        ("fz = [", "fz = [1.0, ", "too few or many"),
        ('file = "c.rest.png"', 'file = "../c.rest.png"', "rest.file"),
        ('file = "c.rest.png"', 'file = "gone.png"', "gone.png: cannot be read"),
        ('sha256 = "', 'sha256 = "0', "differs from the hash"),
        ("[error.normal]", "[more.normal]", "more: unknown key"),
    ],
)
def test_damaged_file_is_refused(
    written: tuple[ForceCalibration, Path], old: str, new: str, said: str
) -> None:
    _, path = written
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as why:
        load_force(path)
    assert said in str(why.value)
    assert "\n" not in str(why.value)
