"""Which frames of a run an analysis can use, and which of them are at rest."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from ..errors import InputError, RunFailed
from ..record import UNKNOWN, Run

PRESSING = ("press", "shear")
"""Kinds of the steps in which the face is pressed."""


def recorded(run: Run, what: str) -> pd.DataFrame:
    """The frames of a run that is finished and has images; `what` is analysed.

    Raises InputError, one line, for any other run, RunFailed for a damaged journal.
    """
    frames = run.frames()  # a damaged journal is worse news than an unfinished run
    if not run.finished:
        raise InputError(f"{run.folder}: the run is not finished; go on with `run --resume`")
    if frames.empty or frames["file"].isna().any():
        raise InputError(f"{run.folder}: no images were recorded; {what} needs the channel 'image'")
    return frames


def settles(frames: pd.DataFrame) -> bool:
    """Whether a run's protocol has frames at rest that press the face, of the table of frames."""
    return bool((frames["settled"] & frames["kind"].isin(PRESSING)).any())


def settled(frames: pd.DataFrame) -> pd.DataFrame:
    """The frames of a press at which nothing moves, of the table of all its frames.

    Where the protocol does not settle: the last frame of each step that presses or shears. Of an
    imported run nobody knows, and all are taken.
    """
    if (frames["kind"] == UNKNOWN).all():
        return frames
    if settles(frames):
        return frames[frames["settled"]]
    last = frames.groupby("step_id", sort=False).tail(1)
    return last[last["kind"].isin(PRESSING)]


def settle_s(run: Run, kind: str) -> float:
    """How long stops of a kind rested before their frame, by the run's protocol; 0: not at all.

    kind: of the step; before and after the press it is `travel`, and the former is meant.
    """
    told = (run.meta["protocol"].get("capture") or {}).get("settle_s")
    stop = "rest" if kind == "travel" else kind
    return (told.get(stop) if isinstance(told, dict) else told) or 0.0


def make_folder(folder: Path) -> None:
    """For what an analysis writes. Raises RunFailed where it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as why:
        raise RunFailed(f"{folder}: cannot be made: {why.strerror}; name --out") from why
