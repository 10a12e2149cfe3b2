"""How much there is to read, and phrases that a native reader stops at."""

from __future__ import annotations

import pytest
from doc_pages import ROOT

WORDS_CEILING = 60_000
README_LINES_CEILING = 150
PHRASES = (  # as they stand in a source, over line ends too
    "Take fused", "Take {take", "to say 'depth is zero'", "not told from", "do not tell apart",
    "is confident of {", "so or alike", "at knots of", "tolerance asks for", "yes, at the front",
    "taken for another", "not known of this one", "known from a guess alone",
    "which is called settled", "none without it", "as `GelMaterial` has them", "Nobody is there",
    "printer and laser really do", "the lens takes", "plate yields", "what it takes",
)  # fmt: skip
README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").rglob("*.md"))
SHOWN = [
    README,
    *PAGES,
    *(p for p in ROOT.glob("deltact_fab/**/*") if p.suffix in (".py", ".html")),
]
SHOWN += [p for room in ("cad", "patterns", "protocols") for p in (ROOT / room).rglob("*.toml")]


def test_docs_are_short_enough_to_be_read() -> None:
    assert len(README.read_text().splitlines()) <= README_LINES_CEILING
    read = [README, *(p for p in PAGES if p.parent.name != "reference")]
    assert sum(len(p.read_text().split()) for p in read) <= WORDS_CEILING


@pytest.mark.parametrize("phrase", PHRASES)
def test_a_phrase_that_nobody_says_is_nowhere(phrase: str) -> None:
    found = [p for p in SHOWN if phrase in " ".join(p.read_text().split())]
    assert not [str(p.relative_to(ROOT)) for p in found]
