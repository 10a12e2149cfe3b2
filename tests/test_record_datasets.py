"""Datasets for learners have what the record has; `benchmarks/datasets.py` asks their loaders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest

from deltact_fab import record
from deltact_fab.analysis.flows import follower
from deltact_fab.errors import InputError, RunFailed
from deltact_fab.record import Run
from deltact_fab.record.export import export
from deltact_fab.record.export.lerobot import MM_PER_LEVEL, MOTION, RAW

FORCE = ["fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"]


@pytest.fixture(scope="module")
def run(mini_run: Path) -> Run:
    return record.open(mini_run)


@pytest.mark.slow
def test_zarr_has_every_pixel_number_and_motion_of_two_runs(run: Run, tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    counts = export([run, run], "zarr", tmp_path / "out", follow=follower)
    frames, force = run.frames(), run.force()
    assert counts["frames"] == 2 * len(frames)
    held: Any = zarr.open_group(tmp_path / "out", mode="r")
    twice = pd.concat([frames, frames])
    for name, columns in (("wrench", FORCE), ("position_mm", ["x_mm", "y_mm", "z_mm"])):
        np.testing.assert_array_equal(held[name][:], twice[columns].to_numpy())
        assert held[name].attrs["columns"] == columns
    assert np.array_equal(held["force/wrench"][: len(force)], force[FORCE].to_numpy())
    touched = (twice["fz_n"] < -0.1).to_numpy()
    np.testing.assert_array_equal(held["contact"][:], touched)
    assert touched.any()
    assert not touched.all()
    presses = held.attrs["presses"]
    first = presses[1]["first_frame"]
    assert np.array_equal(np.flatnonzero(held["press_index"][:] == 1)[:1], [first])
    track = follower(run)
    for at, file in enumerate(frames["file"][:first]):
        assert np.array_equal(held["image"][at][..., ::-1], run.raw(file))
        assert np.array_equal(held["shift_mm"][at], track(run.image(file)).shift_mm)


@pytest.mark.slow
def test_lerobot_has_its_frames_and_the_motion_to_its_levels(run: Run, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    counts = export([run], "lerobot", tmp_path / "out", follow=follower)
    frames = run.frames()
    data = pd.read_parquet(tmp_path / "out" / "data")
    assert counts["frames"] == len(frames) == len(data)
    wrench = np.stack(data["observation.wrench"].tolist())
    np.testing.assert_array_equal(wrench, frames[FORCE].to_numpy().astype(np.float32))
    info = json.loads((tmp_path / "out" / "meta" / "info.json").read_text())
    assert info["total_episodes"] == frames["press"].nunique()
    seen = {}
    for key in (RAW, MOTION):
        with av.open(tmp_path / "out" / "videos" / key / "chunk-000" / "file-000.mp4") as video:
            shown = [(f.time, f.to_ndarray(format="rgb24")) for f in video.decode(video=0)]
        assert [t for t, _ in shown] == [k / info["fps"] for k in range(len(frames))]
        seen[key] = [image for _, image in shown]
    first = frames[frames["press"] == frames["press"].iloc[0]]
    track = follower(run)
    for at, file in enumerate(first["file"]):
        motion = track(run.image(file))
        shift = (seen[MOTION][at][..., :2].astype(float) - 128) * MM_PER_LEVEL
        inside = np.abs(motion.shift_mm) < 127 * MM_PER_LEVEL
        assert np.abs(shift - motion.shift_mm)[inside].max() <= MM_PER_LEVEL / 2 + 1e-6
        assert np.array_equal(seen[MOTION][at][..., 2] == 255, motion.known)
        off = cv2.cvtColor(seen[RAW][at], cv2.COLOR_RGB2BGR).astype(float) - run.raw(file)
        assert 10 * np.log10(255**2 / np.mean(off**2)) > 35


@pytest.mark.parametrize(("form", "library"), [("zarr", "zarr"), ("lerobot", "av")])
def test_nothing_stays_of_a_dataset_that_fails(
    run: Run, tmp_path: Path, form: str, library: str
) -> None:
    pytest.importorskip(library)

    def fails(run: Run) -> Any:
        raise RunFailed("no")

    with pytest.raises(RunFailed, match="no"):
        export([run], form, tmp_path / "out", follow=fails)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="lerobot, zarr take several"):
        export([run, run], "csv", tmp_path / "out")
