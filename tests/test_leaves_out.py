"""What no one asks for is not built, not solved, not opened and not imported.

Calls are counted on the real functions, in this process; imports are read in a process of their
own. Every "never" stands beside a scene that does call or import the thing.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from pathlib import Path
from typing import Any

import pytest
from rig_text import VIRTUAL_STAGE

PROTOCOL = """
name = "short"
indenters = ["sphere:10"]
positions_mm = [[0.0, 0.0]]
depths_mm = [1.2]
channels = {channels}
{shear}
[capture]
rate_hz = 0.5
"""
SHEAR = """
[shear]
amplitude_mm = 0.5
axes = ["x"]
"""
RIG = f"""{VIRTUAL_STAGE}[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.gel]
spacing_mm = 0.5
"""
# Frames through a lens, tracked by the design's.
LENS = """
[virtual.lens]
f_px = 390.0
"""
THROUGH = ("deltact_fab.simulate.virtual.lens", "deltact_fab.simulate.virtual.picture")
SCENES = {
    "force": ('["force"]', ""),
    "force and shear": ('["force", "shear"]', SHEAR),
    "tracking": ('["image", "dots"]', ""),
    "no dots": ('["image"]', ""),
    "full": ('["image", "dots", "force", "shear"]', SHEAR),
}
CAD = ("cadquery", "OCP")
PAGES = ("matplotlib", "jinja2")
WATCHED = ("cv2", "numba", "scipy.interpolate", *THROUGH, *CAD, *PAGES)
# Of one command each: rooms that it would enter only in passing.
REGISTRY = tuple(
    f"deltact_fab.fabricate.cad.{name}" for name in ("registry", "feasibility", "parts.cover")
)
WRITING = (
    *(f"deltact_fab.bench.record.{name}" for name in ("writer", "importing", "check")),
    *(f"deltact_fab.fabricate.cad.{name}" for name in ("design", "dimensions")),
)
DRAFTING = (
    *(
        f"deltact_fab.fabricate.cad.drafting.{name}"
        for name in ("page", "projection", "scheme", "placing", "drawing")
    ),
    "deltact_fab.fabricate.pdf",
)
CLUSTER = ("deltact_fab.common.jobs.cluster",)
LOADED = """
print("@@" + json.dumps([name for name in {watched!r} if name in sys.modules]))
"""
RUN = """
from pathlib import Path
from deltact_fab.simulate import RunRequest, run_experiment
run_experiment(RunRequest({protocol!r}, {rig!r}, Path("run"), seed=3))
"""
COMMAND = """
sys.argv = ["deltact-fab", *{words!r}]
from deltact_fab.app.cli.main import entry
try:
    entry()
except SystemExit as end:
    assert end.code == 0, end.code
"""


@pytest.fixture(autouse=True)
def _own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What another test solved would be found, and not counted."""
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "store"))


def scene(name: str, folder: Path, lens: str = "") -> tuple[str, str]:
    """Paths of the scene's protocol and rig file."""
    channels, shear = SCENES[name]
    protocol, rig = folder / "short.toml", folder / "bench.toml"
    protocol.write_text(PROTOCOL.format(channels=channels, shear=shear))
    rig.write_text(RIG + lens)
    return str(protocol), str(rig)


