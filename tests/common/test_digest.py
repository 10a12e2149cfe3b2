"""One digest of code: what counts, and what does not."""

import shutil
from pathlib import Path

import pytest

from deltact_fab.common import digest


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of five files: `top` imports one by its package's face and one in a function."""
    root = tmp_path / "pack"
    (root / "room").mkdir(parents=True)
    (root / "__init__.py").write_text("")
    (root / "room/__init__.py").write_text("from .used import f\nfrom .unused import g\n")
    (root / "room/used.py").write_text('"""Words."""\nC = 1.5\n\n\ndef f():\n    return C\n')
    (root / "room/unused.py").write_text("def g():\n    return 2\n")
    (root / "late.py").write_text("def h():\n    return 3\n")
    (root / "typed.py").write_text("T = int\n")
    (root / "top.py").write_text(
        "from typing import TYPE_CHECKING\nfrom .room import f\n"
        "if TYPE_CHECKING:\n    from .typed import T\n"
        "def run():\n    from .late import h\n    return f() + h()\n"
    )
    return root


def now(package: Path) -> str:
    """The digest of `top`, read anew: within a process sources are read once."""
    copy = package.with_name(f"{package.name}{len(list(package.parent.iterdir()))}")
    shutil.copytree(package, copy)
    return digest.code_digest("top", package=copy)


def test_files_are_those_that_run(package: Path) -> None:
    names = [p.relative_to(package).as_posix() for p in digest.code_files("top", package=package)]
    assert names == ["late.py", "room/used.py", "top.py"]


def test_a_constant_counts(package: Path) -> None:
    before = now(package)
    (package / "room/used.py").write_text("C = 1.6\n\n\ndef f():\n    return C\n")
    assert now(package) != before


@pytest.mark.parametrize("file", ["room/unused.py", "typed.py"])
def test_files_not_run_do_not_count(package: Path, file: str) -> None:
    before = now(package)
    (package / file).write_text("def g():\n    return 5\n\n\nT = g\n")
    assert now(package) == before


def test_comments_and_layout_do_not_count(package: Path) -> None:
    before = now(package)
    (package / "room/used.py").write_text(
        '"""Other words."""\nC = (\n    1.5  # why\n)\n"""Of C."""\n'
        'def f():\n    """Said."""\n    return C\n'
    )
    assert now(package) == before


def test_gel_digest_includes_solver_only() -> None:
    names = {
        p.relative_to(digest.PACKAGE_DIR).as_posix() for p in digest.code_files("physics.gel.press")
    }
    assert {
        "physics/gel/finite/newton.py",
        "sensor/elasticity/edge_compliance.py",
        "sensor/shapes/prism.py",
    } <= names
    assert not any(
        name.startswith(("simulate/", "app/", "physics/imaging", "common/cache")) for name in names
    )


def test_package_without_code_is_refused(package: Path) -> None:
    """A room whose `__init__` only says what it is for would leave all its files out."""
    (package / "room/__init__.py").write_text('"""Words."""\n')
    with pytest.raises(ValueError, match="package 'room' holds no code; name modules in it"):
        digest.code_files("room", package=package)


def test_other_packages_digest_includes_its_imports(package: Path) -> None:
    (package / "top.py").write_text(
        "def run():\n    from deltact_fab.sensor import parse_indenter\n"
    )
    names = {p.name for p in digest.code_files("top", package=package)}
    assert {"top.py", "rigid.py", "prism.py"} <= names
