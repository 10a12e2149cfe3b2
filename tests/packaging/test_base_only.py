"""A plain install, without any extra: what works there, and the one line about what does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from deltact_fab.app.doctor import EXTRA_PURPOSES

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def needed(name: str, found: dict[str, metadata.Distribution]) -> None:
    """Put a package and all that it needs without an extra into `found`."""
    if name in found:
        return
    found[name] = metadata.distribution(name)
    for line in found[name].requires or []:
        wanted = Requirement(line)
        if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
            needed(wanted.name.lower(), found)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of links to the packages of the base and to nothing else that is installed here."""
    found: dict[str, metadata.Distribution] = {}
    for line in PROJECT["dependencies"]:
        needed(Requirement(line).name.lower(), found)
    assert {"numpy", "opencv-contrib-python-headless"} <= set(found)
    assert not {"cadquery", "vtk", "matplotlib", "mkl"} & set(found)
    folder = tmp_path_factory.mktemp("base")
    for distribution in found.values():
        for top in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            link = folder / top
            if not link.exists():
                link.symlink_to(Path(str(distribution.locate_file(top))))
    about = folder / f"deltact_fab-{PROJECT['version']}.dist-info" / "METADATA"
    about.parent.mkdir()
    lines = ["Metadata-Version: 2.4", "Name: deltact-fab", f"Version: {PROJECT['version']}"]
    lines += [f"Requires-Dist: {line}" for line in PROJECT["dependencies"]]
    for extra in EXTRA_PURPOSES:
        wanted = map(Requirement, PROJECT["optional-dependencies"][extra])
        lines += [f'Requires-Dist: {one.name}; extra == "{extra}"' for one in wanted]
    about.write_text("\n".join(lines))
    return folder


def python(base: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Python with the base's packages and this checkout (-S: nothing of the environment's)."""
    return subprocess.run(
        [sys.executable, "-S", *words],
        capture_output=True, text=True, cwd=folder, timeout=300, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(base), str(ROOT)])},
    )  # fmt: skip


# In one process, for each would import the same again.
ALL_OF_THEM = """
import contextlib, io, json, sys
from deltact_fab.app.cli.main import entry
for words in json.load(open(sys.argv[1])):
    sys.argv, said = ["deltact-fab", *words], io.StringIO()
    with contextlib.redirect_stderr(said):
        try:
            entry()
        except SystemExit as end:
            code = end.code
    print(json.dumps([code, said.getvalue()]))
"""
LACKS = {
    "cad check": "cad",
    "cad export sphere:10 --out parts": "cad",
    "cad guide -o guide.html": "report",
    "report RUN -o page.html": "report",
    "study run shapes": "report",
    "demo": "report",
    "record export RUN --format mcap -o run.mcap": "export",
    "record export RUN --format parquet --out run": "export",
}


@pytest.mark.slow
def test_missing_extra_is_named(base: Path, mini_run: Path, tmp_path: Path) -> None:
    commands = [words.replace("RUN", str(mini_run)).split() for words in LACKS]
    (tmp_path / "commands.json").write_text(json.dumps(commands))
    (tmp_path / "here").mkdir()
    done = python(base, tmp_path / "here", "-c", ALL_OF_THEM, str(tmp_path / "commands.json"))
    assert done.returncode == 0, done.stderr
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    for (words, extra), (code, said) in zip(LACKS.items(), answers, strict=True):
        (line,) = said.splitlines()
        assert code == 2, words
        assert line.startswith("deltact-fab: ")
        assert line.endswith(f": pip install 'deltact-fab[{extra}]'")
    assert list((tmp_path / "here").iterdir()) == []


@pytest.mark.slow
def test_base_commands_need_no_extra(base: Path, mini_run: Path, tmp_path: Path) -> None:
    def good(*words: str) -> str:
        done = python(base, tmp_path, "-m", "deltact_fab.app.cli.main", *words)
        assert done.returncode == 0, done.stderr
        return done.stdout

    good("pattern", "make", "-d", "0.3", "-r", "0.1", "--size", "6", "-o", "x.png")
    assert (tmp_path / "x.png").is_file()
    good("protocol", "check", "smoke")
    assert len(good("measure", str(mini_run), "--jsonl").splitlines()) > 5
    said = json.loads(good("doctor", "--json"))
    assert said["ok"]
    state = {f["name"]: f["state"] for f in said["findings"]}
    assert (state["numpy"], state["cadquery"], state["matplotlib"]) == ("ok", "missing", "missing")
