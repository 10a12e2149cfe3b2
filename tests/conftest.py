"""A short run on the virtual rig and the demo: each made once, for all tests that read it."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from rig_text import VIRTUAL_STAGE

if TYPE_CHECKING:
    from deltact_fab.estimate.analysis.tracking_error.result import TrackingResult

# Small arrays: threads of the linear algebra cost more than they give, and results must repeat.
os.environ.setdefault("OMP_NUM_THREADS", "1")

MINI_PROTOCOL = """
name = "mini"
indenters = ["sphere:10", "4dots"]
positions_mm = [[0.5, -0.5]]
depths_mm = [1.0]
channels = ["image", "dots", "force", "shear"]
[shear]
amplitude_mm = 1.5
axes = ["x"]
[capture]
rate_hz = 0.5
"""
MINI_RIG = f"""{VIRTUAL_STAGE}[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.gel]
spacing_mm = 0.4
press_increment_mm = 0.2
shear_increment_mm = 0.5
"""


def pytest_configure() -> None:
    """Ctrl-C and a hang-up are heard here and in what tests start.

    A shell, or nohup, starts what it puts in the background with them ignored, and a process hands
    that on to its children.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No test reads or fills the cache of whoever runs it; commands started by tests share one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DELTACT_FAB_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def no_boot_loader() -> Iterator[None]:
    """A simulated board is no Arduino: no boot loader's 2.5 s are waited for its banner."""
    from deltact_fab.bench.rig.stage.exchange import Talk

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Talk.banner, "__defaults__", (0.4,))
        yield


@pytest.fixture(scope="session")
def mini(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Paths of a short protocol and of a rig file."""
    folder = tmp_path_factory.mktemp("mini")
    protocol, rig = folder / "mini.toml", folder / "bench.toml"
    protocol.write_text(MINI_PROTOCOL)
    rig.write_text(MINI_RIG)
    return protocol, rig


def common(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that the worker that needs it first makes for all; who changes it copies it."""
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / f"common-{name}"
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            made = factory.mktemp(name) / "out"
            make(made)
            made.rename(folder)
    return folder


@pytest.fixture(scope="session")
def made_once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[str, Callable[[Path], object]], Path]:
    """`common` with its factory, for the conftest of a folder of tests."""
    return partial(common, tmp_path_factory)


@pytest.fixture(scope="session")
def mini_run(mini: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a recorded run of the short protocol."""
    from deltact_fab.simulate.experiment.request import RunRequest
    from deltact_fab.simulate.experiment.session import run_experiment

    protocol, rig = map(str, mini)
    return common(
        tmp_path_factory, "run", lambda out: run_experiment(RunRequest(protocol, rig, out, seed=3))
    )


@pytest.fixture(scope="session")
def tracked(mini_run: Path) -> TrackingResult:
    """The tracking error of the short run by two quick methods."""
    from concurrent.futures import ThreadPoolExecutor

    from deltact_fab.estimate.analysis.tracking_error.follow import analyse_tracking

    with ThreadPoolExecutor(1) as executor:
        return analyse_tracking(mini_run, ["dis-fast", "dis-fast/static"], executor)


@pytest.fixture(scope="session")
def calibrations(mini_run: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Of force, fitted to the short run itself, and of depth, of plausible numbers."""
    import numpy as np

    from deltact_fab.bench.record.images import encode_png
    from deltact_fab.bench.record.run import open_run
    from deltact_fab.estimate.analysis.force.dataset import WRENCH_COLUMNS
    from deltact_fab.estimate.analysis.force.result import write_force_calibration
    from deltact_fab.estimate.analysis.runs import head_of, view_of_run
    from deltact_fab.estimate.measure.face import FaceFlow
    from deltact_fab.estimate.measure.flow.tracker import FlowTracker
    from deltact_fab.estimate.measure.force import make_features
    from deltact_fab.estimate.measure.force.calibration import ForceCalibration
    from deltact_fab.estimate.measure.force.model import ForceModel
    from deltact_fab.estimate.measure.shape.depth import DepthModel

    run, folder = open_run(mini_run), tmp_path_factory.mktemp("calibrations")
    view = view_of_run(run)
    features = make_features("paper", view)
    frames = run.frames()
    numbers = []
    for _, part in frames.groupby("press", sort=False):
        tracker = FlowTracker(full=False)
        for file in part["file"]:
            seen = tracker.update(run.image(file))
            numbers.append(features.compute(FaceFlow.from_flow(seen, view.camera, 8)))
    wrench = frames[list(WRENCH_COLUMNS)].to_numpy(float)
    model, _ = ForceModel.fit(features, np.array(numbers), wrench)
    rest = encode_png(run.image(str(frames["file"].iloc[0])))
    head = head_of([run], "force")
    made = ForceCalibration(head, model, view.skin, view.poisson, rest=rest)
    force, depth = folder / "force.toml", folder / "depth.toml"
    write_force_calibration(made, force)
    plausible = DepthModel(gain=1.2, deepest_mm=2.0).as_dict()
    depth.write_text(head_of([run], "depth").toml({"depth": plausible}))
    return [force, depth]


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the command `demo` fills."""

    def make(out: Path) -> None:
        done = subprocess.run(
            [sys.executable, "-m", "deltact_fab.app.cli.main", "demo", "--out", str(out)],
            capture_output=True, text=True, cwd=out.parent, timeout=900, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        (out / "said.txt").write_text(done.stdout)

    return common(tmp_path_factory, "demo", make)
