"""`deltact-fab cad` where it writes: what is in the way is said before the work, in one line."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from deltact_fab.app.cli.cad import cad
from deltact_fab.common import cache
from deltact_fab.common.errors import InputError, RunFailed


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


def refused(*words: str, kind: type[Exception] = InputError) -> str:
    result = ask(*words)
    assert isinstance(result.exception, kind), result.output + repr(result.exception)
    return str(result.exception)


@pytest.mark.slow
def test_bom_begins_with_the_verdict() -> None:
    done("bom", "-o", "b.csv")
    head, *rows = csv.DictReader(Path("b.csv").read_text().splitlines())
    assert (head["item"], head["group"]) == ("0", "verdict")
    assert "checks passed" in head["note"]
    assert len(rows) > 10
    tight = ("bom", "--set", "plate.fit_mm=0.02")
    assert "checks failed; --force" in refused(*tight, kind=RunFailed)
    assert "NOT TO BE BUILT: deltact: 4/" in done(*tight, "--force").output.splitlines()[1]
    done("bom", "-o", "b.json")
    assert len(json.loads(Path("b.json").read_text())) > 10


def files() -> set[str]:
    return {p.relative_to("two").as_posix() for p in Path("two").rglob("*") if p.is_file()}


@pytest.mark.slow
def test_export_replaces_earlier_export() -> None:
    done("export", "acrylic", "cover", "--format", "dxf,step", "--out", "two")
    thick = ("--set", "optics.acrylic_mm=3", "--out", "two", "--force")
    done("export", "acrylic", "--format", "dxf", *thick)
    pages = {"manifest.json", "index.html", "NOT-TO-BE-BUILT.txt"}
    assert files() == {"laser/acrylic.dxf", *pages}
    Path("two/laser/acrylic.svg").mkdir()
    line = refused("export", "acrylic", "--format", "step,svg", *thick, kind=RunFailed)
    assert line == "two/laser/acrylic.svg: cannot be written: Is a directory"
    assert files() == {"laser/acrylic.dxf", *pages}
