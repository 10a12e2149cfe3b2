"""Digest of the code that a cached result depends on.

It covers the files that the named modules import, directly or indirectly, also within functions; a
name at a package's door is followed to the file that defines it, and a folder searched by
`discover` counts whole. Only the syntax tree without docstrings counts, so comments, docstrings
and layout do not change the digest.
"""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

from deltact_fab.door import door_imports
from deltact_fab.paths import PACKAGE_DIR

# Error messages, paths, storage and progress: no result depends on them.
UNCOUNTED_MODULES = (
    "door",
    "paths",
    *(f"common.{name}" for name in ("errors", "cache", "digest", "files", "jobs")),
)

# (module, names) of each import; the module as its parts, package first.
Imports = tuple[tuple[tuple[str, ...], list[str]], ...]


def code_digest(*modules: str, package: Path = PACKAGE_DIR) -> str:
    """Hash modules, named relative to the package as in "gel.path", and all their imports.

    package: folder of another package; its imports of this one count too. Raises ValueError for a
    missing module.
    """
    return _digest(tuple(sorted(set(modules))), package)


@cache
def _digest(modules: tuple[str, ...], package: Path) -> str:
    text = hashlib.sha256()
    for path in code_files(*modules, package=package):
        name = path.relative_to(_package_folder(path, package)).as_posix()
        text.update(f"{name} {_parse_module(path, package)[0]}\n".encode())
    return text.hexdigest()[:16]


def code_files(*modules: str, package: Path = PACKAGE_DIR) -> list[Path]:
    """List the files covered by the digest, sorted.

    Raises ValueError for a missing module, and for a package whose `__init__` has no code.
    """
    todo, files = [], set()
    for name in modules:
        path = _module_file((package.name, *name.split(".")), package)
        if path is None:
            raise ValueError(f"digest: no module {name!r} in {package.name}")
        if path.name == "__init__.py" and not _holds_code(path):
            raise ValueError(f"digest: package {name!r} holds no code; name modules in it")
        todo.append(path)
    while todo:
        path = todo.pop()
        if path not in files:
            files.add(path)
            todo += (f for f in imported_files(path, package) if not _is_uncounted(f, package))
    return sorted(files)


def code_text(tree: ast.AST) -> str:
    """Source text of a syntax tree without comments, layout and docstrings."""
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            node.body = [statement for statement in body if not _is_text(statement)] or [ast.Pass()]  # type: ignore[attr-defined]
    return ast.unparse(tree)


def _is_text(node: ast.AST) -> bool:
    """True for a string statement, that is, a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@cache
def imported_files(path: Path, package: Path = PACKAGE_DIR) -> tuple[Path, ...]:
    """Files of the package that a file imports at run time, also within functions."""
    files = []
    for module, names in _parse_module(path, package)[1]:
        for name in names:
            file = _defining_file(module, name, package)
            if file is not None and file != path:
                files.append(file)
    return (*files, *_parse_module(path, package)[2])


def _holds_code(path: Path) -> bool:
    body = ast.parse(path.read_text(encoding="utf-8")).body
    return any(not _is_text(node) for node in body)


def _is_uncounted(file: Path, package: Path) -> bool:
    name = ".".join(file.relative_to(_package_folder(file, package)).with_suffix("").parts)
    return any(name == silent or name.startswith(f"{silent}.") for silent in UNCOUNTED_MODULES)


def _package_folder(path: Path, package: Path) -> Path:
    return PACKAGE_DIR if path.is_relative_to(PACKAGE_DIR) else package


@cache
def _parse_module(path: Path, package: Path) -> tuple[str, Imports, tuple[Path, ...]]:
    """Hash of a file's code, its imports from the package, and the files it discovers."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    dependencies = _imports(tree, path, package), _discovered_files(tree, path)
    return hashlib.sha256(code_text(tree).encode()).hexdigest(), *dependencies


def _discovered_files(tree: ast.Module, path: Path) -> tuple[Path, ...]:
    """Sibling files found by a module's `collect_entries(__package__, ..., besides=(...))`."""
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if (
            ast.unparse(call.func) == "collect_entries"
            and ast.unparse(call.args[0]) == "__package__"
        ):
            excluded = {path.stem, "__init__"}
            for keyword in call.keywords:
                excluded.update(ast.literal_eval(keyword.value))
            return tuple(f for f in sorted(path.parent.glob("*.py")) if f.stem not in excluded)
    return ()


def _imports(tree: ast.Module, path: Path, package: Path) -> Imports:
    home = _package_folder(path, package)
    parent = (home.name, *path.relative_to(home).parent.parts)
    packages = (package.name, PACKAGE_DIR.name)
    imports: list[tuple[tuple[str, ...], list[str]]] = []
    todo: list[ast.AST] = [tree]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            todo += node.orelse
            continue
        # Statements hold imports, expressions do not.
        for inside in ("body", "orelse", "finalbody", "handlers", "cases"):
            todo += getattr(node, inside, ())
        if isinstance(node, ast.ImportFrom):
            tail = tuple(node.module.split(".")) if node.module else ()
            if node.level:
                tail = parent[: len(parent) - node.level + 1] + tail
            if tail[0] in packages:
                imports.append((tail, [alias.name for alias in node.names]))
        elif isinstance(node, ast.Import):
            for alias in node.names:
                parts = tuple(alias.name.split("."))
                if parts[0] in packages and len(parts) > 1:
                    imports.append((parts[:-1], [parts[-1]]))
    return tuple(imports)


def _defining_file(module: tuple[str, ...], name: str, package: Path) -> Path | None:
    """Find the file that defines a name imported from a module."""
    direct = _module_file((*module, name), package)
    if direct is not None:
        return direct
    file = _module_file(module, package)
    if file is None or file.name != "__init__.py":
        return file
    home, original = _door_imports(file, ".".join(module)).get(name, ("", ""))
    return _defining_file(tuple(home.split(".")), original, package) if home else file


@cache
def _door_imports(file: Path, package: str) -> dict[str, tuple[str, str]]:
    """Map the names at a package's door to (module, name there)."""
    return door_imports(ast.parse(file.read_text(encoding="utf-8")), package)


def _module_file(module: tuple[str, ...], package: Path) -> Path | None:
    path = (PACKAGE_DIR if module[0] == PACKAGE_DIR.name else package).joinpath(*module[1:])
    for file in (path / "__init__.py", path.with_name(path.name + ".py")):
        if file.is_file():
            return file
    return None
