"""What is imported is declared, what is declared is used, and there is one version."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import deltact_fab
from deltact_fab.app.doctor import EXTRA_PURPOSES

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OWN = {"deltact_fab"}
PYTHONS = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))


def named(requirement: str) -> str:
    """The package of a requirement, as indexes compare names."""
    return canonicalize_name(Requirement(requirement).name)


def declared(extra: str) -> set[str]:
    """The packages of an extra, ours left out; of the base without a name."""
    lines = PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"]
    return {named(line) for line in lines} - {"deltact-fab"}


def nodes() -> list[tuple[Path, ast.AST]]:
    """Every import and call of the package, with its file."""
    return [
        (path, node)
        for path in sorted((ROOT / "deltact_fab").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Import | ast.ImportFrom | ast.Call)
    ]


def imported() -> dict[str, str]:
    """Package by the file that imports it, wherever in the file."""
    packages = packages_distributions()
    found = {}
    for path, node in nodes():
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and not node.level and node.module:
            names = [node.module]
        for top in {name.partition(".")[0] for name in names} - sys.stdlib_module_names - OWN:
            for package in packages.get(top, [top]):
                found[named(package)] = str(path.relative_to(ROOT))
    return found


@pytest.mark.slow
def test_imports_are_declared() -> None:
    used = imported()
    extras = set().union(*(declared(extra) for extra in EXTRA_PURPOSES))
    assert not extras & declared("")
    assert set(used) == declared("") | extras, used


def test_all_includes_every_extra() -> None:
    assert set(PROJECT["optional-dependencies"]) >= {*EXTRA_PURPOSES, "all", "test"}
    (line,) = PROJECT["optional-dependencies"]["all"]
    assert line == f"deltact-fab[{','.join(EXTRA_PURPOSES)}]"


@pytest.mark.slow
def test_named_extra_provides_the_module() -> None:
    packages = packages_distributions()
    seen = set()
    for path, node in nodes():
        if not (isinstance(node, ast.Call) and ast.unparse(node.func).endswith("require_extra")):
            continue
        words = [a.value for a in node.args if isinstance(a, ast.Constant)]
        if words and words[0] in EXTRA_PURPOSES:
            extra, modules = words[0], [w for w in words[1:] if w in packages]
            brought = {named(package) for module in modules for package in packages[module]}
            assert brought <= declared(extra), path
            seen.add(extra)
    assert seen == set(EXTRA_PURPOSES)


@pytest.mark.parametrize("file", ["pyproject.toml", "CITATION.cff", "CHANGELOG.md"])
def test_one_version(file: str) -> None:
    said = re.search(
        r'^(?:version(?: = |: )"?|## )(\d+\.\d+\.\d+)', (ROOT / file).read_text(), re.M
    )
    assert said is not None
    assert said[1] == deltact_fab.__version__


def test_the_same_pythons_are_named_everywhere() -> None:
    oldest, newest = PYTHONS[0], PYTHONS[-1]
    assert PROJECT["requires-python"] == f">={oldest}"
    readme, makefile, gate = (
        ROOT.joinpath(f).read_text() for f in ("README.md", "Makefile", ".ci/run")
    )
    listed = f"{', '.join(PYTHONS[:-1])} or {newest}"
    assert f"Python {listed}" in readme
    assert f"Python {oldest} to {newest}" in readme
    assert f"Python {listed}" in makefile
    assert f"{' '.join(f'python{v}' for v in PYTHONS)} python3;" in makefile
    assert f"(3, {oldest[2:]}) <= sys.version_info < (3, {int(newest[2:]) + 1})" in makefile
    assert f"--python-version {oldest} " in makefile
    assert f"for version in {' '.join(PYTHONS[:0:-1])}; do" in gate


@pytest.mark.parametrize("python", PYTHONS)
def test_one_pin_per_package_and_python(python: str) -> None:
    pins = [Requirement(line) for line in (ROOT / "constraints.txt").read_text().splitlines()]
    where = {"python_version": python, "python_full_version": f"{python}.9"}
    names = [pin.name for pin in pins if pin.marker is None or pin.marker.evaluate(where)]
    assert len(names) == len(set(names))
    assert declared("") < set(names)


def test_every_licence_that_travels_is_named() -> None:
    assert PROJECT["license"] == "MIT AND OFL-1.1"
    for file in PROJECT["license-files"]:
        assert (ROOT / file).is_file()
