"""Files: bytes, meshes, the manifest, names and the command line."""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys
import time

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from deltact_fab.cad import registry
from deltact_fab.cad.export import FORMATS, build_part, export_parts
from deltact_fab.cad.mesh import is_closed, mesh_solid
from deltact_fab.cad.parts import skin_frame
from deltact_fab.cli.cad import cad
from deltact_fab.errors import InputError, RunFailed
from deltact_fab.shapes import SensorDimensions
from deltact_fab.shapes.sensor import FrameDimensions

DIMS = SensorDimensions()
DEFAULT_PARTS = ["skin-frame", "skin", "indenter-sphere-10", "indenter-4dots"]


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """A default export of this process: (folder, files, progress calls)."""
    folder = tmp_path_factory.mktemp("cad") / "new" / "out"
    calls = []
    files = export_parts(
        DIMS, registry.select([]), FORMATS, 0.01, folder, lambda *call: calls.append(call)
    )
    return folder, files, calls


def _run(*args, cwd, hook=""):
    code = f"import sys\n{hook}\nfrom deltact_fab.cli.main import entry\nentry()"
    return subprocess.run(
        [sys.executable, "-c", code, *args],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_two_processes_write_the_same_bytes(exported, tmp_path):
    folder, files, _ = exported
    # Reversed, so that the kernel's counters stand elsewhere when a part's turn comes.
    done = _run("cad", "export", *reversed(DEFAULT_PARTS), "--out", "o", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = {entry["file"]: entry for entry in json.loads(done.stdout)}
    assert len(theirs) == len(files) == 8
    for mine in files:
        assert (folder / mine.file).read_bytes() == (tmp_path / "o" / mine.file).read_bytes()
        assert theirs[mine.file]["sha256"] == mine.sha256
        assert theirs[mine.file]["mesh_deviation_mm"] == mine.mesh_deviation_mm


def test_the_folder_holds_the_files_and_a_manifest_without_times_or_paths(exported):
    folder, files, calls = exported
    text = (folder / "manifest.json").read_text()
    entries = json.loads(text)["files"]
    assert {p.name for p in folder.iterdir()} == {e["file"] for e in entries} | {"manifest.json"}
    assert str(folder.parent) not in text
    for entry, file in zip(entries, files, strict=True):
        assert entry["sha256"] == hashlib.sha256((folder / file.file).read_bytes()).hexdigest()
        assert entry["quantity"] == 1
    assert calls[0] == (0, 4, "skin-frame")
    assert calls[-1] == (4, 4, "done")


@pytest.mark.parametrize("name", DEFAULT_PARTS)
def test_step_comes_back_with_its_volume_and_name(exported, name):
    import cadquery as cq

    folder, files, _ = exported
    written = next(f for f in files if f.file == f"{name}.step")
    back = cq.importers.importStep(str(folder / written.file)).val()
    assert back.isValid()
    assert back.Volume() == pytest.approx(written.volume_mm3, rel=1e-6)
    text = (folder / written.file).read_text()
    assert f"PRODUCT('{name}','{name}'" in text
    assert "1970-01-01T00:00:00" in text


@pytest.mark.parametrize("name", DEFAULT_PARTS)
def test_stl_is_watertight_as_written(exported, name):
    folder, files, _ = exported
    written = next(f for f in files if f.file == f"{name}.stl")
    mesh = trimesh.load(io.BytesIO((folder / written.file).read_bytes()), file_type="stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    slack_mm3 = mesh.area * written.mesh_deviation_mm + 1e-6 * written.volume_mm3
    assert mesh.volume == pytest.approx(written.volume_mm3, abs=slack_mm3)
    assert np.allclose(mesh.bounds, written.bounding_box_mm, atol=1e-5 + written.mesh_deviation_mm)
    assert 0 < written.mesh_deviation_mm <= 0.01


def test_every_listed_indenter_is_exported_watertight_in_half_a_minute(tmp_path):
    parts = [part for part in registry.listed() if part.indenter is not None]
    assert len(parts) == 11
    started = time.perf_counter()
    files = export_parts(DIMS, parts, FORMATS, 0.01, tmp_path)
    assert time.perf_counter() - started < 30
    for written in files:
        if written.file.endswith(".stl"):
            data = io.BytesIO((tmp_path / written.file).read_bytes())
            mesh = trimesh.load(data, file_type="stl")
            assert mesh.is_watertight, written.part
            assert mesh.body_count == 1
            assert 0 < written.mesh_deviation_mm <= 0.01


def test_the_deviation_is_that_of_the_sphere():
    """Against distances in closed form on 231 points of every triangle of sphere and cylinders."""
    solid, _ = build_part(registry.find("sphere:10"), DIMS)
    mesh = mesh_solid(solid, 0.05, "indenter")
    n = 20
    grid = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    points = np.einsum("sc,mcx->msx", grid, mesh.corners_mm)
    z = mesh.corners_mm[:, :, 2]
    r = np.hypot(mesh.corners_mm[:, :, 0], mesh.corners_mm[:, :, 1])
    cap = (z <= 5.0 + 1e-5).all(axis=1)
    worst = np.abs(np.linalg.norm(points[cap] - (0, 0, 5.0), axis=2) - 5.0).max()
    flat = np.ptp(z, axis=1) < 1e-6
    for radius in (5.0, 3.0):
        side = ~cap & ~flat & (np.abs(r - radius) < 1e-4).all(axis=1)
        assert side.any()
        worst = max(worst, np.abs(np.hypot(*points[side].T[:2]) - radius).max())
    assert mesh.deviation_mm == pytest.approx(worst, rel=0.02)
    assert mesh.deviation_mm <= 0.05


def test_a_coarse_mesh_after_a_fine_one_is_coarse():
    solid, _ = build_part(registry.find("sphere:10"), DIMS)
    fine = mesh_solid(solid, 0.005, "indenter")
    coarse = mesh_solid(solid, 0.1, "indenter")
    assert len(coarse.triangles) < len(fine.triangles) / 2
    assert coarse.deviation_mm > fine.deviation_mm


def test_an_open_mesh_is_seen():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assert is_closed(tetrahedron)
    assert not is_closed(tetrahedron[:3])
    assert not is_closed(tetrahedron[[0, 1, 2, 3, 3]])
    flipped = tetrahedron.copy()
    flipped[0] = flipped[0, ::-1]
    assert not is_closed(flipped)


def test_bad_dimensions_of_any_part_write_nothing(tmp_path):
    dims = SensorDimensions(frame=FrameDimensions(height_mm=7.0))
    chosen = registry.select(["skin", "skin-frame"])
    with pytest.raises(InputError, match="skin-frame"):
        export_parts(dims, chosen, FORMATS, 0.01, tmp_path / "o")
    assert not (tmp_path / "o").exists()


def test_a_part_that_fails_late_leaves_the_folder_as_it_was(tmp_path, monkeypatch):
    build = skin_frame.build

    def three_pilots(dims):
        monkeypatch.setattr(
            skin_frame, "hole_centres_mm", lambda dims: [(16.3, 16.8), (-16.3, 16.8), (0.0, 99.0)]
        )
        return build(dims)

    monkeypatch.setattr(skin_frame, "build", three_pilots)
    (tmp_path / "skin.stl").write_text("yesterday's")
    with pytest.raises(RunFailed, match=r"^skin-frame: "):
        export_parts(DIMS, registry.select(["skin", "skin-frame"]), FORMATS, 0.01, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["skin.stl"]
    assert (tmp_path / "skin.stl").read_text() == "yesterday's"


@pytest.mark.parametrize(
    ("formats", "tolerance_mm", "says"),
    [
        (["stp"], 0.01, "format 'stp': unknown; did you mean 'step'"),
        ([], 0.01, "format: none given; valid: step, stl"),
        (["stl"], 0.0, "tolerance 0 mm: 0.001 to 1 mm is right"),
        (["stl"], float("nan"), "tolerance nan mm"),
    ],
)
def test_arguments_are_refused_in_one_line(tmp_path, formats, tolerance_mm, says):
    with pytest.raises(InputError, match=says):
        export_parts(DIMS, registry.select(["skin"]), formats, tolerance_mm, tmp_path / "o")
    assert not (tmp_path / "o").exists()


def test_a_file_in_the_folder_s_place_is_refused(tmp_path):
    (tmp_path / "o").write_text("")
    with pytest.raises(InputError, match="cannot be a folder"):
        export_parts(DIMS, registry.select(["skin"]), FORMATS, 0.01, tmp_path / "o")


@pytest.mark.parametrize(
    ("typed", "part"),
    [
        ("4dots", "indenter-4dots"),
        ("sphere:10", "indenter-sphere-10"),
        ("sphere:12.5", "indenter-sphere-12p5"),
        ("indenter-sphere-12p5", "indenter-sphere-12p5"),
        ("indenter-sphere-12.50", "indenter-sphere-12p5"),
        ("star", "indenter-star"),
        ("indenter-star", "indenter-star"),
        ("star:9", "indenter-star"),
        ("edges:7.5", "indenter-edges-7p5"),
        ("indenter-edges-7p5", "indenter-edges-7p5"),
        ("2dots", "indenter-2dots"),
    ],
)
def test_indenters_go_by_the_protocol_s_name_or_the_file_s(typed, part):
    assert registry.find(typed).name == part


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        ("skinframe", "part 'skinframe': unknown; did you mean 'skin-frame'?"),
        ("lens", "part 'lens': unknown; valid: 2dots, 4dots, edges, "),
        ("indenter-sta", "part 'indenter-sta': unknown; did you mean 'indenter-star'?"),
        ("elipsoid", "did you mean 'ellipsoid'?"),
        ("indenter-sphere-99", "diameter of 0.5 to 30 mm"),
        ("star:99", "5 to 20 mm"),
        ("star:", "part 'star:': unknown"),
        ("sphere:", "part 'sphere:': unknown"),
    ],
)
def test_an_unknown_part_is_named_with_the_nearest(tmp_path, typed, says):
    result = CliRunner().invoke(cad, ["export", typed, "--out", str(tmp_path / "o")])
    assert isinstance(result.exception, InputError)
    assert says in str(result.exception)
    assert not (tmp_path / "o").exists()


def test_a_part_named_twice_is_exported_once():
    assert [p.name for p in registry.select(["skin", "skin"])] == ["skin"]


def test_list_prints_every_part_as_json():
    result = CliRunner().invoke(cad, ["list", "--json"])
    assert result.exit_code == 0
    parts = json.loads(result.stdout)
    assert [p["part"] for p in parts if p["default"]] == DEFAULT_PARTS
    assert {p["part"] for p in parts} >= {f"indenter-sphere-{d}" for d in (10, 12, 15, 18, 22)}
    paper = ("4dots", "2dots", "edges", "ellipsoid", "hexprism", "star")
    assert {p["part"] for p in parts} >= {f"indenter-{name}" for name in paper}
    assert all(p["material"] and p["process"] for p in parts)


def test_list_does_not_load_the_kernel(tmp_path):
    hook = "import atexit; atexit.register(lambda: print('cadquery' in sys.modules))"
    done = _run("cad", "list", cwd=tmp_path, hook=hook)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "False"


BROKEN = """
class NoGL:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == "OCP":
            raise ImportError(
                "libGL.so.1: cannot open shared object file: No such file or directory"
            )
sys.meta_path.insert(0, NoGL())
"""


def test_a_missing_system_library_is_one_line_that_says_what_to_install(tmp_path):
    done = _run("cad", "export", "skin", "--out", "o", cwd=tmp_path, hook=BROKEN)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == (
        "deltact-fab: cadquery needs libGL.so.1: apt-get install libgl1 libegl1 libx11-6\n"
    )
    assert not (tmp_path / "o").exists()


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_mm", [0.1, 0.05, 0.02, 0.01, 0.005])
def test_the_tolerance_holds_on_the_largest_sphere(tolerance_mm):
    solid, _ = build_part(registry.find("sphere:22"), DIMS)
    assert mesh_solid(solid, tolerance_mm, "indenter").deviation_mm <= tolerance_mm
