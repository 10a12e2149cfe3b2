"""Everything at 0.01 mm: by workers, from the cache, in one process; then by other programs."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
import trimesh
from closed_forms import tool_holder_mm3
from readers import closed_mm3, of_3mf

from deltact_fab.common import cache
from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.export import export_parts
from deltact_fab.fabricate.cad.export.part_files import EXPORT_FORMATS
from deltact_fab.fabricate.cad.part import BOUGHT_PROCESS

pytestmark = pytest.mark.slow

SCRIPT = """
import sys
from pathlib import Path
from deltact_fab.fabricate.cad import registry
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.export import export_parts
from deltact_fab.fabricate.cad.export.part_files import EXPORT_FORMATS

if __name__ == "__main__":
    out, jobs = Path(sys.argv[1]), int(sys.argv[2])
    export_parts(load_design(), registry.list_parts(), EXPORT_FORMATS, 0.01, out, jobs=jobs)
    print("cadquery" in sys.modules or "OCP" in sys.modules)
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Export everything in a process of its own: whether it loaded the kernel."""
    script = tmp_path_factory.mktemp("script") / "everything.py"
    script.write_text(SCRIPT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(cache.FOLDER_VARIABLE, str(tmp_path_factory.mktemp("store")))

        def export(*arguments):
            words = [sys.executable, str(script), *map(str, arguments)]
            done = subprocess.run(words, capture_output=True, text=True, timeout=600)
            assert done.returncode == 0, done.stderr
            return done.stdout == "True\n"

        yield export


@pytest.fixture(scope="module")
def exported(run, tmp_path_factory):
    """Folder and manifest entries of a first export by two workers."""
    folder = tmp_path_factory.mktemp("everything")
    run(folder, 2)
    return folder, json.loads((folder / "manifest.json").read_text())["files"]


def paths(folder):
    """Files below a folder, relative to it."""
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


def test_second_export_uses_cache_only(exported, run, tmp_path):
    assert not run(tmp_path, 1)
    first, second = (
        {name: (folder / name).read_bytes() for name in paths(folder)}
        for folder in (exported[0], tmp_path)
    )
    assert len(first) > 100
    assert [name for name in first if first[name] != second.get(name)] == []


def test_folder_contents_and_manifest(exported):
    folder, entries = exported
    by_file = {entry["file"]: entry for entry in entries}
    assert {*by_file, "manifest.json", "index.html"} == paths(folder)
    assert str(folder.parent) not in (folder / "manifest.json").read_text()
    for name, entry in by_file.items():
        assert entry["sha256"] == hashlib.sha256((folder / name).read_bytes()).hexdigest()
    assert {n for n in by_file if n.startswith("laser/acrylic.")} == {
        f"laser/acrylic.{k}" for k in EXPORT_FORMATS
    }
    screws = {"order/screw.step", "order/screw.glb"}
    assert {n for n in by_file if n.startswith("order/screw.")} == screws
    assert by_file["order/screw.step"]["quantity"] == 4
    assert by_file["order/screw.step"]["mesh_deviation_mm"] is None
    low, high = by_file["assembly/assembly.glb"]["bounding_box_mm"]
    size_mm = [b - a for a, b in zip(low, high, strict=True)]
    assert size_mm == pytest.approx(load_design().outer_mm)


def test_bytes_are_independent_of_order(exported, tmp_path):
    """A part's STEP must not depend on whether it was meshed or drawn before."""
    parts = registry.select_parts(["star", "sensor"])[::-1]
    for kinds in (EXPORT_FORMATS[:1], EXPORT_FORMATS[4:], EXPORT_FORMATS[1:4]):
        some = tmp_path / kinds[0]
        export_parts(load_design(), parts, kinds, 0.01, some, cached=False, jobs=1)
        for name in paths(some) - {"manifest.json", "index.html"}:
            assert (some / name).read_bytes() == (exported[0] / name).read_bytes(), name


@pytest.mark.skipif(shutil.which("ps") is None, reason="ps is not installed (procps)")
@pytest.mark.parametrize("end", ["group", "worker"])
def test_stopped_export_and_killed_worker(tmp_path, end):
    """As a terminal stops it, the whole group; as the kernel ends one when memory runs out."""
    script = f"""
import signal, sys
from pathlib import Path
from deltact_fab.fabricate.cad import export
# A shell starts what it puts in the background, this test perhaps, with Ctrl-C ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
export.MIN_SHARED_TASKS = 2
export.count_workers = lambda: 2
from deltact_fab.app.cli.main import entry
sys.argv = ["deltact-fab", "cad", "export", "sensor", "--out", {str(tmp_path / "o")!r}]
entry()
"""
    with subprocess.Popen(
        [sys.executable, "-c", script], stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "DELTACT_FAB_CACHE": str(tmp_path / "none")},
    ) as process:  # fmt: skip
        try:
            started = time.monotonic()
            while len(workers := _workers(process.pid)) < 2:
                assert time.monotonic() - started < 120
                time.sleep(0.1)
            time.sleep(2)
            if end == "group":
                os.killpg(process.pid, signal.SIGINT)
            else:
                os.kill(workers[0], signal.SIGKILL)
            _, errors = process.communicate(timeout=300)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert not _workers(process.pid)
    if end == "group":
        assert (errors.splitlines()[-1], process.returncode) == ("deltact-fab: stopped", 130)
        assert not (tmp_path / "o").exists()
    else:
        assert process.returncode == 0
        assert all(line.startswith("cad export: ") for line in errors.splitlines())
        listed = json.loads((tmp_path / "o/manifest.json").read_text())["files"]
        assert {one["file"] for one in listed} < paths(tmp_path / "o")


