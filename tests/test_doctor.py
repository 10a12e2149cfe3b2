"""`doctor` tells what is there, and what to do about what is not."""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab import doctor
from deltact_fab.cli.main import main
from deltact_fab.errors import MissingLibrary
from deltact_fab.rig.devices import FoundDevice

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]


def test_requirements_are_read() -> None:
    assert doctor.required("numpy>=1.26") == ("numpy", "core")
    line = "pypardiso>=0.4.5; platform_machine == 'x86_64' and extra == 'fast'"
    assert doctor.required(line) == ("pypardiso", "fast")


@pytest.mark.parametrize(
    ("name", "module"),
    [("Pillow", "PIL"), ("pyserial", "serial"), ("opencv-contrib-python-headless", "cv2"),
     ("numpy", "numpy"), ("import-linter", "importlinter")],
)  # fmt: skip
def test_the_name_of_the_import_is_the_package_s_own(name: str, module: str) -> None:
    assert doctor.module_of(metadata.distribution(name)) == module


def test_the_core_is_complete_here() -> None:
    done = CliRunner().invoke(main, ["doctor", "--json"])
    said = json.loads(done.stdout)
    core = {f["name"].lower(): f["state"] for f in said["findings"] if f["group"] == "core"}
    assert set(core.values()) == {"ok"}
    assert {"python", "deltact-fab", "numpy", "pillow", "scipy"} <= set(core)
    assert (done.exit_code, said["ok"]) == (0, True)


def test_what_is_missing_is_named_with_the_way_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = metadata.distribution

    def without(name: str) -> metadata.Distribution:
        if name.lower() in ("segno", "mcap"):
            raise metadata.PackageNotFoundError(name)
        return whole(name)

    def no_library(name: str) -> None:
        raise OSError(name)

    monkeypatch.setattr(metadata, "distribution", without)
    monkeypatch.setattr(ctypes, "CDLL", no_library)
    monkeypatch.setattr(doctor, "ports", list)
    monkeypatch.setattr(doctor, "cameras", lambda: [FoundDevice("/dev/no-such-camera", "A camera")])
    done = CliRunner().invoke(main, ["doctor"])
    assert done.exit_code == 1
    lines = {line.split()[2]: line for line in done.output.splitlines()}
    assert lines["segno"].startswith("missing core")
    assert "pip install segno" in lines["segno"]
    assert "runs as Parquet, MCAP and LeRobot; pip install 'deltact-fab[export]'" in lines["mcap"]
    assert "apt-get install libgl1" in lines["libGL.so.1"]
    assert "video" in lines["/dev/no-such-camera"]
    assert "the core is broken" in done.output


def test_a_missing_extra_leaves_the_core_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = metadata.distribution

    def without(name: str) -> metadata.Distribution:
        if name == "mcap":
            raise metadata.PackageNotFoundError(name)
        return whole(name)

    monkeypatch.setattr(metadata, "distribution", without)
    assert CliRunner().invoke(main, ["doctor"]).exit_code == 0


def test_deep_imports_and_tells_what_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(module: str) -> None:
        if module == "cadquery":
            raise MissingLibrary("cadquery needs libGL.so.1: apt-get install libgl1")
        if module == "cv2":
            raise AttributeError("no such thing\nin it")

    monkeypatch.setattr(doctor, "_import", broken)
    found = {f.name: f for f in doctor.look(deep=True)}
    assert found["cadquery"].state == "broken"
    assert "libGL.so.1" in found["cadquery"].text
    opencv = found["opencv-contrib-python-headless"]
    assert (opencv.state, opencv.get) == (
        "broken", "pip install --force-reinstall opencv-contrib-python-headless",
    )  # fmt: skip
    assert "\n" not in opencv.line()
    assert doctor.is_broken(list(found.values()))


def test_nothing_large_is_imported() -> None:
    code = (
        "import sys; from deltact_fab.doctor import look; look();"
        "print(sorted({'cadquery', 'cv2', 'pandas', 'matplotlib', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
