"""No file of the package names, by whatever way round, a file that names it."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from deltact_fab.common import digest
from deltact_fab.door import door_imports


def circle(needs: Mapping[Path, Iterable[Path]]) -> list[Path]:
    """Files in a circle, each needed by the next, the first again at the end; [] without one."""
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as why:
        found: list[Path] = why.args[1]
        return found
    return []


def graph(package: Path) -> dict[Path, set[Path]]:
    """Each file with those it names: what it runs, what it names for types, and the faces."""
    return {
        path: {*digest.imported_files(path, package), *named(path, package)} - {path}
        for path in sorted(package.rglob("*.py"))
    }


def named(path: Path, package: Path) -> Iterator[Path]:
    """Every file that an import statement names, and the one that a face hands on from."""
    here = (package.name, *path.relative_to(package).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        module = tuple(node.module.split(".")) if node.module else ()
        if node.level:
            module = here[: len(here) - node.level + 1] + module
        if module[0] != package.name:
            continue
        for alias in node.names:
            yield from behind(package.joinpath(*module[1:]), alias.name, package)


def behind(module: Path, name: str, package: Path) -> Iterator[Path]:
    """The file of one imported name: a module, or a package's face and what it takes it from."""
    for file in (module / name / "__init__.py", module / f"{name}.py", module.with_suffix(".py")):
        if file.is_file():
            yield file
            return
    face = module / "__init__.py"
    if face.is_file():
        # Beside nothing but names a package's docstring is no face.
        package_name = ".".join((package.name, *module.relative_to(package).parts))
        tree = ast.parse(face.read_text(encoding="utf-8"))
        if name in (names := door_imports(tree, package_name)):
            home, original = names[name]
            yield from behind(package.joinpath(*home.split(".")[1:]), original, package)
            return
        yield face


@pytest.mark.slow
def test_no_circle_among_files() -> None:
    """Imports in functions count, and those for type checking alone."""
    needs = graph(digest.PACKAGE_DIR)
    assert len(needs) > 200
    assert any(needs.values())
    assert [path.relative_to(digest.PACKAGE_DIR).as_posix() for path in circle(needs)] == []