def _workers(group):
    """Living worker processes of a process group."""
    listed = subprocess.run(
        ["ps", "-ww", "-eo", "pid=,pgid=,stat=,args="], capture_output=True, text=True, check=True
    ).stdout
    rows = [line.split(maxsplit=3) for line in listed.splitlines()]
    return [
        int(pid)
        for pid, pgid, state, command in rows
        if int(pgid) == group and state[0] != "Z" and "spawn_main" in command
    ]


def test_rebuilt_part_is_bitwise_equal():
    """The kernel may choose by memory address which of two ends that meet it keeps."""
    from OCP.BRepTools import BRepTools

    from deltact_fab.fabricate.cad.build import build_part

    varied = []
    for part in registry.list_parts():
        written = set()
        for _ in range(3):
            stream = io.BytesIO()
            BRepTools.Write_s(build_part(part, load_design())[0].wrapped, stream)
            written.add(stream.getvalue())
        if len(written) > 1:
            varied.append(part.name)
    assert varied == []


def slack_mm3(entry):
    """1e-6 of the volume; where two cylinders cross, what the closed form leaves the kernel."""
    slack = 1e-6 * entry["volume_mm3"]
    if entry["part"] == "tool-holder":
        low, high = tool_holder_mm3(load_design())
        slack = max(slack, high - low)
    return slack


def test_step_files_reimport_with_volume(exported):
    import cadquery as cq

    folder, entries = exported
    read = [entry for entry in entries if entry["file"].endswith(".step")]
    assert len(read) == len(registry.list_parts()) + 1
    for entry in read:
        solids = cq.importers.importStep(str(folder / entry["file"])).solids().vals()
        copies = 1
        if entry["part"] == "assembly":
            copies = sum(part.quantity for part in registry.parts_of_group("sensor"))
        assert len(solids) == copies, entry["file"]
        assert all(solid.isValid() for solid in solids)
        volume_mm3 = sum(solid.Volume() for solid in solids)
        slack = slack_mm3(entry)
        assert volume_mm3 == pytest.approx(entry["volume_mm3"], abs=slack), entry["file"]


def test_every_mesh_is_closed(exported):
    folder, entries = exported
    read = 0
    for entry in entries:
        data = (folder / entry["file"]).read_bytes()
        if entry["file"].endswith(".stl"):
            mesh = trimesh.load(io.BytesIO(data), file_type="stl")
            vertices, triangles = mesh.vertices, mesh.faces
        elif entry["file"].endswith(".3mf"):
            vertices, triangles = of_3mf(data)[2:]
            mesh = trimesh.Trimesh(vertices, triangles, process=False)
        else:
            continue
        read += 1
        assert mesh.is_watertight, entry["file"]
        assert mesh.is_winding_consistent
        assert mesh.body_count == 1
        slack_mm3 = mesh.area * entry["mesh_deviation_mm"] + 1e-6 * entry["volume_mm3"]
        assert mesh.volume == pytest.approx(entry["volume_mm3"], abs=slack_mm3), entry["file"]
        assert closed_mm3(vertices, triangles) == pytest.approx(mesh.volume, rel=1e-4)
        assert 0 <= entry["mesh_deviation_mm"] <= 0.01
    printed = [part for part in registry.list_parts() if part.process != BOUGHT_PROCESS]
    assert read == 2 * len(printed)


def _said(*command, cwd):
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, timeout=300, check=False,
        text=True, errors="replace",  # admesh ends its table with bytes of no encoding
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.skipif(shutil.which("admesh") is None, reason="admesh is not installed")
def test_admesh_finds_nothing_to_repair(exported, tmp_path):
    folder, entries = exported
    for entry in (entry for entry in entries if entry["file"].endswith(".stl")):
        said = _said("admesh", str(folder / entry["file"]), cwd=tmp_path)
        counted = {
            label.strip(): int(number.split()[0])
            for line in said.splitlines()
            for label, colon, number in [line.partition(":")]
            if colon and number.split() and number.split()[0].isdigit()
        }
        assert counted["Number of parts"] == 1, entry["file"]
        for fault in (
            "Total disconnected facets", "Degenerate facets", "Edges fixed", "Facets removed",
            "Facets added", "Facets reversed", "Backwards edges",
        ):  # fmt: skip
            assert counted[fault] == 0, (entry["file"], said)


# What PrusaSlicer 2.5 says while it slices for a resin printer and is content.
CONTENT = re.compile(r" *\d+% ?=> |\[.*\[trace\]|Slicing result exported to |$")


@pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="prusa-slicer is not installed")
@pytest.mark.parametrize(
    "name", ["shell", "indenter-star", pytest.param("mold", marks=pytest.mark.evidence)]
)
def test_prusa_slicer_slices_without_warning(exported, tmp_path, name):
    """With its own supports, on the printer's platform."""
    printer = load_design().resin_printer
    x, y = printer.bed_x_mm, printer.bed_y_mm
    bed = ["--bed-shape", f"0x0,{x:g}x0,{x:g}x{y:g},0x{y:g}"]
    bed += ["--display-width", f"{x:g}", "--display-height", f"{y:g}", "--max-print-height", "175"]
    told = _said(
        "prusa-slicer", "--export-sla", "--printer-technology", "SLA", *bed,
        "--output", str(tmp_path / "part.sl1"), str(exported[0] / f"print/{name}.3mf"),
        cwd=tmp_path,
    )  # fmt: skip
    assert [line for line in told.splitlines() if not CONTENT.match(line)] == []
    assert "Slicing result exported" in told
