"""`import deltact_fab as dt`: four tasks in few lines, whatever else was imported before."""

from __future__ import annotations

import json
import pkgutil
import re
import shutil
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import deltact_fab as dt

TOUR = json.loads((Path(__file__).parents[1] / "examples/tour.ipynb").read_text())
TASKS = ["".join(c["source"]) for c in TOUR["cells"] if "task" in c["metadata"].get("tags", ())]
"""Make a pattern, read a run, track a folder, force and depth in a live loop."""


@pytest.fixture
def folder(mini_run: Path, calibrations: list[Path], tmp_path: Path) -> Path:
    shutil.copytree(calibrations[0].parent, tmp_path / "files")
    for file in (tmp_path / "files").iterdir():
        file.rename(tmp_path / file.name)
    (tmp_path / "run").symlink_to(mini_run)
    return tmp_path


@pytest.fixture(autouse=True, scope="module")
def _every_subpackage() -> None:
    """An import of `deltact_fab.live` sets the attribute `live` of `deltact_fab`."""
    for module in pkgutil.iter_modules(dt.__path__):
        if not module.name.startswith("_"):
            import_module(f"deltact_fab.{module.name}")


def test_its_names_are_offered_and_no_module_takes_one() -> None:
    assert set(dt.__all__) <= set(dir(dt))
    assert not [n for n in dt.__all__ if isinstance(getattr(dt, n), ModuleType)]
    with pytest.raises(AttributeError, match="'deltact_fab' has no attribute 'trak'"):
        dt.trak  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.slow
def test_four_tasks_take_25_lines_at_most(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sum(len(task.splitlines()) for task in TASKS) <= 25
    names: dict[str, Any] = {"folder": folder}
    said = []
    for task in TASKS:
        exec(task, names)
        said.append(capsys.readouterr().out)
    assert names["sticker"].image.is_file()
    assert names["sticker"].recipe.dots is not None
    assert len(said[2].splitlines()) == len(names["frames"])
    told = re.findall(r"([\d.]+) N, ([\d.]+) mm, \d+ ms", said[3])
    normal_n, depth_mm = (max(map(float, column)) for column in zip(*told, strict=True))
    assert normal_n == pytest.approx(-names["frames"]["fz_n"].min(), abs=0.3)
    assert depth_mm == pytest.approx(1.0, abs=0.4)  # the calibration's gain is made up


@pytest.mark.slow
def test_a_source_is_measured_as_the_live_loop_measures_it(folder: Path) -> None:
    files = [folder / "force.toml", folder / "depth.toml"]
    measured = [seen.result for seen in dt.measure_source(folder / "run", files, show=["force"])]
    run = dt.load_run(folder / "run")
    with dt.Live(folder / "run", files, show=["force"]) as live:
        for file, wanted in zip(run.frames()["file"], measured, strict=True):
            live.submit(run.raw(file))
            seen = live.result(timeout_s=60)
            assert seen is not None
            assert wanted.force is not None
            assert seen.force is not None
            assert seen.force.force_n == pytest.approx(wanted.force.force_n, abs=1e-9)
        live.reset()
        live.submit(run.raw(file))
        rested = live.result(timeout_s=60)
    assert rested is not None
    assert rested.force is not None
    assert np.abs(rested.force.force_n).max() < 0.1
