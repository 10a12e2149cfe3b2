"""The code blocks of a page of the documentation, and a reader who follows them.

A ```console block holds commands as they are typed, one a line, all of a page in one empty folder.
A ```text block straight after it is what they print: each of its lines is found in the output, in
this order; … stands for anything. A comment on the line before a block says what else is meant:

    <!-- file: NAME -->       a ```toml, ```csv or ```python block is that file; of a TOML that is
                              there already, these keys are changed, each on its own line
    <!-- exit 1 -->           how the last command ends, where it is not 0
    <!-- slow -->             left out of the fast tests
    <!-- not run: REASON -->  left out of all tests, as it takes hardware or too long

A ```python block without a file is executed, all of a page in one namespace. A page that says
<!-- continues: PAGE --> goes on in the folder of another one.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>[\w+-]*)[^\n]*\n(?P<text>.*?)^ *```$", re.M | re.S
)
_COMMENTS = re.compile(r"(?:^ *<!-- [^\n]* -->\n)+\Z", re.M)
_TABLE = re.compile(r"^#?\[([\w.-]+)\]\s*(?:#.*)?$")
_KEY = re.compile(r"^#?([\w-]+) = ")
_CONTINUES = re.compile(r"^<!-- continues: (\S+) -->$", re.M)
_DIRECTIVES = re.compile(r"^(file: \S+|exit \d+|slow|not run: \S.*)$")


@dataclass
class Block:
    """One block of code. where: page and line. printed: what it is said to print."""

    where: str
    language: str
    text: str
    file: str | None = None
    status: int = 0
    slow: bool = False
    why_not: str | None = None
    printed: list[str] = field(default_factory=list)


def blocks(page: Path) -> list[Block]:
    """The blocks of a page. Raises ValueError for a comment before one that says nothing known."""
    text, found = page.read_text(), list[Block]()
    end, before = -1, None
    for match in _FENCE.finditer(text):
        where = f"{page.name}:{text.count(chr(10), 0, match.start()) + 1}"
        cut = len(match["indent"])
        block = Block(where, match["language"], "".join(
            line[cut:] for line in match["text"].splitlines(keepends=True)
        ))  # fmt: skip
        comments = _COMMENTS.search(text[: match.start()])
        for line in comments[0].splitlines() if comments else ():
            _direct(block, line.strip()[4:-3].strip())
        if (
            block.language == "text"
            and before is not None
            and not text[end : match.start()].strip()
        ):
            before.printed = [line.strip() for line in block.text.splitlines() if line.strip()]
        else:
            found.append(block)
        end, before = match.end(), block if block.language == "console" else None
    return found


def chain(page: Path) -> list[Path]:
    """The pages to be followed in one folder, this one last."""
    found = _CONTINUES.search(page.read_text())
    return [*(chain(page.parent / found[1]) if found else ()), page]


def _direct(block: Block, comment: str) -> None:
    if not _DIRECTIVES.match(comment):
        raise ValueError(f"{block.where}: <!-- {comment} -->: no such comment, see doc_pages.py")
    word, _, rest = comment.partition(" ")
    match word:
        case "file:":
            block.file = rest
        case "exit":
            block.status = int(rest)
        case "slow":
            block.slow = True
        case _:
            block.why_not = rest.partition(" ")[2]


def commands(block: Block) -> Iterator[str]:
    """The lines of a console block, without their comments."""
    for line in block.text.replace("\\\n", " ").splitlines():
        words = re.split(r"(?:^|\s{2,}| )# ", line)[0].strip()
        if words:
            yield words


def set_keys(text: str, changes: str) -> str:
    """A TOML text with the keys of `changes` set on their own lines, as a reader does it by hand.

    A key that stands there in a comment loses its #. Raises ValueError for one that stands nowhere.
    """
    lines, table = text.splitlines(), ""
    for change in changes.splitlines():
        if head := _TABLE.match(change):
            table = head[1]
        elif key := _KEY.match(change):
            _set(lines, table, key[1], change)
    made = "\n".join(lines) + "\n"
    _holds(tomllib.loads(made), tomllib.loads(changes), changes)
    return made


def _set(lines: list[str], table: str, key: str, change: str) -> None:
    now = ""
    for k, line in enumerate(lines):
        if head := _TABLE.match(line):
            now = head[1]
            if now == table:
                lines[k] = line.removeprefix("#")
        elif now == table and (there := _KEY.match(line)) and there[1] == key:
            lines[k] = change
            return
    raise ValueError(f"no line to change for {key} in [{table}]")


def _holds(made: dict[str, Any], wanted: dict[str, Any], changes: str) -> None:
    for key, value in wanted.items():
        if isinstance(value, dict):
            _holds(made[key], value, changes)
        elif made[key] != value:
            raise ValueError(f"{key} is {made[key]} and not {value} after {changes}")


@dataclass
class Reader:
    """Follows pages in a folder. run: a command and its folder -> exit code, what it printed."""

    folder: Path
    run: Callable[[str, Path], tuple[int, str]]
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})

    def follow(self, found: list[Block]) -> None:
        """Do what the blocks say. Raises AssertionError where a page promises something else."""
        for block in found:
            if block.language == "console":
                self._console(block)
            elif block.file is not None:
                self._write(block)
            elif block.language == "python":
                self.python(block)
            elif block.language == "toml":
                tomllib.loads(block.text)

    def python(self, block: Block) -> None:
        """Execute a block, in this process and in the reader's folder."""
        with contextlib.chdir(self.folder):
            exec(compile(block.text, block.where, "exec"), self.names)

    def _console(self, block: Block) -> None:
        said, lines = "", list(commands(block))
        for k, line in enumerate(lines):
            if line.startswith("cd "):
                self.folder = (self.folder / shlex.split(line)[1]).resolve(strict=True)
                continue
            status, output = self.run(line, self.folder)
            wanted = block.status if k + 1 == len(lines) else 0
            assert status == wanted, f"{block.where}: {line}: exit {status}, not {wanted}: {output}"
            said += output
        _found(block, said)

    def _write(self, block: Block) -> None:
        file = self.folder / str(block.file)
        file.parent.mkdir(parents=True, exist_ok=True)
        there = file.read_text() if block.language == "toml" and file.exists() else None
        file.write_text(block.text if there is None else set_keys(there, block.text))


def _found(block: Block, said: str) -> None:
    rest = [" ".join(line.split()) for line in said.splitlines()]
    for line in block.printed:
        pattern = re.compile(".*".join(re.escape(" ".join(p.split())) for p in line.split("…")))
        if line.strip("… "):
            at = next((k for k, told in enumerate(rest) if pattern.search(told)), None)
            assert at is not None, f"{block.where}: {line!r} is not printed, but\n{said}"
            rest = rest[at + 1 :]
