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
from doc_pages import ROOT, Block, Reader, blocks, commands, set_keys

from deltact_fab.cli.main import entry

PAGES = [*sorted((ROOT / "docs/tutorials").glob("*.md")), *sorted((ROOT / "docs/how-to").glob("*.md"))]
BY_NAME = {page.stem: page for page in PAGES}


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


def run_of(page: Path, slow: bool) -> list[Block]:
    return [b for b in blocks(page) if b.why_not is None and (slow or not b.slow)]


@pytest.mark.parametrize("name", BY_NAME)
def test_quick_blocks_work(name: str, tmp_path: Path) -> None:
    Reader(tmp_path, typed).follow(run_of(BY_NAME[name], slow=False))


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n, page in BY_NAME.items() if any(b.slow for b in blocks(page))])
def test_all_blocks_work(name: str, tmp_path: Path) -> None:
    Reader(tmp_path, typed).follow(run_of(BY_NAME[name], slow=True))
