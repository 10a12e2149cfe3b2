"""The judges of real recordings, on what is known: none of them needs a recording."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from benchmarks import real
from deltact_fab.errors import InputError


def test_the_correlation_finds_a_known_motion_and_loses_another_picture() -> None:
    rng = np.random.default_rng(3)
    first = ndimage.gaussian_filter(rng.normal(size=(240, 320)), 2)
    first = 128 + 40 * first / first.std()
    judge = real.Correlation(first)
    for shift in ((0.0, 0.0), (3.3, -5.6), (7.8, -9.4)):  # (x, y), within its search each time
        found = judge.update(ndimage.shift(first, shift[::-1], order=3, mode="nearest"))
        inner = ((judge.nodes > 40) & (judge.nodes < (279, 199))).all(axis=1)
        assert found[inner] == pytest.approx(np.tile(shift, (inner.sum(), 1)), abs=0.06)
    other = ndimage.gaussian_filter(rng.normal(size=first.shape), 2)
    assert np.isnan(judge.update(128 + 40 * other / other.std())).all()


def test_blocks_that_are_left_out_are_not_seen() -> None:
    rng = np.random.default_rng(5)
    columns, y = rng.normal(size=(60, 2)), np.zeros(60)
    y = columns @ [2.0, -1.0] + 3.0
    assert real.left_out(columns, y) == pytest.approx(0, abs=1e-9)
    y[15:30] += 7.0  # a block unlike all others: none of the rest excuses it
    off = real.left_out(columns, y)
    assert off[15:30] == pytest.approx(-7.0)
    assert np.abs(off).max() == pytest.approx(7.0)


def test_a_swap_of_identities_is_seen_by_the_chains() -> None:
    grid = np.stack(np.meshgrid(np.arange(5) * 30.0, np.arange(4) * 30.0), -1).reshape(-1, 2) + 30
    image = np.full((170, 200), 200.0)
    for x, y in grid:
        image[int(y) - 4 : int(y) + 5, int(x) - 4 : int(x) + 5] = 40
    spots = real.dark_spots(image)
    assert np.sort(spots, axis=0) == pytest.approx(np.sort(grid, axis=0), abs=0.5)
    frames = [grid[::-1] + (step, 0) for step in range(0, 31, 10)]  # the last is a pitch away
    assert real.chained(frames, grid, 14.0)[-1] == pytest.approx(grid + (30, 0))
    assert np.isnan(real.chained([grid[1:]], grid, 14.0)[0, 0]).all()


def test_a_clone_is_known_by_its_files_on_any_branch_and_another_folder_is_one_line(
    tmp_path: Path,
) -> None:
    def git(*asked: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@b")
        subprocess.run(["git", "-C", str(tmp_path), *who, *asked], check=True, capture_output=True)

    with pytest.raises(InputError, match="git log"):
        real.section_of(tmp_path)
    git("init")
    (tmp_path / "a").write_text("a")
    git("add", "a")
    git("commit", "-m", "a")
    with pytest.raises(InputError, match=r"no recording known here.*gelsightinc/gsrobotics"):
        real.section_of(tmp_path)
    folder = tmp_path / "scripts" / "fv_lib" / "pynhhd" / "data"
    folder.mkdir(parents=True)
    rows = "".join(f"{i},0,0,{i % 3},{i // 3}\n" for i in range(9))
    (folder / "one.csv").write_text(",x,y,xt,yt\n" + rows)
    git("add", ".")
    git("commit", "-m", "b")
    held = (
        real.git(tmp_path, "rev-parse", f"HEAD:{real.RECORDINGS[3].folder}/one.csv")
        .decode()
        .strip()
    )
    git("rm", "-r", "scripts")
    git("commit", "-m", "c")
    section = real.section_of(tmp_path)
    assert "Guanlan-gkd/finger_vision_master @ " in section
    assert "| one | 1.29 | " in section
    (blob,) = (tmp_path / ".git" / "objects").glob(f"{held[:2]}/{held[2:]}")
    blob.unlink()
    with pytest.raises(InputError, match="all 1 files wanted are absent"):
        real.section_of(tmp_path)
    page = real.with_section(real.with_section("", "## Two gels"), section)
    assert page == real.with_section(page, section)


def test_the_page_has_each_recording_once() -> None:
    text = real.PAGE.read_text(encoding="utf-8")
    assert [line.removeprefix("## ") for line in text.splitlines() if line.startswith("## ")] == [
        recording.about for recording in real.RECORDINGS
    ]
    assert "nHHD not run" not in text
