"""Files: bytes, the manifest, the cache, names and what goes wrong."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.cad import cad
from deltact_fab.common import Check, cache
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.fabricate.cad import export as batch
from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.check.verdict import DesignVerdict
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.drafting.wiring import wiring
from deltact_fab.fabricate.cad.export import export_parts, file_cache_key, part_files
from deltact_fab.fabricate.cad.export.part_files import DRAWING_FORMATS, EXPORT_FORMATS
from deltact_fab.fabricate.cad.parts import skin_frame
from deltact_fab.sensor.shapes.sensor import FrameDimensions

DESIGN = load_design()
THICK = load_design(changes=["optics.acrylic_mm=3"])
KINDS = ("step", "stl", "3mf", "dxf", "glb")
PASSED = DesignVerdict("mine", (Check("a", value="1", limit="2"),))
SENSOR = [part.name for part in registry.parts_of_group("sensor")]


@pytest.fixture(scope="session", autouse=True)
def store_of_its_own(tmp_path_factory):
    """No test reads what another run left in the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(cache.FOLDER_VARIABLE, str(tmp_path_factory.mktemp("store")))
        yield


@pytest.fixture(scope="module")
def exported(tmp_path_factory, store_of_its_own):
    """The acrylic in every format that has no page, and its files in the cache."""
    folder = tmp_path_factory.mktemp("cad") / "new" / "out"
    _export(["acrylic"], KINDS, folder, jobs=1)
    return folder


def _export(names, kinds, folder, **options):
    return export_parts(DESIGN, registry.select_parts(names), kinds, 0.01, folder, **options)


def test_assembly_needs_whole_sensor(tmp_path):
    names = {f.file for f in _export(SENSOR[1:], ["glb"], tmp_path, judge=lambda: PASSED)}
    assert {Path(name).name for name in names} == {f"{name}.glb" for name in SENSOR[1:]}


@pytest.mark.slow
def test_wiring_is_exported_with_sensor(tmp_path, store_of_its_own):
    files = {f.file: f for f in _export(["sensor"], ["svg", "pdf"], tmp_path / "a")}
    assert {"assembly/wiring.svg", "assembly/wiring.pdf"} <= set(files)
    assert "assembly/assembly.step" not in files
    page = wiring(DESIGN)
    assert (tmp_path / "a" / "assembly" / "wiring.svg").read_text() == page.svg()
    assert (tmp_path / "a" / "assembly" / "wiring.pdf").read_bytes() == page.pdf()
    again = {f.file: f for f in _export(["sensor"], ["svg", "pdf"], tmp_path / "b")}
    assert again == files
    some = _export(["acrylic", "led-strip"], ["svg", "dxf"], tmp_path / "c")
    assert {f.file for f in some} == {"laser/acrylic.svg", "laser/acrylic.dxf"}


def test_applicable_formats():
    everything = tuple(kind for kind in EXPORT_FORMATS if kind not in DRAWING_FORMATS)
    parts = [registry.find_part(name) for name in ("acrylic", "mold", "screw", "led-strip")]
    formats = [part_files.part_formats(part, everything) for part in parts]
    assert formats == [everything, ("step", "stl", "3mf", "glb"), ("step", "glb"), ("step", "glb")]


def test_inapplicable_format_is_refused(tmp_path):
    with pytest.raises(InputError, match="format dxf: applies to none of mold, skin"):
        _export(["mold", "skin"], ["dxf"], tmp_path / "o")
    assert not (tmp_path / "o").exists()


# The cache.


def test_cached_export_is_identical(exported, tmp_path, monkeypatch):
    def made(*_):
        raise AssertionError("it was made again")

    monkeypatch.setattr(batch, "make", made)
    calls = []
    _export(["acrylic"], KINDS, tmp_path / "o", progress=lambda *call: calls.append(call), jobs=1)
    assert calls == [(1, 1, "cache"), (1, 1, "done")]
    assert _bytes(tmp_path / "o") == _bytes(exported)
    with pytest.raises(AssertionError, match="made again"):
        export_parts(
            THICK,
            registry.select_parts(["acrylic"]),
            ["step"],
            0.01,
            tmp_path,
            judge=lambda: PASSED,
        )


def test_damaged_entries_are_made_again(exported, tmp_path):
    folder = cache.cache_folder() / "cad"
    entries = sorted(folder.iterdir())
    kept = {path: path.read_bytes() for path in entries}
    for path, data in kept.items():
        # One bit of the file itself, past the line that describes it.
        middle = (data.index(b"\n") + len(data)) // 2
        path.write_bytes(data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :])
    _export(["acrylic"], KINDS, tmp_path)
    for path in tmp_path.glob("laser/acrylic.*"):
        assert path.read_bytes() == (exported / "laser" / path.name).read_bytes()
    healed = [path for path, data in kept.items() if path.read_bytes() == data]
    assert len(healed) == len(KINDS)
    for path, data in kept.items():
        path.write_bytes(data)


