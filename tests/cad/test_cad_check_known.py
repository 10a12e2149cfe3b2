"""Rows that are found again: where a fresh run would say the same, and then without a kernel."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from deltact_fab import cache, digest
from deltact_fab.cad import check
from deltact_fab.cad.check.built import BuiltDesign
from deltact_fab.cad.check.memo import KIND, Known, value_at, watched
from deltact_fab.cad.check.run import CHECKS, CheckKind, of_built
from deltact_fab.cad.design import IndenterList, ListedIndenter, load_design
from deltact_fab.cad.dimensions import Design

LIST = IndenterList(indenter=(ListedIndenter("sphere:10"),))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path))
    return tmp_path


def _read(look, design=None):
    """What `look` reads of a design."""
    noted = {}
    look(watched(design or Design(), "", noted.__setitem__))
    return noted


def test_a_derived_length_is_one_value_and_a_method_reads_what_it_reads():
    assert _read(lambda d: d.z_joint_mm) == {"z_joint_mm": -14.0}
    assert _read(lambda d: d.screw.row.bore_mm) == {"screw.row.bore_mm": 3.55}
    noted = _read(lambda d: d.unverified())
    assert set(noted) >= {"camera.measured", "mount.kind"}
    assert "skin.width_mm" not in noted
    assert _read(lambda d: d.peg_centres_mm)["peg_centres_mm"][0] == list(
        Design().peg_centres_mm[0]
    )


@pytest.mark.parametrize(
    "look",
    [
        lambda d: asdict(d.cover),
        lambda d: replace(d.cover, floor_mm=3.0).peg_mm,
        lambda d: vars(d.cover)["peg_mm"],
        lambda d: hash(d.cover),
        lambda d: d.cover == Design().cover,
        lambda d: str(d.cover),
    ],
    ids=["asdict", "replace", "vars", "hash", "equal", "str"],
)
def test_no_way_round_is_unnoticed(look):
    """However a record is read: another peg is another reading."""
    noted = _read(look)
    other = replace(Design(), cover=replace(Design().cover, peg_mm=2.5))
    assert noted
    assert any(value_at(other, path) != value for path, value in noted.items())


def test_a_watched_design_is_one():
    design = watched(Design(), "", lambda *_: None)
    assert isinstance(design, Design)
    assert design == Design()
    assert type(replace(design, cover=replace(design.cover, floor_mm=2.0))) is Design


def _known(*changes):
    return Known(load_design("deltact", changes), (), kept=True)


def test_a_result_holds_until_what_it_read_changes():
    def found(*changes):
        known = _known(*changes)
        value = known.result("a", lambda: [known.design.z_joint_mm, known.design.cover.peg_mm])
        known.save()
        return value, known.computed

    assert found() == ([-14.0, 2.7], ["a"])
    assert found() == ([-14.0, 2.7], [])
    assert found("shell.wall_mm=2") == ([-14.0, 2.7], [])
    # The joint is where it was: thinner skin, thicker plate.
    assert found("skin.thickness_mm=11.5", "optics.acrylic_mm=2.5") == ([-14.0, 2.7], [])
    assert found("cover.peg_mm=3") == ([-14.0, 3.0], ["a"])
    assert found("optics.acrylic_mm=3") == ([-15.0, 2.7], ["a"])
    assert found("cover.peg_mm=3") == ([-14.0, 3.0], [])


def test_an_outer_result_rests_on_what_an_inner_one_read():
    def found(*changes):
        known = _known(*changes)
        value = known.result("out", lambda: known.result("in", lambda: known.design.cover.peg_mm))
        known.save()
        return value, known.computed

    assert found() == (2.7, ["out", "in"])
    # Now `in` is found and `out` is not: it must depend on the peg all the same.
    (entry,) = cache.user_folder().joinpath(KIND).iterdir()
    kept = _known()
    kept._stored.pop("out")
    kept._grown = True
    kept.save()
    assert found() == (2.7, ["out"])
    assert found("cover.peg_mm=3") == (3.0, ["out", "in"])
    assert entry.exists()


def test_what_failed_is_not_kept():
    def raising():
        raise ValueError("broken")

    known = _known()
    with pytest.raises(ValueError, match="broken"):
        known.result("a", raising)

    def spoiled():
        known.spoil()
        return 1

    assert known.result("b", lambda: known.result("c", spoiled)) == 1
    known.save()
    again = _known()
    assert [again.result(name, lambda: 2) for name in "abc"] == [2, 2, 2]


def test_a_damaged_file_and_other_code_count_as_none(monkeypatch):
    def found():
        known = _known()
        known.result("a", lambda: 1)
        known.save()
        return known.computed

    assert [found(), found()] == [["a"], []]
    (entry,) = cache.user_folder().joinpath(KIND).iterdir()
    whole = entry.read_bytes()
    for damaged in (b"", whole[:-9], whole.replace(b'"value": 1', b'"value": 2')):
        entry.write_bytes(damaged)
        assert found() == ["a"]
    assert found() == []
    monkeypatch.setattr(digest, "of", lambda *_, **_package: "other")
    assert found() == ["a"]


def test_a_check_that_declares_nothing_is_kept_by_what_it_reads():
    """No list of parts or keys: a check from elsewhere is right by itself."""

    def rows(built):
        wide = built.design.frame_outer_mm[0]
        yield check.Row("own", f"{len(built.parts)} parts", f"{wide:g}", "", wide < 41)

    own = [CheckKind("own", rows)]

    def found(listed, *changes):
        built = BuiltDesign.make(load_design("deltact", changes), None, listed, kept=True)
        table = of_built(built, checks=own)
        built.known.save()
        return table, built.known.computed

    first, ran = found(LIST)
    assert (first[0].found, first[0].passed, ran) == ("39", True, ["own"])
    assert found(LIST, "cover.peg_mm=3") == (first, [])
    wider, ran = found(LIST, "skin.width_mm=38")
    assert (wider[0].found, wider[0].passed, ran) == ("41", False, ["own"])
    assert found(IndenterList())[1] == ["own"]


def test_names_of_checks_are_their_keys():
    assert len({one.name for one in CHECKS}) == len(CHECKS)


# With the kernel.


def _ran(changes):
    """Rows and the checks that ran, with the cache."""
    built = BuiltDesign.make(load_design("deltact", changes), None, LIST, kept=True)
    rows = of_built(built)
    built.known.save()
    return rows, set(built.known.computed)


CHANGES = (
    ["cover.strain_limit=0.03"],
    ["cover.floor_mm=1.7"],
    ["light.diffuser_mm=1.8"],
    ["mold.web_mm=9"],
    ["screw.tip_clearance_mm=1.3"],
    ["skin.width_mm=37"],
    ["mount.kind=franka"],
    ["camera.measured=['focal_length_mm']"],
)


@pytest.mark.slow
def test_rows_from_the_cache_are_those_of_a_fresh_run():
    first, _ = _ran([])
    assert first == of_built(BuiltDesign.make(load_design(), None, LIST))
    for change in CHANGES:
        rows, ran = _ran(change)
        assert rows == of_built(BuiltDesign.make(load_design("deltact", change), None, LIST)), (
            change
        )
        # On the bench the one that hangs there meets whatever else has changed.
        own = [name for name in ran if not name.startswith("bench: ")]
        assert not any("indenter" in name for name in own), change
        assert ran, change
    cover = _ran(["cover.strain_limit=0.035"])[1]
    assert "wall thickness: shell" not in cover
    assert {name for name in cover if name.startswith(("box: ", "bed contact: "))} <= {
        "box: cover", "bed contact: cover"
    }  # fmt: skip
    assert not cover & {"no undercut", "mold volume closure"}
    assert _ran([]) == (first, set())
    assert _ran(CHANGES[-1])[1] == set()


@pytest.mark.slow
def test_an_unchanged_design_needs_no_kernel(folder):
    """A second process says the same without having imported cadquery."""
    code = (
        "import sys\n"
        "from deltact_fab.cad import check\n"
        "from deltact_fab.cad.design import load_design\n"
        "rows = check.run(load_design(), cached=True)\n"
        "print('cadquery' in sys.modules, rows)\n"
    )
    root = Path(__file__).parents[2]
    first, again = (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root)
        for _ in range(2)
    )
    assert first.stdout.startswith("True"), first.stderr
    assert again.stdout == first.stdout.replace("True", "False", 1)
