"""No file of the package needs, by whatever way round, a file that needs it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from deltact_fab import digest


def circle(needs: Mapping[Path, Iterable[Path]]) -> list[Path]:
    """Files in a circle, each needed by the next, the first again at the end; [] without one."""
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as why:
        found: list[Path] = why.args[1]
        return found
    return []


def graph(package: Path) -> dict[Path, tuple[Path, ...]]:
    return {path: digest.imported(path, package) for path in sorted(package.rglob("*.py"))}


def test_no_circle_among_files() -> None:
    """Imports in functions count, those for type checking alone do not."""
    needs = graph(digest.PACKAGE)
    assert len(needs) > 200
    assert any(needs.values())
    assert [path.relative_to(digest.PACKAGE).as_posix() for path in circle(needs)] == []


@pytest.mark.parametrize(
    ("late", "names"),
    [
        ("def f():\n    from .room import g\n", ["a.py", "room/b.py", "a.py"]),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .room import g\n", []),
    ],
)
def test_a_circle_is_found(tmp_path: Path, late: str, names: list[str]) -> None:
    (tmp_path / "room").mkdir()
    (tmp_path / "room/__init__.py").write_text("from .b import g\n")
    (tmp_path / "room/b.py").write_text("from ..a import f\n")
    (tmp_path / "a.py").write_text(late)
    found = [path.relative_to(tmp_path).as_posix() for path in circle(graph(tmp_path))]
    assert sorted(set(found)) == sorted(set(names))
