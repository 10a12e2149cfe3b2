"""How much there is to read, and phrases that a native reader stops at."""

from __future__ import annotations

from pathlib import Path

import pytest
from doc_pages import ROOT

WORDS_CEILING = 60_000
README_LINES_CEILING = 150
PHRASES = (
    "Take fused", "Take {take", "to say 'depth is zero'", "not told from", "do not tell apart",
    "is confident of {", "so or alike", "at knots of", "tolerance asks for", "yes, at the front",
    "taken for another", "not known of this one", "known from a guess alone",
    "which is called settled", "none without it", "as `GelMaterial` has them", "Nobody is there",
    "printer and laser really do", "the lens takes", "plate yields", "what it takes",
)  # fmt: skip
"""As they stand in a source, over line ends too."""
SHOWN = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "deltact_fab").rglob("*.py")),
    *sorted((ROOT / "deltact_fab").rglob("*.html")),
    *(page for room in ("cad", "patterns", "protocols") for page in (ROOT / room).rglob("*.toml")),
]


def words(page: Path) -> int:
    return len(page.read_text().split())


def test_docs_are_short_enough_to_be_read() -> None:
    readme = ROOT / "README.md"
    assert len(readme.read_text().splitlines()) <= README_LINES_CEILING
    pages = [p for p in (ROOT / "docs").rglob("*.md") if p.parent != ROOT / "docs" / "reference"]
    assert len(pages) > 50
    assert sum(map(words, [readme, *pages])) <= WORDS_CEILING


@pytest.mark.parametrize("phrase", PHRASES)
def test_a_phrase_that_nobody_says_is_nowhere(phrase: str) -> None:
    assert not [
        str(p.relative_to(ROOT)) for p in SHOWN if phrase in " ".join(p.read_text().split())
    ]
