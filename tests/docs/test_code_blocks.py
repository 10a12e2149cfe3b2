"""What tutorials and how-tos tell a reader to type works, and prints what they show."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import ROOT, Reader, blocks, chain, commands, set_keys

from deltact_fab.cli.main import entry

PAGES = [
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
    *sorted((ROOT / "docs/how-to").glob("*.md")),
]
BEGUN = {page for last in PAGES for page in chain(last)[:-1]}
CHAINS = {page.stem: chain(page) for page in PAGES if page not in BEGUN}
# The first hour is followed whole by tests/packaging, with the wheel.
SLOW = [
    name
    for name, pages in CHAINS.items()
    if name != "first-hour" and any(b.slow for page in pages for b in blocks(page))
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


@pytest.mark.parametrize("name", CHAINS)
def test_quick_blocks_work(name: str, tmp_path: Path) -> None:
    follow(CHAINS[name], tmp_path, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_all_blocks_work(name: str, tmp_path: Path) -> None:
    follow(CHAINS[name], tmp_path, slow=True)


def test_the_first_hour_leaves_nothing_out() -> None:
    assert not [b.where for b in blocks(ROOT / "docs/tutorials/first-hour.md") if b.why_not]


PAGE = """
# A page

<!-- file: own.toml -->
```toml
depth_mm = 1.0
```

<!-- exit 1 -->
```console
cat own.toml && exit 1  # a shell's
```

```text
depth_mm = …
```

<!-- not run: hardware -->
```console
deltact-fab rig home bench.toml
```
"""


def test_a_page_is_read_as_it_is_meant(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    own, shown, bench = blocks(page)
    assert (own.file, shown.status, shown.printed) == ("own.toml", 1, ["depth_mm = …"])
    assert (shown.where, bench.why_not) == ("page.md:10", "hardware")
    assert list(commands(shown)) == ["cat own.toml && exit 1"]
    follow([page], tmp_path, slow=False)


@pytest.mark.parametrize(
    ("right", "wrong", "why"),
    [
        ("depth_mm = …", "width_mm = …", "page.md:10: 'width_mm = …' is not printed"),
        ("<!-- exit 1 -->", "<!-- exit 0 -->", "exit 1, not 0"),
        ("<!-- not run: hardware -->", "<!-- not run: -->", "no such comment"),
        ("own.toml && exit 1", "no-such-file", "no-such-file"),
        ("cat own.toml && exit 1", "deltact-fab no-such-command", "exit 2, not 1"),
    ],
)
def test_a_page_that_promises_something_else_fails(
    right: str, wrong: str, why: str, tmp_path: Path
) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE.replace(right, wrong))
    with pytest.raises((AssertionError, ValueError), match=re.escape(why)):
        follow([page], tmp_path, slow=False)


COMMENTED = """base = "deltact"

## The skin.
[skin]

# Side along x. [mm; 5 to 200]
#width_mm = 36.0

#[dots]
#columns = 13
"""


def test_a_key_is_set_on_its_own_line_and_in_its_own_table() -> None:
    made = set_keys(COMMENTED, "[skin]\nwidth_mm = 30.0\n[dots]\ncolumns = 11\n")
    assert made == COMMENTED.replace("#width_mm = 36.0", "width_mm = 30.0").replace(
        "#[dots]\n#columns = 13", "[dots]\ncolumns = 11"
    )
    for absent in ("width_mm = 30.0\n", "[dots]\nwidth_mm = 30.0\n"):
        with pytest.raises(ValueError, match="no line to change for width_mm"):
            set_keys(COMMENTED, absent)
