"""The files of examples/extend in a copy of the package: each is found, and does what it says.

docs/how-to/extend-*.md show the same text.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from benchmarks import extend_pages

ROOT = Path(__file__).parents[2]
EXTEND = ROOT / "examples" / "extend"
RECIPE = 'law = "stratified"\nseed = 7\npatch_mm = 0.35\n'
COMMANDS = """
import json, sys
from click.testing import CliRunner
from deltact_fab.app.cli.main import main
for line in sys.stdin:
    done = CliRunner().invoke(main, json.loads(line))
    code = getattr(done.exception, "exit_code", done.exit_code)
    print(json.dumps([code, done.stdout, str(done.exception or "")]))
"""
CALLS = {
    "pattern": ("pattern", "make", "mine.toml", "-o", "mine.png"),
    "law": ("schema", "pattern", "--json"),
    "part": ("cad", "show", "shim"),
    "rule": ("cad", "check", "--set", "shell.wall_mm=0.9"),
    "indenter": ("cad", "show", "cone:8"),
}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package as it is once the files are copied over it, and a lab's files."""
    home = tmp_path_factory.mktemp("extended")
    for name in ("deltact_fab", "cad", "patterns", "protocols"):
        shutil.copytree(ROOT / name, home / name)
    shutil.copytree(EXTEND, home, dirs_exist_ok=True)
    (home / "mine.toml").write_text(RECIPE)
    return home


@pytest.fixture(scope="module")
def answers(home: Path) -> dict[str, tuple[int, str, str]]:
    """What each command answers there, all in one process."""
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS],
        input="\n".join(map(json.dumps, CALLS.values())),
        capture_output=True, text=True, cwd=home, timeout=300, check=True,
        env={**os.environ, "PYTHONPATH": str(home)},
    )  # fmt: skip
    return dict(zip(CALLS, map(json.loads, done.stdout.splitlines()), strict=True))


def good(answer: tuple[int, str, str]) -> Any:
    code, out, err = answer
    assert code == 0, out + err
    return json.loads(out) if out.startswith("{") else out


@pytest.mark.slow
def test_law_has_contrast_everywhere(answers: Any, home: Path) -> None:
    assert "stratified" in good(answers["law"])["properties"]["law"]["enum"]
    good(answers["pattern"])
    with Image.open(home / "mine.png") as image:
        printed = np.asarray(image.convert("L"), float)
    at = ((np.arange(100) + 0.5) * len(printed) / 100).astype(int)
    blocks = printed[np.ix_(at, at)].reshape(25, 4, 25, 4).swapaxes(1, 2).reshape(625, 16)
    assert (np.sort(blocks // 16, axis=1) == np.arange(16)).all()
    assert blocks.std(axis=1).min() > 70  # of 73.9; independent patches come down to 40


@pytest.mark.slow
def test_part_inequality_is_checked(answers: Any) -> None:
    assert "shell.wall_mm" in good(answers["part"])
    code, out, err = answers["rule"]
    assert code != 0
    assert "1 <= shell.wall_mm" in out + err


@pytest.mark.slow
def test_indenter_part_of_any_size(answers: Any) -> None:
    assert "8" in good(answers["indenter"])


def test_the_pages_show_these_files() -> None:
    """Word for word, every file on some page."""
    kept = {page: page.read_text() for page in extend_pages.pages()}
    assert kept == extend_pages.pages(), "python -m benchmarks.reference writes them anew"
    assert extend_pages.shown() == {p.relative_to(EXTEND).as_posix() for p in EXTEND.rglob("*.py")}
