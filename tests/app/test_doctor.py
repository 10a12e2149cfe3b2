"""`doctor` tells what is there, and what to do about what is not."""

from __future__ import annotations

import ctypes
import json
from importlib import metadata

import pytest
from click.testing import CliRunner

from deltact_fab.app import doctor
from deltact_fab.app.cli.main import main


def test_requirements_are_read() -> None:
    assert doctor.parse_requirement("numpy>=1.26") == ("numpy", "core")
    line = "pypardiso>=0.4.5; platform_machine == 'x86_64' and extra == 'fast'"
    assert doctor.parse_requirement(line) == ("pypardiso", "fast")


def test_the_core_is_complete_here() -> None:
    done = CliRunner().invoke(main, ["doctor", "--json"])
    said = json.loads(done.stdout)
    core = {f["name"].lower(): f["state"] for f in said["findings"] if f["group"] == "core"}
    assert set(core.values()) == {"ok"}
    assert {"python", "deltact-fab", "numpy", "pillow", "scipy"} <= set(core)
    assert (done.exit_code, said["ok"]) == (0, True)


def test_missing_items_name_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = metadata.version

    def without(name: str) -> str:
        if name.lower() in ("segno", "mcap"):
            raise metadata.PackageNotFoundError(name)
        return whole(name)

    def no_library(name: str) -> None:
        raise OSError(name)

    monkeypatch.setattr(metadata, "version", without)
    monkeypatch.setattr(ctypes, "CDLL", no_library)
    done = CliRunner().invoke(main, ["doctor"])
    assert done.exit_code == 1
    lines = {line.split()[2]: line for line in done.output.splitlines()}
    assert lines["segno"].split()[:2] == ["missing", "core"]
    assert "pip install segno" in lines["segno"]
    for words in ("runs as Parquet, MCAP and LeRobot", "pip install 'deltact-fab[export]'"):
        assert words in lines["mcap"]
    assert "apt-get install libgl1" in lines["libGL.so.1"]
    assert "Core broken." in done.output
