"""`import deltact_fab as dt`: four tasks in few lines, whatever else was imported before."""

from __future__ import annotations

import ast
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import deltact_fab as dt
from deltact_fab import moved
from deltact_fab.door import door_imports

ROOT = Path(__file__).parents[1]
TOUR = json.loads((Path(__file__).parents[1] / "examples/tour.ipynb").read_text())
TASKS = ["".join(c["source"]) for c in TOUR["cells"] if "task" in c["metadata"].get("tags", ())]
"""Make a pattern, read a run, track a folder, force and depth in a live loop."""


@pytest.fixture(autouse=True)
def _no_old_path_loaded() -> Iterator[None]:
    """A path is loaded, and warns, once a process."""
    yield
    for path in {p for taught in moved.MOVED_NAMES for p in (taught, taught.partition(".")[0])}:
        sys.modules.pop(f"deltact_fab.{path}", None)
        vars(dt).pop(path, None)


@pytest.fixture
def folder(mini_run: Path, calibrations: list[Path], tmp_path: Path) -> Path:
    shutil.copytree(calibrations[0].parent, tmp_path / "files")
    for file in (tmp_path / "files").iterdir():
        file.rename(tmp_path / file.name)
    (tmp_path / "run").symlink_to(mini_run)
    return tmp_path


@pytest.fixture(autouse=True, scope="module")
def _every_subpackage() -> None:
    """An import of `deltact_fab.present.live` sets the attribute `live` of `deltact_fab`."""
    for module in pkgutil.iter_modules(dt.__path__):
        if not module.name.startswith("_"):
            import_module(f"deltact_fab.{module.name}")


def test_names_are_offered_once() -> None:
    assert set(dt.__all__) <= set(dir(dt))
    assert not [n for n in dt.__all__ if isinstance(getattr(dt, n), ModuleType)]
    with pytest.raises(AttributeError, match="'deltact_fab' has no attribute 'trak'"):
        dt.trak  # type: ignore[attr-defined]  # noqa: B018


def test_exported_names_have_a_line() -> None:
    homes = door_imports(ast.parse(Path(dt.__file__).read_text()), "deltact_fab")
    ours = {name for name, (home, _) in homes.items() if home.startswith("deltact_fab")}
    assert ours - {"open_door"} == {*dt.__all__}
    assert dt.__all__[1:] == re.findall(r"(?m)^- `(\w+)`: [A-Z].+\.$", dt.__doc__ or "")


def test_an_import_loads_the_version_alone() -> None:
    body = "import sys, deltact_fab as dt; print(*(n for n in sys.modules if 'deltact' in n))"
    done = subprocess.run([sys.executable, "-c", body], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"deltact_fab", "deltact_fab.door", "deltact_fab.version"}


def test_old_user_code_still_works() -> None:
    for path, names in moved.MOVED_NAMES.items():
        with pytest.warns(FutureWarning, match=re.escape(f"deltact_fab.{path} goes in 0.5: ")):
            module = import_module(f"deltact_fab.{path}")
        for old, new in names.items():
            assert ":" in new or getattr(module, old) is getattr(dt, new), f"{path}.{old}"
            assert hasattr(module, old), f"{path}.{old}"
    assert {"record", "rig.config", "cad.registry", "shapes.indenter"} <= moved.MOVED_NAMES.keys()


def test_moved_path_warns_once() -> None:
    with pytest.warns(FutureWarning) as told:
        from deltact_fab.gel.press import press
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        from deltact_fab.gel.press import press as again
    assert again is press is dt.press_gel
    assert [str(one.message) for one in told] == [
        "deltact_fab.gel.press goes in 0.5: `import deltact_fab as dt` has dt.press_gel"
    ]
    assert told[0].filename == __file__
    for other in ("gel.fit", "recorded", "gel.pres"):
        with pytest.raises(ModuleNotFoundError, match=f"No module named 'deltact_fab.{other}'"):
            import_module(f"deltact_fab.{other}")
    from deltact_fab.gel import press as module

    with pytest.raises(AttributeError, match=r"gel\.press' has no attribute 'pres'"):
        module.pres  # noqa: B018


def test_what_users_copy_imports_dt_alone() -> None:
    """But for files that are put into the package, which the pages of extension show."""
    cells = "\n".join("".join(cell["source"]) for cell in TOUR["cells"])
    docs = [path for path in ROOT.glob("docs/**/*.md") if not path.match("extend-*.md")]
    pages = [path.read_text() for path in (*docs, ROOT / "README.md")]
    scripts = [path.read_text() for path in (*ROOT.glob("examples/*.py"), ROOT / "cad/view.py")]
    taught = [
        line
        for text in (cells, *pages, *scripts)
        for line in re.findall(r"(?m)^ *((?:from|import) +deltact_fab.*)$", text)
    ]
    assert len(taught) >= 10
    assert set(taught) == {"import deltact_fab as dt"}


@pytest.mark.slow
def test_four_tasks_take_25_lines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sum(len(task.splitlines()) for task in TASKS) <= 25
    names: dict[str, Any] = {"folder": folder}
    said = []
    for task in TASKS:
        exec(task, names)
        said.append(capsys.readouterr().out)
    assert names["sticker"].image.is_file()
    assert names["sticker"].recipe.dots is not None
    assert len(said[2].splitlines()) == len(names["frames"])
    told = re.findall(r"([\d.]+) N, ([\d.]+) mm, \d+ ms", said[3])
    normal_n, depth_mm = (max(map(float, column)) for column in zip(*told, strict=True))
    # By two presses: it is off by up to 0.7 N in single images.
    assert normal_n == pytest.approx(-names["frames"]["fz_n"].min(), abs=0.5)
    assert depth_mm == pytest.approx(1.0, abs=0.4)  # the calibration's gain is made up


@pytest.mark.slow
def test_source_matches_the_live_loop(folder: Path) -> None:
    files = [folder / "force.toml", folder / "depth.toml"]
    measured = [seen.result for seen in dt.measure_source(folder / "run", files, show=["force"])]
    run = dt.load_run(folder / "run")
    with dt.Live(folder / "run", files, show=["force"]) as live:
        for file, wanted in zip(run.frames()["file"], measured, strict=True):
            live.submit(run.raw(file))
            seen = live.result(timeout_s=60)
            assert seen is not None
            assert wanted.force is not None
            assert seen.force is not None
            assert seen.force.force_n == pytest.approx(wanted.force.force_n, abs=1e-9)
        live.reset()
        live.submit(run.raw(file))
        rested = live.result(timeout_s=60)
    assert rested is not None
    assert rested.force is not None
    assert np.abs(rested.force.force_n).max() < 0.1
