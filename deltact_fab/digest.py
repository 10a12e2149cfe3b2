"""One digest of code for everything that is kept: of what a result depends on, and of no more.

The files are those that the named modules import, in functions too, each with what it imports in
turn; a name that a package's face hands on is followed to the file that defines it. Of each file
the syntax tree counts, without docstrings: a changed comment, docstring or layout is no change.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parent
# They say what went wrong, where things are kept and how far it is: no result depends on them.
SILENT = ("errors", "cache", "digest")


def of(*modules: str, package: Path = PACKAGE) -> str:
    """The digest of modules, named from the package as in "gel.path", and all that they import.

    Raises ValueError for a module that is not there.
    """
    return _digest(tuple(sorted(set(modules))), package)


@cache
def _digest(modules: tuple[str, ...], package: Path) -> str:
    text = hashlib.sha256()
    for path in files(*modules, package=package):
        text.update(path.relative_to(package).as_posix().encode() + b"\0")
        text.update(meaning(path.read_text(encoding="utf-8")).encode() + b"\0")
    return text.hexdigest()[:16]


def files(*modules: str, package: Path = PACKAGE) -> list[Path]:
    """The files whose text counts, sorted. Raises ValueError for a module that is not there."""
    todo, found = [], set()
    for name in modules:
        path = _file(tuple(name.split(".")), package)
        if path is None:
            raise ValueError(f"digest: no module {name!r} in {package.name}")
        todo.append(path)
    while todo:
        path = todo.pop()
        if path not in found:
            found.add(path)
            todo += _imported(path, package)
    return sorted(found)


def meaning(source: str) -> str:
    """The syntax tree of a source text without docstrings and places."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        # A string that stands alone is a docstring, of whatever is above it.
        node.body = [at for at in node.body if not _is_text(at)] or [ast.Pass()]
    return ast.dump(tree)


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@cache
def _imported(path: Path, package: Path) -> tuple[Path, ...]:
    """Files of the package that this one imports when it runs."""
    found = []
    for module, names in _imports(path, package):
        for name in names:
            file = _defining(module, name, package)
            if file is not None and file != path and _silent(file, package) is False:
                found.append(file)
    return tuple(found)


def _silent(file: Path, package: Path) -> bool:
    return file.parent == package and file.stem in SILENT


def _imports(path: Path, package: Path) -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """(module, names) of each import from the package: the module's parts below the package."""
    here = path.relative_to(package).parent.parts
    todo: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            todo += node.orelse
            continue
        todo += ast.iter_child_nodes(node)
        if isinstance(node, ast.ImportFrom):
            tail = tuple(node.module.split(".")) if node.module else ()
            if node.level:
                base = here[: len(here) - node.level + 1]
            elif tail and tail[0] == package.name:
                base, tail = (), tail[1:]
            else:
                continue
            yield base + tail, [alias.name for alias in node.names]
        elif isinstance(node, ast.Import):
            for alias in node.names:
                parts = tuple(alias.name.split("."))
                if parts[0] == package.name and len(parts) > 1:
                    yield parts[1:-1], [parts[-1]]


def _defining(module: tuple[str, ...], name: str, package: Path) -> Path | None:
    """The file that a name imported from a module comes from."""
    direct = _file((*module, name), package)
    if direct is not None:
        return direct
    file = _file(module, package)
    if file is None or file.name != "__init__.py":
        return file
    for inner, names in _imports(file, package):
        if name in names:
            return _defining(inner, name, package)
    return file


def _file(module: tuple[str, ...], package: Path) -> Path | None:
    path = package.joinpath(*module)
    for file in (path / "__init__.py", path.with_name(path.name + ".py") if module else path):
        if file.is_file():
            return file
    return None
