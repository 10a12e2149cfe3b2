"""The JSON keys of 0.3.0 stay one version beside `checks`: held to recordings of that program.

Sentences are free to change; the last digits of numbers are the machine's.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import spoiled
from called import called

from deltact_fab.common.checks import STATUS_ORDER, Check
from deltact_fab.fabricate.patterns.code import encode
from deltact_fab.fabricate.patterns.raster import raster
from deltact_fab.fabricate.patterns.recipe import PatternRecipe

RECORDED = Path(__file__).parents[1] / "data" / "json_0_3_0"
RECIPE = PatternRecipe(law="algorithm1", seed=3, size_mm=12.0, patch_mm=0.2, r=0.3)
DEEP = """
name = "deep"
indenters = ["sphere:10"]
positions_mm = [[0.0, 0.0]]
depths_mm = [14.0]
channels = ["image", "dots"]
[capture]
rate_hz = 0.5
[specimen]
pattern = "dense"
"""
BENCH = """
kind = "grbl"
[stage]
port = "no-port"
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [6000.0, 6000.0, 6000.0]
acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]
"""


# Of `cad check`: rows that came after 0.3.0, and those of light and poses, which changed.
CHANGED_CHECKS = (
    "raw pixel", "pattern", "diffraction", "field of the lens", "sold", "suction in printing",
    "ceilings", "bed contact",
    "LED supply", "LED resistor", "LED current, least", "LED current", "even light",
)  # fmt: skip


def cad_failing(folder: Path) -> str:
    changes = ("light.led_count=9", "shell.ledge_height_mm=0.5", "light.axial_fit_mm=0.1")
    return _cad(*(word for change in changes for word in ("--set", change)))


def cad_passing(folder: Path) -> str:
    return _cad()


def _cad(*changes: str) -> str:
    """The first row of each kind and verdict."""
    rows = json.loads(called("cad", "check", *changes, "--json").stdout)
    rows = [row for row in rows if row["check"] not in CHANGED_CHECKS]
    return json.dumps(list({(row["check"], row["passed"]): row for row in rows[::-1]}.values()))


def protocol_passing(folder: Path) -> str:
    return called("protocol", "check", "smoke", "--json", cwd=folder).stdout


def protocol_failing(folder: Path) -> str:
    (folder / "deep.toml").write_text(DEEP)
    return called("protocol", "check", "deep.toml", "--json", cwd=folder).stdout


def rig_failing(folder: Path) -> str:
    (folder / "bench.toml").write_text(BENCH)
    words = ("rig", "check", "bench.toml", "--seconds", "0.1", "--json")
    return called(*words, cwd=folder).stdout


def _verified(folder: Path, **faults: Any) -> str:
    sheet = np.pad(raster(RECIPE, 600.0), ((120,) * 2, (120,) * 2, (0, 0)), constant_values=255)
    spoiled.save(spoiled.print_of(sheet, **faults), folder / "scan.png", 600.0)
    return called("pattern", "verify", "scan.png", encode(RECIPE), "--json", cwd=folder).stdout


def pattern_passing(folder: Path) -> str:
    return _verified(folder)


def pattern_failing(folder: Path) -> str:
    return _verified(folder, scale=(1.0031, 0.994), fade=(1.0, 0.3, 1.0))


def accept_failing(folder: Path) -> str:
    (folder / "images").mkdir()
    grey = np.full((720, 1280, 3), 90, np.uint8)
    cv2.imwrite(str(folder / "images" / "0.png"), grey)
    return called("rig", "accept", "images", "dense", "--json", cwd=folder).stdout


def accept_passing(folder: Path) -> str:
    return called(
        "rig", "accept", "virtual", "dense-with-dots", "--frames", "12", "--json", cwd=folder
    ).stdout


SLOW = {cad_passing, protocol_passing, pattern_passing, accept_failing, accept_passing}
COMMANDS = [
    pytest.param(one, id=one.__name__, marks=[pytest.mark.slow] if one in SLOW else [])
    for one in (
        cad_failing, cad_passing, protocol_passing, protocol_failing, rig_failing,
        pattern_passing, pattern_failing, accept_failing, accept_passing,
    )
]  # fmt: skip


def assert_same(old: Any, new: Any, where: str) -> None:
    """Every key of old is in new, with the same value."""
    if isinstance(old, dict):
        for key, value in old.items():
            assert key in new, f"{where}: no {key}"
            assert_same(value, new[key], f"{where}.{key}")
    elif isinstance(old, list):
        assert len(new) >= len(old), where  # rows may follow
        for k, (one, other) in enumerate(zip(old, new, strict=False)):
            assert_same(one, other, f"{where}[{k}]")
    elif isinstance(old, str):
        assert (type(new), bool(new)) == (str, bool(old)), where
        assert " " in old or new == {"whole": "intact"}.get(old, old), where
    elif old is None or isinstance(old, bool):
        assert new is old, where
    else:
        # What a controller's timer can step.
        slowest = re.fullmatch(r"protocol_\w+\[14\].bound", where)
        assert new == pytest.approx(4.0 if slowest else old, rel=0.02, abs=0.02), where


@pytest.mark.parametrize("command", COMMANDS)
def test_checks_keep_0_3_0_keys(tmp_path: Path, command: Callable[[Path], str]) -> None:
    data, name = json.loads(command(tmp_path)), command.__name__
    assert_same(json.loads((RECORDED / f"{name}.json").read_text()), data, name)
    checks = data if isinstance(data, list) else data["checks"]
    keys = {field.name for field in fields(Check)}
    assert all(keys <= set(check) for check in checks)
    assert {check["status"] for check in checks} <= set(STATUS_ORDER)
    ids = [check["id"] for check in checks]
    assert len(set(ids)) == len(ids)
    assert [id for id in ids if not re.fullmatch(r"[a-z0-9]+([.-][a-z0-9]+)*", id)] == []
    assert ("fail" in {check["status"] for check in checks}) == name.endswith("failing")
