"""Facts that are found again: where a fresh run would say the same, and then without a kernel."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import is_dataclass, replace
from functools import cache as once
from pathlib import Path
from types import FunctionType, MethodType

import pytest

from deltact_fab.common import cache, digest
from deltact_fab.fabricate.cad.build import part_key
from deltact_fab.fabricate.cad.check import check_solids
from deltact_fab.fabricate.cad.check.built import BuiltDesign, Facts
from deltact_fab.fabricate.cad.design import IndenterList, ListedIndenter, load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.drafting.drawing import drawing
from deltact_fab.fabricate.cad.export import DRAWING_SECTIONS
from deltact_fab.fabricate.cad.registry import design_parts, find_part, list_parts

LIST = IndenterList(indenter=(ListedIndenter("sphere:10"),))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path))
    return tmp_path


# What a part declares is all that it reads.


def watched(record, path, note):
    """The record as one of a subclass that calls note(path) for each value read from it."""
    made = object.__new__(_class(type(record)))
    for name, value in (("_real", record), ("_path", path), ("_note", note)):
        object.__setattr__(made, name, value)
    return made


@once
def _class(real):
    return type(real.__name__, (real,), {"__getattribute__": _read})


def _read(self, name):
    state = object.__getattribute__(self, "__dict__")
    real = state["_real"]
    if name == "__class__":
        return type(real)
    if name.startswith("__") and name != "__dict__":
        return object.__getattribute__(self, name)
    value = getattr(real, name)
    path = f"{state['_path']}.{name}" if state["_path"] else name
    if isinstance(value, MethodType) and value.__self__ is real:
        return MethodType(value.__func__, self)
    if isinstance(value, FunctionType):  # a static method reads no dimension
        return value
    if is_dataclass(value) and not isinstance(value, type):
        return watched(value, path, state["_note"])
    state["_note"](path)
    return value


def unread(part, design, drawing_too=True):
    """What box, solid and drawing read of a design and the part does not declare."""
    paths, drawn = set(), set()
    seen = watched(design, "", paths.add)
    part.box(seen)
    solid = part.build(seen)
    if part.callouts is not None:
        part.callouts(seen)
    if part.callouts is not None and drawing_too:
        drawing(part, watched(design, "", drawn.add), solid)
    declared = {*part.sections, *part.derived}
    # Whether a value was measured, and what the machine and the title block add to a drawing.
    beside = {*declared, *DRAWING_SECTIONS, "mount"}
    return {path for path in paths if path.partition(".")[0] not in declared} | {
        path
        for path in drawn
        if path.partition(".")[0] not in beside and not path.endswith(".measured")
    }


@pytest.mark.parametrize(
    ("kind", "drawing_too"),
    [("block", False), pytest.param("franka", True, marks=pytest.mark.slow)],
)
def test_part_reads_only_declared_keys(kind, drawing_too):
    design = load_design("deltact", [f"mount.kind={kind}"])
    found = {part.name: unread(part, design, drawing_too) for part in design_parts()}
    assert {name: keys for name, keys in found.items() if keys} == {}


def test_undeclared_read_is_detected():
    shell = find_part("shell")
    names = tuple(name for name in shell.derived if name != "z_joint_mm")
    assert unread(replace(shell, derived=names), Design(), False) == {"z_joint_mm"}


def test_key_depends_on_declared_values_only():
    other = load_design("deltact", ["cover.peg_mm=3"])
    same = {p.name for p in design_parts() if part_key(p, Design()) == part_key(p, other)}
    assert {"cover", "camera-holder"}.isdisjoint(same)
    assert {"skin", "acrylic", "mold", "screw"} <= same
    # The plate is where it was: thinner skin, thicker plate.
    ring = find_part("light-holder")
    moved = load_design("deltact", ["skin.thickness_mm=11.5", "optics.acrylic_mm=2.5"])
    assert part_key(ring, moved) == part_key(ring, Design())


def test_facts_are_cached_errors_not():
    def raising():
        raise ValueError("broken")

    def found(key):
        facts = Facts()
        value = facts.get_or_compute("a", key, lambda: [1, (2, 3)])
        with pytest.raises(ValueError, match="broken"):
            facts.get_or_compute("b", key, raising)
        facts.save()
        return value, facts.computed

    assert found(1) == ([1, [2, 3]], ["a"])
    assert found(1) == ([1, [2, 3]], [])
    assert found(2) == ([1, [2, 3]], ["a"])


def test_changed_code_misses_the_cache(monkeypatch):
    def found():
        facts = Facts()
        facts.get_or_compute("a", 1, lambda: "one")
        facts.save()
        return facts.computed

    assert [found(), found()] == [["a"], []]
    monkeypatch.setattr(digest, "code_digest", lambda *_, **_package: "other")
    assert found() == ["a"]


# With the kernel.


def _ran(changes):
    """Rows and the facts that were computed, with the cache."""
    facts = Facts()
    built = BuiltDesign(load_design("deltact", changes), tuple(list_parts(LIST)), facts=facts)
    rows = check_solids(built)
    facts.save()
    return rows, set(facts.computed)


CODE = """
import sys
from deltact_fab.fabricate.cad.check import check_design
from deltact_fab.fabricate.cad.design import IndenterList, ListedIndenter, load_design
one = IndenterList(indenter=(ListedIndenter("sphere:10"),))
rows = check_design(load_design(), indenters=one, cached=True)
print("cadquery" in sys.modules, all(not row.failed for row in rows), len(rows) > 100)
"""


@pytest.mark.slow
def test_cached_rows_need_no_kernel():
    first, _ = _ran([])
    rows, ran = _ran(["skin.width_mm=37"])
    fresh = BuiltDesign(load_design("deltact", ["skin.width_mm=37"]), tuple(list_parts(LIST)))
    assert rows == check_solids(fresh)
    # On the bench the one that hangs there meets whatever else has changed.
    own = [name for name in ran if not name.startswith("common volume")]
    assert not any("indenter" in name for name in own)
    web = _ran(["mold.web_mm=9.5"])[1]
    assert web
    assert all("mold" in name for name in web)
    assert _ran([]) == (first, set())
    # Another process says the same without having imported cadquery.
    root = Path(__file__).parents[3]
    told = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, cwd=root)
    assert told.stdout == "False True True\n", told.stderr
