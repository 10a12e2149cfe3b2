"""The demo as a newcomer meets it, its figures, and the parts without the CAD kernel."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PROGRAM = (sys.executable, "-m", "deltact_fab.app.cli.main")
# Both in a mount namespace of their own, which ends with the process: nothing else sees it.
# A file of no bytes stands for a broken library; a layer without it, for a missing one.
HIDE = {
    "broken": 'mount --bind /dev/null "$file"',
    "missing": """
mount -t tmpfs none "$1" && mkdir "$1/upper" "$1/work" &&
mount -t overlay -o "lowerdir=${file%/*},upperdir=$1/upper,workdir=$1/work" none "${file%/*}" &&
rm "$file"
""",
}
NOT_PERMITTED = 77
HIDDEN = """
file=$(realpath "$0")
{{ {hide}
}} || exit {not_permitted}
shift
exec "$@"
"""


def test_demo_makes_all_files(demo: Path) -> None:
    made = {f["file"] for f in json.loads((demo / "cad" / "manifest.json").read_text())["files"]}
    assert {"assembly/assembly.step", "assembly/assembly.glb", "assembly/skin.stl"} <= made
    assert {"print/shell.3mf", "laser/acrylic.dxf", "print/cover.svg", "order/screw.step"} <= made
    assert all((demo / "cad" / name).stat().st_size > 1000 for name in made)
    assert (demo / "pattern" / "dense-with-dots.png").stat().st_size > 10_000
    page = (demo / "report.html").read_text()
    assert "simulated" in page
    assert json.loads((demo / "demo.json").read_text())["finished"] is True


def test_the_demo_measures_what_it_claims(demo: Path) -> None:
    tracking = json.loads((demo / "run" / "analysis" / "tracking.json").read_text())
    methods = {row["name"]: row for row in tracking["methods"]}
    assert tracking["verdict"]["take"] == "fused"
    assert methods["fused"]["mean_off_dots_mm"] <= 0.004
    assert methods["fused"]["mean_confident_mm"] <= 0.003
    assert tracking["dots"]["mean_vs_truth_mm"] <= 0.01
    rows = [row for row in tracking["by_indenter"] if row["name"] == "fused"]
    assert {row["indenter"] for row in rows} == {"sphere:20", "sphere:22"}
    for row in rows:  # something moved far enough for an error to mean anything
        assert row["peak_true_mm"] >= 0.5, row["indenter"]


def test_demo_report_has_all_results(demo: Path) -> None:
    """Judged on indenters and a noise that the calibration never saw."""
    shape = json.loads((demo / "run" / "analysis" / "shape.json").read_text())
    assert shape["contact_by"] == "traction"
    assert set(shape["by_indenter"]) == {"sphere:20", "sphere:22"}
    for name, means in shape["by_indenter"].items():
        assert means["frames"] == 10, name
        assert means["depth_error_contact_mm"] <= 0.25 * means["zero_error_contact_mm"], name
        assert means["centroid_error_mm"] <= 0.3, name
        assert means["contact_iou"] >= 0.7, name
    runs = [json.loads((demo / run / "run.json").read_text()) for run in ("run", "calibration")]
    assert runs[0]["seed"] != runs[1]["seed"]
    assert not set(runs[0]["protocol"]["indenters"]) & set(runs[1]["protocol"]["indenters"])
    page = (demo / "report.html").read_text()
    (off,) = re.findall(
        r"Force from the flow by &#39;inverse-placed&#39;, (\d+) frames: RMS error "
        r"([.\d]+) N normal, ([.\d]+) and ([.\d]+) N shear", page
    )  # fmt: skip
    assert int(off[0]) >= 30
    assert float(off[1]) <= 0.12  # of 6 N
    assert max(float(off[2]), float(off[3])) <= 0.04  # of 1.9 N
    assert '<div class="verdict pass">' in page  # nothing in its own scene deserves a warning
    for words in ("Shape and contact at the deepest press", "Shape and contact: Mean error of 20"):
        assert words in page


def test_demo_ends_with_figures(demo: Path) -> None:
    said = (demo / "said.txt").read_text().splitlines()
    heads = [line.partition(":")[0] for line in said[-5:]]
    assert heads == [
        "report", "simulated, seed 3; calibrated on sphere", "tracking error", "shape",
        "force error",
    ]  # fmt: skip


def test_demo_prints_wall_and_rig_time(demo: Path) -> None:
    summary = json.loads((demo / "run" / "summary.json").read_text())
    assert 60 < summary["rig_seconds"] < 300  # 1 min 11 s of motion, and the host's part
    assert summary["wall_seconds"] > 0


def without_libgl(
    how: str, *words: str, cwd: Path, program: tuple[str, ...] = PROGRAM
) -> subprocess.CompletedProcess[str]:
    """Run a program where the loader finds no usable libGL.so.1; skips where that is barred."""
    if os.name != "posix" or shutil.which("unshare") is None:
        pytest.skip("libGL cannot be hidden here: no `unshare`")
    listed = subprocess.run(
        ["ldconfig", "-p"], capture_output=True, text=True, check=False,
        env={**os.environ, "PATH": f"{os.environ['PATH']}:/sbin:/usr/sbin"},
    )  # fmt: skip
    library = re.search(r"libGL\.so\.1 .*=> (\S+)", listed.stdout)
    if library is None:
        pytest.skip("libGL.so.1 is not on this machine, so it cannot be hidden")
    script = HIDDEN.format(hide=HIDE[how], not_permitted=NOT_PERMITTED)
    # What an earlier export left there needs no library.
    shutil.rmtree(Path(os.environ["DELTACT_FAB_CACHE"]) / "cad", ignore_errors=True)
    scratch = tempfile.mkdtemp(dir=cwd)
    done = subprocess.run(
        ["unshare", "--mount", "bash", "-c", script, library.group(1), scratch, *program,
         *words],
        capture_output=True, text=True, cwd=cwd, timeout=300, check=False,
    )  # fmt: skip
    # unshare itself exits 1 when the kernel refuses, before the program runs.
    if done.returncode == NOT_PERMITTED or "unshare failed" in done.stderr:
        pytest.skip(f"libGL cannot be hidden here: {done.stderr.strip()}")
    return done


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("broken", "libGL.so.1: file too short"),
        ("missing", "libGL.so.1: cannot open shared object file: No such file or directory"),
    ],
)
def test_missing_libgl_is_named_demo_continues(how: str, why: str, tmp_path: Path) -> None:
    done = without_libgl(how, "cad", "export", "sphere:10", "--out", "parts", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    said = done.stderr.removeprefix("deltact-fab: ").removesuffix("\n")
    assert said.startswith("cadquery cannot be imported (")
    assert f"{why}): apt-get install --reinstall libgl1 libegl1 libx11-6, or pip install" in said
    assert not (tmp_path / "parts").exists()
    words = (
        "import json; from pathlib import Path; from deltact_fab.app import demo; print(json.dumps("
        "demo._export_parts(Path('demo'), 3)))"
    )
    done = without_libgl(how, "-c", words, cwd=tmp_path, program=(sys.executable,))
    left = f"not exported: {said}"
    assert json.loads(done.stdout) == {
        "parts": [], "note": f"The parts were {left}", "said": f"cad: {left}"
    }  # fmt: skip
