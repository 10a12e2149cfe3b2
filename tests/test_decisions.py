"""Every decision record has its form, and the index has every record."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

RECORDS = Path(__file__).parents[1] / "docs" / "decisions"
FILES = sorted(file for file in RECORDS.glob("*.md") if file.name != "README.md")


def test_index_lists_every_record_once() -> None:
    subjects, table = (RECORDS / "README.md").read_text().split("| gone |", 1)
    held = sorted(int(number) for number in re.findall(r"\]\((\d{4})-", subjects))
    assert held == [int(file.name[:4]) for file in FILES] == sorted(set(held))
    gone = {int(n) for cell in re.findall(r"\| ([\d, ]+) \| \[", table) for n in cell.split(", ")}
    assert gone == set(range(1, max(held))) - set(held) - {58}  # 58 was never written


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_record_is_short_and_complete(file: Path) -> None:
    text = file.read_text()
    lines = text.splitlines()
    assert re.match(rf"# {int(file.name[:4])}\. \S", lines[0])
    assert len(lines) <= 60
    assert max(len(line) for line in lines if not line.startswith("|")) <= 120
    sections = dict(re.findall(r"^## (\w+)\n\n(.+?)(?=\n## |\Z)", text, re.DOTALL | re.MULTILINE))
    order = ["Status", "Context", "Decision", "Alternatives", "Consequences"]
    assert list(sections) == order[: max(4, len(sections))]
    assert re.match(r"(Proposed|Accepted|Superseded by \[)", sections["Status"])


def test_links_between_records_resolve() -> None:
    dead = [
        f"{file.name}: {target}"
        for file in [*RECORDS.glob("*.md"), *(RECORDS.parent / "evidence").glob("*.md")]
        for target in re.findall(r"\]\(([^)#:]+)\)", file.read_text())
        if not (file.parent / target).exists()
    ]
    assert not dead
