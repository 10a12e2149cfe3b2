"""The store finds what was put under the same key, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from deltact_fab import cache


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "c"))
    return tmp_path / "c"


def test_round_trip_by_content_of_the_key(folder: Path) -> None:
    key = {"a": 1, "b": [1, 2]}
    assert cache.get("kind", key) is None
    assert cache.put("kind", key, {"v": 2.5})
    assert cache.get("kind", {"b": [1, 2], "a": 1}) == {"v": 2.5}
    assert cache.get("kind", {"a": 2, "b": [1, 2]}) is None
    assert cache.get("other", key) is None
    assert len(list(folder.rglob("*"))) == 2


def test_a_damaged_or_foreign_entry_counts_as_none(folder: Path) -> None:
    cache.put("kind", {"a": 1}, 5)
    (entry,) = folder.rglob("*.json")
    whole = entry.read_text()
    entry.write_text(whole[:-4])
    assert cache.get("kind", {"a": 1}) is None
    entry.write_text(whole.replace('"a": 1', '"a": 7'))
    assert cache.get("kind", {"a": 1}) is None


def test_a_folder_that_refuses_is_told_and_harmless(folder: Path) -> None:
    folder.write_text("a file in the way")
    assert cache.put("kind", {"a": 1}, 5) is False
    assert cache.get("kind", {"a": 1}) is None


def test_the_platform_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DELTACT_FAB_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.user_folder() == tmp_path / "deltact-fab"