def test_unwritable_or_disabled_cache_is_ignored(exported, tmp_path, monkeypatch):
    (tmp_path / "store").write_text("a file in the way")
    for store, cached in (("store", True), ("absent", False)):
        monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / store))
        _export(["acrylic"], ["step"], tmp_path / "o", cached=cached)
        step = (tmp_path / "o" / "laser" / "acrylic.step").read_bytes()
        assert step == (exported / "laser" / "acrylic.step").read_bytes()
    assert not (tmp_path / "absent").exists()


WIDE, ISSUED = (
    load_design(changes=["skin.width_mm=37"]),
    load_design(changes=["drawing.revision=B"]),
)


@pytest.mark.parametrize(
    ("part", "kind", "other", "same"),
    [
        ("skin", "step", {}, True),
        ("skin", "step", {"tolerance_mm": 0.02}, True),
        ("skin", "step", {"kind": "stl"}, False),
        ("skin", "step", {"design": WIDE}, False),
        ("skin", "step", {"part": "skin-frame"}, False),
        ("sphere:10", "stl", {"design": WIDE}, True),
        ("sphere:10", "stl", {"tolerance_mm": 0.02}, False),
        # A new title makes new drawings and nothing else.
        ("cover", "step", {"design": ISSUED}, True),
        ("cover", "pdf", {"design": ISSUED}, False),
    ],
)
def test_what_a_file_is_found_by(part, kind, other, same):
    asked = {"design": DESIGN, "tolerance_mm": 0.01, "part": part, "kind": kind}
    keys = []
    for design, tolerance_mm, name, form in (asked.values(), {**asked, **other}.values()):
        task = part_files.ExportTask((registry.find_part(name),), (form,), design, tolerance_mm)
        keys.append(file_cache_key(task, form))
    assert (keys[0] == keys[1]) == same


# What goes wrong.


def test_bad_dimensions_write_nothing(tmp_path):
    design = Design(frame=FrameDimensions(seat_y_mm=3.0))
    with pytest.raises(InputError, match="skin-frame"):
        export_parts(
            design, registry.select_parts(["skin", "skin-frame"]), KINDS, 0.01, tmp_path / "o"
        )
    assert not (tmp_path / "o").exists()


def test_late_failure_leaves_folder_unchanged(tmp_path, monkeypatch):
    def shifted(design):
        return skin_frame.build(design).translate((0.0, 0.0, 0.1))

    parts = (dataclasses.replace(skin_frame.SKIN_FRAME, build=shifted), *skin_frame.PARTS[1:])
    monkeypatch.setattr(skin_frame, "PARTS", parts)
    export_parts(DESIGN, registry.select_parts(["skin"]), ["stl"], 0.1, tmp_path)
    yesterdays = _bytes(tmp_path)
    for folder in (tmp_path, tmp_path / "new" / "one"):
        with pytest.raises(RunFailed, match="skin-frame: bounding box"):
            _export(["skin", "skin-frame"], ["stl"], folder, cached=False)
    assert _bytes(tmp_path) == yesterdays
    assert set(yesterdays) == {"assembly/skin.stl", "manifest.json", "index.html"}


# A folder that holds something already.


