"""A lab's own folder and new files, from the first command to a report."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from deltact_fab.app import lab
from deltact_fab.app.cli.main import main
from deltact_fab.app.lab import SHIPPED_FOLDERS
from deltact_fab.bench.protocols import plan
from deltact_fab.common import catalog
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.patterns.laws import PATTERN_LAWS
from deltact_fab.fabricate.patterns.recipe import load_recipe
from deltact_fab.paths import shipped_folder

DEFAULT = re.compile(r"#([a-z0-9_]+ = .*)")


def run(*words: str) -> Result:
    done = CliRunner().invoke(main, list(words))
    assert done.exit_code == 0, (words, done.output, done.exception)
    return done


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def mine(here: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    lab.init(here / "my-lab")
    monkeypatch.chdir(here / "my-lab")
    return here / "my-lab"


def test_folder_holds_unchanged_shipped_files(mine: Path) -> None:
    for kind in SHIPPED_FOLDERS:
        shipped = {p.relative_to(shipped_folder(kind)): p
                   for p in shipped_folder(kind).rglob("*.toml")}  # fmt: skip
        own = {p.relative_to(mine / kind): p for p in (mine / kind).rglob("*.toml")}
        assert own.keys() == shipped.keys()
        for name, file in own.items():
            assert catalog.read_toml(file) == catalog.read_toml(shipped[name])
    for noun in ("protocol", "cad", "pattern"):
        run(noun, "new", "own")
    for file in mine.rglob("*.toml"):
        first = file.read_text().partition("\n")[0]
        if file.parent.name != "cameras":
            schema = json.loads((file.parent / first.removeprefix("#:schema ")).read_text())
            assert schema["type"] == "object"


@pytest.mark.parametrize("content", ["file", "folder"])
def test_what_is_there_is_never_touched(here: Path, content: str) -> None:
    if content == "file":
        (here / "my-lab").write_text("mine")
    else:
        (here / "my-lab").mkdir()
        (here / "my-lab" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="must be a new or empty folder"):
        lab.init(Path("my-lab"))
    left = here / "my-lab" / "notes.txt" if content == "folder" else here / "my-lab"
    assert left.read_text() == "mine"
    assert len(list(here.rglob("*"))) == (2 if content == "folder" else 1)


def test_empty_folder_or_repository_accepted(here: Path) -> None:
    (here / ".git").mkdir()
    lab.init(Path())
    assert (here / "README.md").is_file()


@pytest.mark.parametrize("source", catalog.catalogue_names("protocols"))
def test_new_protocol_equals_its_source(here: Path, source: str) -> None:
    lab.protocol("own", source)
    own, _ = plan.load_protocol("own", by_hand=True)
    changed = {"name": "own", "description": own.description}
    assert own == plan.load_protocol(source, by_hand=True)[0].model_copy(update=changed)


def test_commented_values_are_defaults(here: Path) -> None:
    """All defaults uncommented make the same protocol, pattern and design."""
    protocol = lab.protocol("own", "force-calibration")[0].read_text()
    without_default = "amplitude_mm|amplitude_of_depth|rate_hz|s|settle_s|serial"
    examples = rf"(?m)^#({without_default}|every|at_mm|depth_mm) = .*\n"
    full = uncommented(re.sub(examples, "", protocol))
    assert catalog.validate(plan.Protocol, tomllib.loads(full), "f") == plan.load_protocol("own")[0]
    assert full.count(" = ") > 20
    assert "promise" not in protocol

    design = uncommented(lab.design("own-design", "skin-44x40").read_text())
    Path("full.toml").write_text(design)
    assert len([line for line in design.splitlines() if not line.startswith("#") and line]) > 200
    assert load_design("full.toml") == load_design("own-design") == load_design("skin-44x40")


def uncommented(text: str) -> str:
    return "\n".join(DEFAULT.sub(r"\1", line) for line in text.splitlines())


@pytest.mark.parametrize("law", PATTERN_LAWS)
def test_new_recipe_has_law_keys(here: Path, law: str) -> None:
    text = lab.pattern("own", law).read_text()
    assert load_recipe("own").law == law
    named = {found[1] for found in re.finditer(r"(?m)^#?([a-z_]+) = ", text)}
    named |= {found[1] for found in re.finditer(r"(?m)^#?\[([a-z]+)\]", text)}
    taken = {*PATTERN_LAWS[law].needs, *PATTERN_LAWS[law].may}
    assert taken <= named
    assert not ({"patch_mm", "r", "scales_mm", "weights"} - taken) & named


def test_no_overwrite_and_no_path_names(here: Path) -> None:
    run("protocol", "new", "own", "-o", "there.toml")
    before = Path("there.toml").read_bytes()
    for words, says in (
        (["protocol", "new", "own", "-o", "there.toml"], "there.toml: already exists"),
        (["protocol", "new", "own", "-o", "no/own.toml"], "no/own.toml: no folder no"),
        (["protocol", "new", "own.toml"], "must be a name"),
        (["cad", "new", "../own"], "must be a name"),
        (["protocol", "new", "two words"], "name: "),
        (["protocol", "new", "own", "--from", "smokes"], "did you mean 'smoke'"),
        (["pattern", "new", "own", "--law", "octav"], "did you mean 'octave'"),
        (["cad", "new", "own", "--base", "delta"], "did you mean 'deltact'"),
    ):
        told = CliRunner().invoke(main, words)
        assert isinstance(told.exception, InputError), words
        assert says in str(told.exception)
    assert Path("there.toml").read_bytes() == before
    assert [p.name for p in here.iterdir()] == ["there.toml"]
