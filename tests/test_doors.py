"""Doors of the wings: each name is there and used, they are few, and tools see through them."""

from __future__ import annotations

import ast
import inspect
import random
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from deltact_fab.common import digest
from deltact_fab.door import door_imports
from deltact_fab.paths import PACKAGE_DIR

ROOT = PACKAGE_DIR.parent
WINGS = sorted(file.parent.name for file in PACKAGE_DIR.glob("*/__init__.py"))
MOST, MOST_ALL = 60, 363
"""Names at a door and at all of them: ceilings that only fall; the aim is 300 in all."""


def door(wing: str) -> dict[str, tuple[str, str]]:
    """The names at a wing's door, each with its module and its name there."""
    tree = ast.parse((PACKAGE_DIR / wing / "__init__.py").read_text())
    names = door_imports(tree, f"deltact_fab.{wing}")
    inside = f"deltact_fab.{wing}."
    return {name: home for name, home in names.items() if home[0].startswith(inside)}


@pytest.fixture(scope="module")
def users() -> dict[tuple[str, str], list[Path]]:
    """The files of the package that import a name from another wing's door, by wing and name."""
    found: dict[tuple[str, str], list[Path]] = {}
    for file in sorted(PACKAGE_DIR.rglob("*/*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            top, _, wing = (getattr(node, "module", None) or "").partition(".")
            if isinstance(node, ast.ImportFrom) and top == "deltact_fab" and wing in WINGS:
                for alias in node.names:
                    found.setdefault((wing, alias.name), []).append(file)
    return found


@pytest.mark.parametrize("wing", WINGS)
def test_door_names_exist_and_are_documented(wing: str) -> None:
    module = import_module(f"deltact_fab.{wing}")
    for name, (home, original) in door(wing).items():
        value = getattr(module, name)
        assert value is getattr(import_module(home), original), name
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__doc__, f"{wing}.{name} has no docstring"
    with pytest.raises(AttributeError, match=f"'deltact_fab.{wing}' has no attribute 'nothing'"):
        module.nothing  # noqa: B018


def test_doors_stay_small() -> None:
    counts = {wing: len(door(wing)) for wing in WINGS}
    assert max(counts.values()) <= MOST, counts
    assert sum(counts.values()) <= MOST_ALL, counts


def test_door_names_are_used_outside(users: dict[tuple[str, str], list[Path]]) -> None:
    listed = {(wing, name) for wing in WINGS for name in door(wing)}
    top = ast.parse((PACKAGE_DIR / "__init__.py").read_text())
    outermost = door_imports(top, "deltact_fab").values()
    taken = {(home.partition(".")[2], name) for home, name in outermost} | {("app", "entry")}
    assert sorted(listed - {*users} - taken) == []
    assert sorted({*users} - listed) == []


def test_a_digest_follows_names_behind_doors(users: dict[tuple[str, str], list[Path]]) -> None:
    """Twenty names, each from a file that runs it: its home counts, the door does not."""
    drawn = random.Random(54).sample(sorted(key for key in users if key[0] != "common"), 20)
    followed = 0
    for wing, name in drawn:
        path = Path(str(import_module(door(wing)[name][0]).__file__))
        user = next((f for f in users[wing, name] if path in digest.imported_files(f)), None)
        if user is None:  # types alone, which no result depends on
            continue
        followed += 1
        module = ".".join(user.relative_to(PACKAGE_DIR).with_suffix("").parts)
        files = digest.code_files(module.removesuffix(".__init__"))
        assert path in files, f"{module}: {wing}.{name}"
        assert PACKAGE_DIR / wing / "__init__.py" not in files
        text = path.read_text()
        before = digest.code_text(ast.parse(text))
        assert digest.code_text(ast.parse(f"{text}\nPLANTED = 1.5\n")) != before
        assert digest.code_text(ast.parse(f'{text}\n"""Other words."""  # a remark\n')) == before
    assert followed >= 15


def test_what_is_silent_is_no_wing() -> None:
    """Errors and the store count in no digest; what else is common does."""
    files = {
        path.relative_to(PACKAGE_DIR).as_posix() for path in digest.code_files("physics.gel.press")
    }
    assert "common/aliases.py" in files
    assert not files & {"common/errors.py", "common/cache.py", "common/digest.py", "door.py"}
    assert not any(path.startswith("common/jobs/") for path in files)


@pytest.mark.slow
def test_leak_through_two_doors_fails(tmp_path: Path) -> None:
    """An estimator that imports the record, which imports the gel: each through its door."""
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(PACKAGE_DIR, tmp_path / "deltact_fab", ignore=ignore)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)

    def contracts() -> str:
        linter = Path(sys.executable).with_name("lint-imports")
        words = [str(linter), "--no-cache"]
        return subprocess.run(words, cwd=tmp_path, capture_output=True, text=True).stdout

    kept = contracts()
    assert "0 broken" in kept, kept
    record = tmp_path / "deltact_fab/bench/record/run.py"
    planted = "from deltact_fab.physics import press_gel\n"
    record.write_text(record.read_text().replace("\nimport ", f"\n{planted}import ", 1))
    assert planted in record.read_text()
    broken = contracts()
    assert "Simulated truth cannot leak into an estimator BROKEN" in broken
    record.write_text(record.read_text().replace(planted, ""))
    inside = tmp_path / "deltact_fab/bench/rig/check.py"
    inside.write_text(inside.read_text() + "\nfrom deltact_fab.sensor.shapes import rigid\n")
    assert "The door of sensor BROKEN" in contracts()
