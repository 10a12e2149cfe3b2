"""What tutorials and how-tos tell a reader to type works, and prints what they show."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import ROOT, Reader, blocks, chain

from deltact_fab.app.cli.main import entry

PAGES = [
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
    *sorted((ROOT / "docs/how-to").glob("*.md")),
]
BEGUN = {page for last in PAGES for page in chain(last)[:-1]}
CHAINS = {page.stem: chain(page) for page in PAGES if page not in BEGUN}
HEAVY = ("parts", "extend-an-indenter", "first-hour")
"""Whose blocks take long though they are not marked; the first hour is tests/packaging's."""
SLOW = [
    name
    for name, pages in CHAINS.items()
    if name in HEAVY[:2] or (name != "first-hour" and any(b.slow for p in pages for b in blocks(p)))
]


def typed(line: str, folder: Path) -> tuple[int, str]:
    """In this process where it is a plain `deltact-fab`, else by a shell."""
    if not line.startswith("deltact-fab ") or any(sign in line for sign in "|&;<>$*"):
        env = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
        done = subprocess.run(
            line, shell=True, cwd=folder, env=env, stdin=subprocess.DEVNULL, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=600,
        )  # fmt: skip
        return done.returncode, done.stdout
    said, status = io.StringIO(), 0
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(sys, "argv", shlex.split(line))
        try:
            entry()
        except SystemExit as done:
            status = int(done.code or 0)
    return status, said.getvalue()


def follow(pages: list[Path], folder: Path, slow: bool) -> None:
    reader = Reader(folder, typed)
    for page in pages:
        reader.follow([b for b in blocks(page) if b.why_not is None and (slow or not b.slow)])


@pytest.mark.parametrize("name", [name for name in CHAINS if name not in HEAVY])
def test_quick_blocks_work(name: str, tmp_path: Path) -> None:
    follow(CHAINS[name], tmp_path, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_all_blocks_work(name: str, tmp_path: Path) -> None:
    follow(CHAINS[name], tmp_path, slow=True)


def test_the_first_hour_leaves_nothing_out() -> None:
    assert not [b.where for b in blocks(ROOT / "docs/tutorials/first-hour.md") if b.why_not]