def loaded_by(*bodies: str, cwd: Path, watched: tuple[str, ...] = WATCHED) -> list[set[str]]:
    """Which of the watched modules a fresh process holds after each of the bodies."""
    look = LOADED.format(watched=watched)
    done = subprocess.run(
        [sys.executable, "-c", "import json, sys\n" + "".join(body + look for body in bodies)],
        capture_output=True, text=True, cwd=cwd, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = [line[2:] for line in done.stdout.splitlines() if line.startswith("@@")]
    return [set(json.loads(line)) for line in found]


def counting(real: Callable[..., Any], calls: Counter[str], label: str) -> Callable[..., Any]:
    @wraps(real)
    def call(*args: Any, **kwargs: Any) -> Any:
        calls[label] += 1
        return real(*args, **kwargs)

    return call


def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts the calls of whatever a scene may leave out; the real function still runs."""
    import serial

    from deltact_fab.bench.rig.force import netft as force
    from deltact_fab.estimate.analysis.tracking_error import tally
    from deltact_fab.estimate.measure.dots.tracker import DotTracker
    from deltact_fab.physics import imaging
    from deltact_fab.physics.gel.linear import contact
    from deltact_fab.sensor.optics.rectified import Rectified
    from deltact_fab.simulate.virtual import netft, picture

    calls: Counter[str] = Counter()
    for owner, name, label in (
        (picture.FrameRenderer, "render", "render"),
        (picture.FrameRenderer, "__init__", "picture"),
        (picture.RawView, "__init__", "raw view"),
        (Rectified, "maps", "maps"),
        (picture, "print_colours", "print"),
        (imaging.Exposure, "expose", "expose"),
        (contact, "friction_contact", "friction"),
        (contact, "normal_contact", "normal"),
        (netft.NetFTBox, "send", "force box"),
        (force.NetFTSensor, "read", "force"),
        (serial.Serial, "open", "port"),
        (DotTracker, "update", "dots"),
        (tally.TrueFrame, "from_flow", "truth"),
    ):
        monkeypatch.setattr(owner, name, counting(getattr(owner, name), calls, label))
    return calls


def calls_of(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, lens: str = ""
) -> Counter[str]:
    from deltact_fab.simulate.experiment.request import RunRequest
    from deltact_fab.simulate.experiment.session import run_experiment

    calls = counted(monkeypatch)
    summary = run_experiment(RunRequest(*scene(name, folder, lens), folder / "run", seed=3))
    calls["frames"] = summary["frames"]
    said = [line for line in summary["left_out"] if line.startswith("lens, its maps")]
    assert len(said) == (calls["raw view"] == 0)
    assert calls["frames"] >= 3
    return calls


@pytest.mark.slow
def test_full_scene_calls_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = calls_of("full", tmp_path, monkeypatch)
    assert calls["render"] == calls["expose"] == calls["frames"]
    assert calls["picture"] == calls["print"] == 1
    assert calls["friction"] >= 3
    assert calls["normal"] >= 3
    assert calls["force"] >= calls["frames"]
    assert calls["force box"] >= 3  # bias, start, stop
    assert calls["port"] == 0


def test_a_force_only_scene_never_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = calls_of("force", tmp_path, monkeypatch, LENS)
    assert calls["render"] == calls["picture"] == calls["print"] == calls["expose"] == 0
    assert calls["raw view"] == calls["maps"] == 0
    assert calls["port"] == 0
    assert calls["normal"] >= 3
    assert calls["force"] >= calls["frames"]
    assert calls["friction"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tracking", "no dots"])
def test_dots_are_tracked_on_demand(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deltact_fab.estimate.analysis.tracking_error.follow import analyse_tracking

    calls = calls_of(name, tmp_path, monkeypatch)
    with ThreadPoolExecutor(1) as executor:
        result = analyse_tracking(tmp_path / "run", ["dis-fast"], executor)
    asked = name == "tracking"
    assert calls["dots"] == (calls["frames"] if asked else 0)
    assert (result.dots is not None) == asked
    said = [] if asked else ["error at the dots: no channel 'dots' in the protocol"]
    assert result.left_out == said
    assert calls["truth"] == calls["frames"] - 1  # the reference is no measurement
    shutil.rmtree(tmp_path / "run" / "truth")
    with ThreadPoolExecutor(1) as executor:
        bare = analyse_tracking(tmp_path / "run", ["dis-fast"], executor)
    assert calls["truth"] == calls["frames"] - 1
    assert bare.left_out[-1] == "error against truth: not available on a real rig"


@pytest.mark.slow
def test_force_run_imports_no_renderer(tmp_path: Path) -> None:
    protocol, rig = scene("force and shear", tmp_path, LENS)
    (run,) = loaded_by(RUN.format(protocol=protocol, rig=rig), cwd=tmp_path)
    assert run == {"scipy.interpolate"}  # the gel's free sides


@pytest.mark.slow
def test_tracking_run_loads_no_page_makers(tmp_path: Path) -> None:
    protocol, rig = scene("tracking", tmp_path)
    run, analysed, reported = loaded_by(
        RUN.format(protocol=protocol, rig=rig),
        """
from deltact_fab.estimate import analyse_tracking
result = analyse_tracking("run", ["dis-fast/static"])
""",
        """
from deltact_fab.present import write_run_page
write_run_page("run", Path("page.html"), result)
""",
        cwd=tmp_path,
    )
    assert run == {"cv2", "scipy.interpolate", "deltact_fab.simulate.virtual.picture"}
    assert not analysed & {*CAD, *PAGES}
    assert {"matplotlib", "jinja2"} <= reported
    assert not reported & {*CAD}


@pytest.mark.parametrize(
    "words",
    [
        "cad show mold",
        pytest.param("pattern make -d 0.3 -r 0.1 --size 6 -o x.png", marks=pytest.mark.slow),
        pytest.param("gel press --depth 0.6 --spacing 0.5 --model linear", marks=pytest.mark.slow),
    ],
)
def test_number_commands_load_no_opencv(words: str, tmp_path: Path) -> None:
    (loaded,) = loaded_by(COMMAND.format(words=words.split()), cwd=tmp_path)
    assert loaded <= ({"scipy.interpolate"} if words.startswith("gel") else set())


def commands(*lines: str) -> list[str]:
    """Bodies that run a command line each."""
    return [COMMAND.format(words=line.split()) for line in lines]


def test_sheet_builds_no_part_registry(tmp_path: Path) -> None:
    bodies = commands("pattern sheet recommended -o sheet.pdf", "cad list")
    sheet, listed = loaded_by(*bodies, cwd=tmp_path, watched=REGISTRY)
    assert sheet == set()
    assert listed


@pytest.mark.slow
def test_measuring_loads_no_writer_or_dimensions(mini_run: Path, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(f'images = "{mini_run / "images"}"\nrate_hz = 20\n')
    bodies = commands(f"measure {mini_run}", "record import own.toml --out own")
    measured, imported = loaded_by(*bodies, cwd=tmp_path, watched=WRITING)
    assert measured == set()
    assert imported == set(WRITING)


@pytest.mark.slow
def test_step_export_loads_no_drawing(tmp_path: Path) -> None:
    export = "cad export cover --out parts --format"
    bodies = commands(f"{export} step", f"{export} pdf")
    elsewhere = """
from deltact_fab.common import open_executor
with open_executor(workers=1) as own:
    assert own.submit(abs, -1).result() == 1
"""
    step, drawn, shared = loaded_by(*bodies, elsewhere, cwd=tmp_path, watched=(*DRAFTING, *CLUSTER))
    assert step == set()
    assert drawn == set(DRAFTING)
    assert shared == {*DRAFTING, *CLUSTER}
