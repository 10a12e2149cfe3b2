"""A plain install, without any extra: what works there, and the one line about what does not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from deltact_fab.extras import EXTRAS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def needed(name: str, found: dict[str, metadata.Distribution]) -> None:
    """Put a package and all that it needs without an extra into `found`."""
    if name in found:
        return
    found[name] = metadata.distribution(name)
    for line in found[name].requires or []:
        wanted = Requirement(line)
        if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
            needed(wanted.name.lower(), found)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of links to the packages of the base and to nothing else that is installed here."""
    found: dict[str, metadata.Distribution] = {}
    for line in PROJECT["dependencies"]:
        needed(Requirement(line).name.lower(), found)
    assert {"numpy", "opencv-contrib-python-headless"} <= set(found)
    assert not {"cadquery", "vtk", "matplotlib", "numba", "mkl"} & set(found)
    folder = tmp_path_factory.mktemp("base")
    for distribution in found.values():
        for top in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            link = folder / top
            if not link.exists():
                link.symlink_to(Path(str(distribution.locate_file(top))))
    (folder / "deltact_fab").symlink_to(ROOT / "deltact_fab")
    about = folder / f"deltact_fab-{PROJECT['version']}.dist-info" / "METADATA"
    about.parent.mkdir()
    lines = ["Metadata-Version: 2.4", "Name: deltact-fab", f"Version: {PROJECT['version']}"]
    lines += [f"Requires-Dist: {line}" for line in PROJECT["dependencies"]]
    for extra in EXTRAS:
        wanted = map(Requirement, PROJECT["optional-dependencies"][extra])
        lines += [f'Requires-Dist: {one.name}; extra == "{extra}"' for one in wanted]
    about.write_text("\n".join(lines))
    return folder


def call(base: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command of the program, with the base's packages alone (-S: none of the environment's)."""
    return subprocess.run(
        [sys.executable, "-S", "-m", "deltact_fab.cli.main", *words],
        capture_output=True, text=True, cwd=folder, timeout=300, check=False,
        env={**os.environ, "PYTHONPATH": str(base)},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        ("cad check", "cad"),
        ("cad export sphere:10 --out parts", "cad"),
        ("cad guide -o guide.html", "report"),
        ("report RUN -o page.html", "report"),
        ("study run comparison", "report"),
        ("gel press --depth 1 --plot press.png", "report"),
        ("demo", "report"),
        ("record export RUN --format mcap -o run.mcap", "export"),
        ("record export RUN --format parquet -o run", "export"),
        ("numerics cad --quick", "cad"),
    ],
)
def test_a_command_that_lacks_its_extra_names_it_and_writes_nothing(
    words: str, extra: str, base: Path, mini_run: Path, tmp_path: Path
) -> None:
    done = call(base, tmp_path, *words.replace("RUN", str(mini_run)).split())
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("deltact-fab: ")
    assert line.endswith(f": pip install 'deltact-fab[{extra}]'")
    assert list(tmp_path.iterdir()) == []


def test_measure_pattern_protocol_and_doctor_need_no_extra(
    base: Path, mini_run: Path, tmp_path: Path
) -> None:
    def good(*words: str) -> str:
        done = call(base, tmp_path, *words)
        assert done.returncode == 0, done.stderr
        return done.stdout

    good("--help")
    good("pattern", "make", "-d", "0.3", "-r", "0.1", "--size", "6", "-o", "x.png")
    assert (tmp_path / "x.png").is_file()
    good("protocol", "check", "smoke")
    good("cad", "bom")
    rows = [json.loads(line) for line in good("measure", str(mini_run), "--jsonl").splitlines()]
    assert len(rows) > 5
    said = json.loads(good("doctor", "--json"))
    assert said["ok"]
    state = {f["name"]: f["state"] for f in said["findings"]}
    assert (state["numpy"], state["cadquery"], state["matplotlib"]) == ("ok", "missing", "missing")


@pytest.mark.slow
def test_a_run_is_made_and_analysed_without_an_extra(
    base: Path, mini: tuple[Path, Path], tmp_path: Path
) -> None:
    protocol, rig = map(str, mini)
    done = call(base, tmp_path, "run", protocol, "--rig", rig, "--out", "run")
    assert done.returncode == 0, done.stderr
    done = call(base, tmp_path, "analyze", "tracking", "run")
    assert done.returncode == 0, done.stderr
    assert "no figures: a figure needs matplotlib" in done.stderr
