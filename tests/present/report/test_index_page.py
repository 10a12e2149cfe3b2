"""The index finds runs and studies below a folder, and says which are not in order."""

from __future__ import annotations

import html
import json
import re
import shutil
import time
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import pytest
from click.testing import CliRunner
from made_up_study import study

from deltact_fab.app.cli.main import main
from deltact_fab.common.errors import InputError
from deltact_fab.present.report import index_page, study_page
from deltact_fab.present.report.index_page import Entry, list_entries

OLD_RUN = Path(__file__).parents[2] / "data" / "run-format-5"


@pytest.fixture(scope="module")
def all_sorts(mini_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs and studies, whole, unfinished and damaged."""
    top = tmp_path_factory.mktemp("results")
    made = replace(study(), figures=())
    study_page.write_study_page(made, top / "studies" / "a study #1")
    study_page.write_study_page(replace(made, missing=("one", "two")), top / "half")
    study_page.write_study_page(made, top / "no-page")
    (top / "no-page" / "report.html").unlink()
    for name, module in (
        ("fresh", "studies.study.registry"),
        ("stale", "studies.study.registry"),
        ("gone", "no"),
    ):
        study_page.write_study_page(replace(made, module="studies.study.registry"), top / name)
        path = top / name / "result.json"
        kept = json.loads(path.read_text()) | {"module": module}
        path.write_text(json.dumps(kept | ({"code": "0" * 64} if name == "stale" else {})))
    (top / "cut").mkdir()
    (top / "cut" / "result.json").write_text('{"format": "delt')
    shutil.copytree(mini_run, top / "runs" / "mini")
    shutil.copytree(mini_run, top / "stopped")
    (top / "stopped" / "summary.json").unlink()
    shutil.copytree(OLD_RUN, top / "old")
    (top / "old" / "summary.json").write_text("{}")
    shutil.copytree(OLD_RUN, top / "hurt")
    (top / "hurt" / "journal.sqlite").write_bytes(b"not a database at all" * 100)
    (top / "odd").mkdir()
    (top / "odd" / "run.json").write_text("[]")
    (top / "odd" / "pattern.json").write_text("{}")
    (top / ".hidden").mkdir()
    (top / ".hidden" / "run.json").write_text("{}")
    return top


@pytest.fixture(scope="module")
def found(all_sorts: Path) -> dict[str, Entry]:
    return {entry.name: entry for entry in list_entries(all_sorts, all_sorts)}


def test_only_runs_and_studies_have_rows(found: dict[str, Entry]) -> None:
    assert set(found) == {
        "studies/a study #1", "half", "no-page", "fresh", "stale", "gone", "cut", "runs/mini",
        "stopped", "old", "hurt", "odd",
    }  # fmt: skip


def test_study_row_has_verdict_date_link(found: dict[str, Entry]) -> None:
    entry = found["studies/a study #1"]
    assert entry.kind == "study made-up"
    assert entry.line == "The better one is half as far off."
    assert entry.date[:10] in {
        time.strftime("%Y-%m-%d", time.gmtime(time.time() - s)) for s in (0, 600)
    }
    assert entry.link == "studies/a%20study%20%231/report.html"
    assert entry.simulated
    assert entry.trouble == ""


@pytest.mark.parametrize(
    ("name", "trouble", "line"),
    [
        ("half", "2 jobs missing:", "The better one"),
        ("no-page", "page missing:", "The better one"),
        ("fresh", "", "The better one"),
        ("stale", "made by other code:", "The better one"),
        ("gone", "made by other code:", "The better one"),
        ("cut", "damaged:", "not valid JSON"),
        ("stopped", "unfinished:", "frames in"),
        ("hurt", "damaged:", "journal"),
        ("odd", "damaged:", "an object is needed"),
    ],
)
def test_problems_are_named_in_the_row(
    found: dict[str, Entry], all_sorts: Path, name: str, trouble: str, line: str
) -> None:
    assert found[name].trouble == trouble
    assert line in found[name].line
    assert str(all_sorts) not in found[name].line


def test_analysed_run_shows_its_verdict(mini_run: Path, tmp_path: Path) -> None:
    shutil.copytree(mini_run, tmp_path / "run")
    (tmp_path / "run" / "analysis").mkdir(exist_ok=True)
    path = tmp_path / "run" / "analysis" / "tracking.json"
    path.write_text('{"verdict": {"line": "Use dis-fast."}}')
    (tmp_path / "run" / "report.html").write_text("")
    (entry,) = list_entries(tmp_path, tmp_path)
    assert (entry.line, entry.trouble, entry.link) == ("Use dis-fast.", "", "run/report.html")
    path.write_text('{"verdict"')
    assert list_entries(tmp_path, tmp_path)[0].trouble == "damaged:"


def test_command_writes_page_with_valid_links(all_sorts: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "index.html"
    out.parent.mkdir()
    done = CliRunner().invoke(
        main, ["report", str(all_sorts), "-o", str(out)], catch_exceptions=False
    )
    assert (done.exit_code, done.output) == (0, f"written: {out}\n")
    page = out.read_text()
    links = [html.unescape(link) for link in re.findall(r'<a href="([^"]+)"', page)]
    assert len(links) == 12
    assert all((out.parent / unquote(link)).exists() for link in links)
    assert "8 of 12 are unfinished, outdated, damaged or with warnings" in page
    assert page.count('<tr class="bad">') == 8
    assert "<script" not in page


def test_no_folder_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        index_page.write_index(tmp_path / "nothing", tmp_path / "index.html")
    assert list(tmp_path.iterdir()) == []
