"""`make docs`: every page is in it, links lead somewhere, and nothing is fetched."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from doc_pages import ROOT

pytestmark = pytest.mark.slow
pytest.importorskip("furo", reason="no furo here: pip install 'deltact-fab[docs]'")
FETCHED = re.compile(
    r"""(?:<(?:script|img|link|iframe)\b[^>]*?(?:src|href)=|url\(|@import )["']?(?:https?:)?//"""
)


def build(source: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """As the Makefile does it."""
    flags = re.search(r"-m sphinx (.*) docs site", (ROOT / "Makefile").read_text())
    assert flags is not None
    words = [word for word in flags[1].split() if not word.startswith(("-d", ".doctrees"))]
    return subprocess.run(
        [sys.executable, "-m", "sphinx", *words, str(source), str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    done = build(ROOT / "docs", out)
    assert done.returncode == 0, done.stderr
    return out


def test_site_is_complete_and_offline(site: Path) -> None:
    pages = [page.relative_to(ROOT / "docs") for page in (ROOT / "docs").rglob("*.md")]
    assert not [page for page in pages if not (site / page.with_suffix(".html")).is_file()]
    texts = [f for f in site.rglob("*") if f.suffix in (".html", ".css", ".js")]
    assert not [f.name for f in texts if FETCHED.search(f.read_text())]
    assert len(texts) > len(pages)


def test_dead_link_fails(tmp_path: Path) -> None:
    shutil.copy(ROOT / "docs/conf.py", tmp_path)
    index = tmp_path / "index.md"
    index.write_text("# Home\n\nSee [there](other.md).\n")
    assert "other.md" in (done := build(tmp_path, tmp_path / "out")).stderr
    assert done.returncode != 0
    (tmp_path / "other.md").write_text("# Other\n\nBack [home](index.md#nowhere).\n")
    done = build(tmp_path, tmp_path / "out")
    assert done.returncode != 0
    assert "nowhere" in done.stderr
    assert "other.md: WARNING: document isn't included in any toctree" in done.stderr