def _bytes(folder):
    """What a folder holds, by path."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def _listed(folder):
    """Names and digests by the manifest."""
    entries = json.loads((folder / "manifest.json").read_text())["files"]
    return {entry["file"]: entry["sha256"] for entry in entries}


def test_stale_files_go_changed_stay(tmp_path):
    _export(["acrylic", "cover", "skin"], ["step"], tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "print" / "cover.step").write_text("mine now")
    _export(["acrylic"], ["dxf"], tmp_path)
    assert set(_listed(tmp_path)) == {"laser/acrylic.dxf"}
    left = {"laser/acrylic.dxf", "print/cover.step", "manifest.json", "index.html", "notes.txt"}
    assert set(_bytes(tmp_path)) == left
    beside = tmp_path.parent / "x"
    beside.write_text("")
    digest = sha256(b"").hexdigest()
    (tmp_path / "manifest.json").write_text(
        f'{{"files": [{{"file": "../x", "sha256": "{digest}"}}]}}'
    )
    _export(["cover"], ["step"], tmp_path)
    assert beside.exists()
    assert set(_bytes(tmp_path)) == left
    assert (tmp_path / "print" / "cover.step").read_bytes() != b"mine now"


def test_folder_in_place_of_file_fails(tmp_path):
    _export(["acrylic", "cover"], ["step"], tmp_path)
    (tmp_path / "laser" / "acrylic.dxf").mkdir()
    before = _bytes(tmp_path)
    with pytest.raises(RunFailed, match=r"acrylic\.dxf: cannot be written: Is a directory"):
        _export(["acrylic"], ["step", "dxf"], tmp_path)
    assert _bytes(tmp_path) == before


# Designs that fail.


TIGHT = load_design(changes=["plate.fit_mm=0.02"])


def test_failing_design_needs_force(tmp_path):
    parts = registry.select_parts(["acrylic"])
    with pytest.raises(RunFailed, match=r"4/\d+ checks failed; --force .* plate in its pocket"):
        export_parts(TIGHT, parts, ["svg"], 0.01, tmp_path / "o")
    assert not (tmp_path / "o").exists()
    export_parts(TIGHT, parts, ["svg"], 0.01, tmp_path / "o", force=True)
    written = _bytes(tmp_path / "o")
    marked = ("index.html", "laser/acrylic.svg", "NOT-TO-BE-BUILT.txt")
    assert all(b"NOT TO BE BUILT" in written[name] for name in marked)
    assert json.loads(written["manifest.json"])["verdict"].startswith("NOT TO BE BUILT: design: 4/")
    export_parts(DESIGN, parts, ["svg"], 0.01, tmp_path / "o")
    mended = _bytes(tmp_path / "o")
    assert "NOT-TO-BE-BUILT.txt" not in mended
    assert not any(b"NOT TO BE BUILT" in data for data in mended.values())
    assert b"run `cad check` for the whole" in mended["index.html"]


def test_solids_of_exported_parts_count(tmp_path):
    thin = load_design(changes=["light.diffuser_mm=0.5"])
    with pytest.raises(RunFailed, match=r"wall thickness, light-holder: 0.500 mm"):
        export_parts(thin, registry.select_parts(["light-holder"]), ["svg"], 0.01, tmp_path / "o")
    export_parts(thin, registry.select_parts(["acrylic"]), ["svg"], 0.01, tmp_path / "o")


def test_whole_export_is_an_order(tmp_path):
    parts = registry.select_parts(["acrylic", "screw", "stage-plate"])
    export_parts(DESIGN, parts, ["step"], 0.01, tmp_path, judge=lambda: PASSED)
    written = _bytes(tmp_path)
    folders = {"laser/acrylic.step", "order/screw.step", "machine/stage-plate.step"}
    assert folders <= set(written)
    _, head, *lines = written["order/bom.csv"].decode().splitlines()
    assert head.startswith("0,verdict,cad check")
    assert "1/1 checks passed" in head
    assert len(lines) > 40
    page = written["index.html"].decode()
    assert page.index("mine: 1/1 checks passed") < page.index("laser/acrylic.step")
    assert 'href="order/bom.csv"' in page


def test_ctrl_c_leaves_nothing(tmp_path, monkeypatch):
    def typed(done, total, what):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _export(["acrylic", "skin"], ["step"], tmp_path / "o", progress=typed, cached=False)
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("formats", "tolerance_mm", "jobs", "says"),
    [
        (["stp"], 0.01, None, "format 'stp': unknown; did you mean 'step'"),
        ([], 0.01, None, "format: none given; valid: step, stl, 3mf, dxf, glb, svg, pdf"),
        (["stl"], 0.0, None, "tolerance 0 mm: expected 0.001 to 1 mm"),
        (["stl"], 0.01, 0, "jobs 0: expected 1 or more"),
    ],
)
def test_arguments_are_refused_in_one_line(tmp_path, formats, tolerance_mm, jobs, says):
    parts = registry.select_parts(["skin"])
    with pytest.raises(InputError, match=says):
        export_parts(DESIGN, parts, formats, tolerance_mm, tmp_path / "o", jobs=jobs)
    assert not (tmp_path / "o").exists()


def test_invalid_output_folder_is_refused(tmp_path):
    (tmp_path / "o").write_text("")
    with pytest.raises(InputError, match="is a file, not a folder"):
        _export(["skin"], ["step"], tmp_path / "o")


@pytest.mark.parametrize(
    ("typed", "part"),
    [
        ("4dots", "indenter-4dots"),
        ("sphere:10", "indenter-sphere-10"),
        ("sphere:12.5", "indenter-sphere-12p5"),
        ("star:9", "indenter-star"),
        ("indenter-star", "indenter-star"),
    ],
)
def test_indenter_names_of_protocol_and_list(typed, part):
    assert registry.find_part(typed).name == part


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        ("skinframe", "part 'skinframe': unknown; did you mean 'skin-frame'?"),
        ("qqq", "part 'qqq': unknown; valid: 2dots, 4dots, acrylic, bench, "),
        ("sphere:99", "diameter of 0.5 to 30 mm"),
    ],
)
def test_unknown_part_suggests_nearest(tmp_path, typed, says):
    result = CliRunner().invoke(cad, ["export", typed, "--out", str(tmp_path / "o")])
    assert isinstance(result.exception, InputError)
    assert says in str(result.exception)
    assert not (tmp_path / "o").exists()


BROKEN = """
import sys
class NoGL:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "OCP":
            raise ImportError(
                "libGL.so.1: cannot open shared object file: No such file or directory"
            )
sys.meta_path.insert(0, NoGL())
from deltact_fab.app.cli.main import entry
entry()
"""


INSTALL = (
    "apt-get install --reinstall libgl1 libegl1 libx11-6, or pip install --force-reinstall cadquery"
)


@pytest.mark.slow
def test_missing_system_library_says_remedy(tmp_path):
    words = ["cad", "export", "mold", "--out", "o"]
    done = subprocess.run(
        [sys.executable, "-c", BROKEN, *words], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    said = "libGL.so.1: cannot open shared object file: No such file or directory"
    assert done.stderr == f"deltact-fab: cadquery cannot be imported ({said}): {INSTALL}\n"
    assert not (tmp_path / "o").exists()
