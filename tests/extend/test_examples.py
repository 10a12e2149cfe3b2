"""Each script of examples/ gives the figure that makes it worth reading."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(p.stem for p in FOLDER.glob("*.py"))


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(str(FOLDER))
    yield
    for name in SCRIPTS:
        sys.modules.pop(name, None)


def load(name: str) -> ModuleType:
    return importlib.import_module(name)


@pytest.mark.slow
def test_part_has_calculated_volume(tmp_path: Path) -> None:
    solid_mm3, formula_mm3 = load("build_a_part").main(tmp_path / "out")
    assert solid_mm3 == pytest.approx(formula_mm3, rel=1e-6)
    assert 0.9 < solid_mm3 / (36 * 34 * 14) < 1  # the box, less a step and round corners
    assert {p.suffix for p in (tmp_path / "out").rglob("*")} >= {".step", ".stl"}


@pytest.mark.slow
def test_larger_patches_reach_the_camera() -> None:
    kept = load("pattern_quality").main()
    assert kept == pytest.approx({0.075: 0.15, 0.15: 0.39, 0.3: 0.59}, abs=0.02)


@pytest.mark.slow
def test_run_agrees_with_hertz(tmp_path: Path) -> None:
    """A layer is stiffer than a half-space, the more so the wider the contact."""
    found = load("run_a_protocol").main(tmp_path / "out")
    stiffer = {depth: measured_n / hertz_n for depth, (measured_n, hertz_n) in found.items()}
    assert stiffer == pytest.approx({0.3: 1.13, 0.6: 1.17}, abs=0.02)


@pytest.mark.slow
def test_tracking_error_is_small(mini_run: Path) -> None:
    """Off the dots against truth worse than at them: dots are features, and flatter."""
    errors = load("measure_a_run").main(mini_run)
    at_dots_mm, off_dots_mm = errors["mean_at_dots_mm"].mean(), errors["mean_off_dots_mm"].mean()
    assert at_dots_mm == pytest.approx(0.004, abs=0.002)
    assert off_dots_mm == pytest.approx(0.016, abs=0.004)


def test_force_grows_slightly_beyond_hertz(mini_run: Path) -> None:
    exponent, at_1_mm_n = load("force_law").main(mini_run)
    assert exponent == pytest.approx(1.57, abs=0.03)
    assert at_1_mm_n == pytest.approx(2.70, rel=0.03)


@pytest.mark.slow
def test_half_thickness_is_stiffer() -> None:
    rows = {row.thickness_mm: row for row in load("sweep_a_design").main()}
    forces = [row.normal_n for row in rows.values()]
    assert forces == sorted(forces, reverse=True)
    assert rows[8.0].normal_n / rows[16.0].normal_n == pytest.approx(1.2, abs=0.1)
    assert not rows[12.0].refused
    assert "skin-frame" in rows[10.0].refused


@pytest.mark.slow
def test_the_tour_runs_in_a_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cell, by a kernel of its own."""
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("PYTHONPATH", str(FOLDER.parent))
    notebook = nbformat.read(FOLDER / "tour.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    said = "".join(o.get("text", "") for c in notebook.cells for o in c.get("outputs", []))
    told = re.search(r"measured ([\d.]+) N, predicted ([\d.]+) N", said)
    assert told is not None
    assert float(told[1]) == pytest.approx(float(told[2]), rel=0.05)
    live = re.findall(r"([\d.]+) N, ([\d.]+) mm, \d+ ms", said)
    normal_n, depth_mm = (max(map(float, column)) for column in zip(*live, strict=True))
    assert normal_n == pytest.approx(float(told[1]), abs=0.3)
    # The highest of all images: 0.56 mm for the press itself, 0.79 where the shear goes outwards.
    assert depth_mm == pytest.approx(0.6, abs=0.25)
