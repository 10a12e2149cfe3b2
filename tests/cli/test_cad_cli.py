"""`deltact-fab cad` where it writes: what is in the way is said before the work, in one line."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner, Result

from deltact_fab import cache
from deltact_fab.cad.check.row import Row
from deltact_fab.cad.design import load_indenters
from deltact_fab.cli import output
from deltact_fab.cli.cad import cad
from deltact_fab.errors import InputError, RunFailed


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / ".store"))


def ask(*words: str) -> Result:
    return CliRunner().invoke(cad, words)


def done(*words: str) -> Result:
    result = ask(*words)
    assert result.exit_code == 0, result.output + repr(result.exception)
    return result


def refused(*words: str) -> str:
    result = ask(*words)
    assert isinstance(result.exception, InputError), result.output + repr(result.exception)
    return str(result.exception)


def test_the_bill_is_a_table_or_json_by_its_name() -> None:
    done("bom", "-o", "b.csv")
    assert len(list(csv.DictReader(Path("b.csv").read_text().splitlines()))) > 10
    done("bom", "-o", "b.json")
    assert len(json.loads(Path("b.json").read_text())) > 10


def test_a_check_that_fails_fits_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        Row(f"check {i} of words", "housing, plate", "3.25 mm " * 9, "4 mm " * 9, passed=i % 2 == 0)
        for i in range(40)
    ]
    monkeypatch.setattr("deltact_fab.cad.check.run", lambda *_, **__: rows)
    terminal = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr(output, "sys", SimpleNamespace(stdout=terminal, stderr=sys.stderr))
    monkeypatch.setenv("COLUMNS", "100")
    told = ask("check")
    assert isinstance(told.exception, RunFailed)
    assert str(told.exception) == "deltact: 20 of 40 checks failed"
    assert "failed: check 3 of words (housing, plate)" in told.output.splitlines()
    assert max(map(len, told.output.splitlines())) <= 100


@pytest.mark.slow
def test_the_program_ends_with_2_and_the_kernel_is_not_loaded() -> None:
    code = """
import sys
from deltact_fab.cli.main import entry
try:
    entry()
finally:
    print([m for m in ("cadquery", "OCP", "jinja2") if m in sys.modules])
"""
    ended = subprocess.run(
        [sys.executable, "-c", code, "cad", "guide", "-o", "."],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 2
    assert ended.stderr == "deltact-fab: .: is a folder; expected the name of a file\n"
    # The guide's own module loads its templates; the parts are another matter.
    assert "cadquery" not in ended.stdout
    assert "OCP" not in ended.stdout


def test_an_export_over_another_leaves_nothing_of_it() -> None:
    done("export", "acrylic", "cover", "--format", "dxf,step", "--out", "two")
    thick = ("--set", "optics.acrylic_mm=3", "--out", "two")
    done("export", "acrylic", "--format", "dxf", *thick)
    assert {p.name for p in Path("two").iterdir()} == {"acrylic.dxf", "manifest.json"}
    Path("two/acrylic.svg").mkdir()
    line = refused("export", "acrylic", "--format", "step,svg", *thick)
    assert line == "two/acrylic.svg: a folder; move it away, or export into another folder"
    assert {p.name for p in Path("two").iterdir()} == {
        "acrylic.dxf", "acrylic.svg", "manifest.json"
    }  # fmt: skip


def _plate(value: str) -> None:
    Path("cad").mkdir(exist_ok=True)
    Path("cad/indenters.toml").write_text(
        f'[body]\nplate_mm = {value}\n\n[[indenter]]\nname = "sphere:10"\n'
    )


@pytest.mark.parametrize("value", ["1e9", "50.1", "0.99", "0", "-4", "nan", "inf"])
def test_a_plate_outside_its_limits_is_refused(value: str) -> None:
    _plate(value)
    line = refused("export", "indenters", "--out", "o")
    assert "cad/indenters.toml: body.plate_mm: Input should be " in line
    assert re.search(r"equal to (1|50) \(got ", line)
    assert not Path("o").exists()


@pytest.mark.slow
@pytest.mark.parametrize("value", ["1", "50.0"])
def test_a_plate_at_its_limits_is_made(value: str) -> None:
    _plate(value)
    assert load_indenters().body.plate_mm == float(value)
    done("export", "indenters", "star", "ring", "--format", "step,svg", "--out", "o")
    entries = json.loads(Path("o/manifest.json").read_text())["files"]
    heights_mm = {
        e["part"]: e["bounding_box_mm"][1][2] - e["bounding_box_mm"][0][2] for e in entries
    }
    # 12 mm of tip, the plate, 20 mm of stem.
    assert heights_mm["indenter-star"] == pytest.approx(32 + float(value))
