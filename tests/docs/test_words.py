"""How much there is to read."""

from __future__ import annotations

from doc_pages import ROOT

WORDS_CEILING = 60_000
README_LINES_CEILING = 150
README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").rglob("*.md"))


def test_docs_are_short() -> None:
    assert len(README.read_text().splitlines()) <= README_LINES_CEILING
    read = [README, *(p for p in PAGES if p.parent.name != "reference")]
    assert sum(len(p.read_text().split()) for p in read) <= WORDS_CEILING
