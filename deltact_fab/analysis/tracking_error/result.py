"""Tracking errors of runs as a result: which method to take, and whether a flow is to be trusted.

The rule. A method can be believed when it

- trusts at least MIN_TRUSTED of the frames (its own word: each frame's `trusted`),
- is confident of at least MIN_COVERAGE of what it is asked for: of the moving visible pixels where
  the truth is known, else of the image, the mean over the frames,
- and, where the truth is known, has at most MAX_WRONG of its confident pixels off by more than
  WRONG_MM.

Of the methods that can be believed those form the *front* that no other one of them beats in both
error and CPU time (median a frame). The error is the mean over all moving visible pixels; where no
truth is known, the mean at the dots (the paper's); where there are only dots, that of the dots that
were found. The method to take is the one of the front with the least error. The cheapest one of the
front whose error is within NEAR times that is named beside it. Where no error is known, the
method that is confident of most is taken.

The experiment is to be trusted when a method can be believed.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ... import reading
from ...errors import InputError
from ...files import write_whole
from ..frames import make_folder
from .dots import DOTS
from .tally import MOVING_MM, WRONG_MM

MIN_TRUSTED = 0.95
MIN_COVERAGE = 0.8
MAX_WRONG = 0.005
NEAR = 2.0
ERRORS = {
    "mean_off_dots_mm": "over all moving pixels",
    "mean_at_dots_mm": "at the dots",
    "mean_confident_mm": "over the dots found",
}


def percent(share: float) -> str:
    """A share as a person reads it; what is nearly nothing or nearly all is not rounded away."""
    value = 100 * share
    if 0 < value < 0.001:
        return "under 0.001 %"
    if 99.9 < value < 100:
        return "over 99.9 %"
    text = f"{value:.1f}" if 10 <= value < 100 else f"{value:.2g}" if value < 10 else "100"
    return f"{text.removesuffix('.0')} %"


RULE = (
    f"A method can be believed when it trusts {percent(MIN_TRUSTED)} of the frames or more, is "
    f"sure of {percent(MIN_COVERAGE)} of the moving pattern or more (of the image, where no truth "
    f"is known), and is off by more than {WRONG_MM:g} mm on at most {percent(MAX_WRONG)} of what "
    "it is sure of. Of those that can be believed, the front are the ones that no other beats in "
    "both error and CPU time; the one with the least error is the one to take. An experiment can "
    "be trusted when a method can be believed on it."
)


@dataclass(frozen=True)
class TrackingVerdict:
    """about: the method that the line speaks of: the one to take, or the nearest to be believed.

    take, cheaper: names or None. front: from the cheapest method on. doubts: by method, why it
    cannot be believed; empty where it can be. error: the key of the error that was compared, None
    without any. line: all of it in words.
    """

    about: str
    take: str | None
    cheaper: str | None
    front: tuple[str, ...]
    doubts: dict[str, list[str]]
    error: str | None
    trusted: bool
    line: str

    @property
    def error_words(self) -> str:
        """What the error is a mean over."""
        return ERRORS[self.error] if self.error is not None else ""


def judge(methods: Sequence[dict[str, Any]], simulated: bool) -> TrackingVerdict:
    """The verdict on one or more methods over a whole run (`Tally.figures`, with `name`)."""
    doubts = {row["name"]: _doubts(row) for row in methods}
    error = next((key for key in ERRORS if any(row[key] is not None for row in methods)), None)
    believed = [row for row in methods if not doubts[row["name"]]]
    front = _front(believed, error)
    if error is not None:
        ranked = sorted(front, key=lambda row: row[error])
    else:
        ranked = sorted(believed, key=lambda row: -row["confident_share"])
    take = ranked[0] if ranked else None
    cheaper = None
    if take is not None and error is not None:
        near = [row for row in front if row[error] <= NEAR * take[error]]
        cheaper = near[0] if near[0] is not take else None
    about = take or min(
        methods, key=lambda row: (len(doubts[row["name"]]), row["confident_wrong_share"] or 0.0)
    )
    if take is None:
        line = (
            "Do not trust this experiment: no method can be believed. The nearest is "
            f"{about['name']}, but {'; '.join(doubts[about['name']])}."
        )
    else:
        line = _to_take(take, cheaper, error, simulated)
    return TrackingVerdict(
        about=about["name"],
        take=take["name"] if take else None,
        cheaper=cheaper["name"] if cheaper else None,
        front=tuple(row["name"] for row in front),
        doubts=doubts,
        error=error,
        trusted=take is not None,
        line=line,
    )


def _doubts(row: dict[str, Any]) -> list[str]:
    """Why a method cannot be believed, in words."""
    if not row["n_frames"]:
        return ["there is no frame after the first one"]
    found = []
    if row["trusted_share"] < MIN_TRUSTED:
        found.append(
            f"it trusts {percent(row['trusted_share'])} of the frames "
            f"(at least {percent(MIN_TRUSTED)})"
        )
    known, what = _coverage(row)
    if known < MIN_COVERAGE:
        found.append(f"it is sure of {percent(known)} of {what} (at least {percent(MIN_COVERAGE)})")
    wrong = row["confident_wrong_share"]
    if wrong is not None and wrong > MAX_WRONG:
        found.append(
            f"{percent(wrong)} of what it is sure of is off by more than {WRONG_MM:g} mm "
            f"(at most {percent(MAX_WRONG)})"
        )
    return found


def _coverage(row: dict[str, Any]) -> tuple[float, str]:
    """The share that a method is confident of, and of what."""
    dots = row["name"] == DOTS
    if row["coverage"] is not None:
        return row["coverage"], "the moving dots" if dots else "the moving pattern"
    return row["confident_share"], "the dots" if dots else "the image"


def _front(rows: Sequence[dict[str, Any]], error: str | None) -> list[dict[str, Any]]:
    """Those that no other one beats in both error and time, from the cheapest on."""
    if error is None:
        return []
    front: list[dict[str, Any]] = []
    for row in sorted((r for r in rows if r[error] is not None),
                      key=lambda r: (r["cpu_ms"]["p50"], r[error])):  # fmt: skip
        if not front or row[error] < front[-1][error]:
            front.append(row)
    return front


def _to_take(
    take: dict[str, Any], cheaper: dict[str, Any] | None, error: str | None, simulated: bool
) -> str:
    dots = take["name"] == DOTS
    known, what = _coverage(take)
    says = f"Take {take['name']}: "
    if error is not None:
        says += f"mean error {take[error]:.4f} mm {ERRORS[error]}, "
    says += f"{take['cpu_ms']['p50']:.0f} ms of CPU a frame"
    if cheaper is not None and error is not None:
        says += (
            f" ({cheaper['name']} has {cheaper[error]:.4f} mm at {cheaper['cpu_ms']['p50']:.0f} ms)"
        )
    how = "were found" if dots else "is known for sure"
    says += (
        f". The experiment can be trusted: {percent(take['trusted_share'])} of "
        f"{take['n_frames']} frames were matched, {percent(known)} of {what} {how}"
    )
    wrong = take["confident_wrong_share"]
    if wrong is not None:
        of = "these" if dots else "that"
        says += f", {percent(wrong)} of {of} off by more than {WRONG_MM:g} mm"
    return says + (" (simulated)." if simulated else " (no truth to hold it against).")


PAPER_BEST_MM = 0.08  # Pattern Selection: d = 0.075, r = 0.6, real sensor, at the dots


@dataclass
class TrackingResult:
    """Figures by method (`Tally.figures`), the table of frames, and the flow's arrows.

    dots: None where they were not followed. left_out: a line a thing that was not asked for.
    """

    methods: list[dict[str, Any]]
    by_indenter: list[dict[str, Any]]
    dots: dict[str, Any] | None
    left_out: list[str]
    frames: pd.DataFrame
    arrows: dict[str, NDArray[np.float32]]
    """Flow (px) of the first method at every ARROW_STEP_PX pixel, (rows, cols, 2), by frame id."""
    mm_per_px: float
    simulated: bool
    seed: int

    @property
    def verdict(self) -> TrackingVerdict:
        """Which method to take, and whether to trust the experiment."""
        return judge(self.methods, self.simulated)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the table of frames."""
        return {
            "verdict": asdict(self.verdict),
            "simulated": self.simulated,
            "seed": self.seed,
            "mm_per_px": self.mm_per_px,
            "moving_threshold_mm": MOVING_MM,
            "wrong_threshold_mm": WRONG_MM,
            "paper": {
                "best_mean_at_dots_mm": PAPER_BEST_MM,
                "note": "real sensor, d = 0.075 mm, r = 0.6, five indenters to 10 mm",
            },
            "left_out": self.left_out,
            "dots": self.dots,
            "methods": self.methods,
            "by_indenter": self.by_indenter,
        }

    def save(self, folder: Path) -> list[Path]:
        """Write tracking.json, tracking.csv (one row a frame and method) and the arrows."""
        make_folder(folder)
        packed = io.BytesIO()
        arrows: dict[str, Any] = {k.replace("/", "|"): v for k, v in self.arrows.items()}
        np.savez_compressed(packed, **arrows)
        files = {
            "tracking.json": (
                json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n"
            ).encode(),
            "tracking.csv": self.frames.to_csv(index=False).encode(),
            "arrows.npz": packed.getvalue(),
        }
        for name, data in files.items():
            write_whole(folder / name, data)
        return [folder / name for name in files]

    @classmethod
    def load(cls, folder: Path) -> TrackingResult:
        """Read what `save` wrote.

        Raises InputError when it is not there, does not parse, or is of an earlier version.
        """
        try:
            data = reading.json_object(folder / "tracking.json")
            frames = pd.read_csv(folder / "tracking.csv")
            with np.load(folder / "arrows.npz") as stored:
                arrows = {key.replace("|", "/"): stored[key] for key in stored.files}
            return cls(
                data["methods"], data["by_indenter"], data["dots"], data["left_out"], frames,
                arrows, data["mm_per_px"], data["simulated"], data["seed"],
            )  # fmt: skip
        except (InputError, OSError, ValueError, KeyError, EOFError, BadZipFile) as why:
            raise InputError(
                f"{folder}: no readable tracking analysis ({why}); `deltact-fab analyze tracking` "
                "makes a new one"
            ) from why
