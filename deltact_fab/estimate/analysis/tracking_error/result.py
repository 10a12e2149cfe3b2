"""Result of a tracking analysis: the recommended method, and whether the flow can be trusted.

The rule is `TrackingResult.RULE`. The error is the mean over all moving visible pixels; without
truth, the mean at the dots (the paper's); with dots only, that of the located dots. Without any
error, the method of the largest confident share is recommended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from deltact_fab.common import InputError, read_json

from ..runs import write_results
from .tally import DOTS_METHOD, MOVING_MM, WRONG_FLOW_MM

# Decision 0004: far from both sides, deep drags that hide a tenth and failing trackers.
MIN_TRUSTED, MIN_CONFIDENT, MAX_WRONG = 0.95, 0.8, 0.005
ERROR_LABELS = {
    "mean_off_dots_mm": "over all moving pixels",
    "mean_at_dots_mm": "at the dots",
    "mean_confident_mm": "over the located dots",
}


def format_percent(share: float) -> str:
    """Format a share as a percentage; values close to 0 or 1 are not rounded to 0 or 100 %."""
    value = 100 * share
    if 0 < value < 0.001:
        return "under 0.001 %"
    if 99.9 < value < 100:
        return "over 99.9 %"
    text = f"{value:.1f}" if 10 <= value < 100 else f"{value:.2g}" if value < 10 else "100"
    return f"{text.removesuffix('.0')} %"


@dataclass(frozen=True)
class TrackingVerdict:
    """Verdict on the methods. about: the recommended one, else the nearest to reliable.

    take: the recommended one or None. doubts: by method, reasons why it is not reliable; empty if
    it is. error: key of the compared error, None without any. line: the verdict as a sentence.
    """

    about: str
    take: str | None
    doubts: dict[str, list[str]]
    error: str | None
    trusted: bool
    line: str

    @property
    def error_words(self) -> str:
        return ERROR_LABELS[self.error] if self.error is not None else ""


def judge_methods(methods: Sequence[dict[str, Any]], simulated: bool) -> TrackingVerdict:
    """Judge one or more methods over a whole run (rows: `ErrorTally.figures`, with `name`)."""
    doubts = {row["name"]: _doubts(row) for row in methods}
    compared = (key for key in ERROR_LABELS if any(row[key] is not None for row in methods))
    error = next(compared, None)
    reliable = [row for row in methods if not doubts[row["name"]]]
    if error is not None:
        measured = [row for row in reliable if row[error] is not None]
        take = min(measured, key=lambda row: row[error], default=None)
    else:
        take = max(reliable, key=lambda row: row["confident_share"], default=None)
    about = take or min(
        methods, key=lambda row: (len(doubts[row["name"]]), row["confident_wrong_share"] or 0.0)
    )
    if take is None:
        line = (
            "Do not trust this experiment: no method is reliable. The closest is "
            f"{about['name']}, but {'; '.join(doubts[about['name']])}."
        )
    else:
        line = _recommendation(take, error, simulated)
    return TrackingVerdict(
        about=about["name"],
        take=take["name"] if take else None,
        doubts=doubts,
        error=error,
        trusted=take is not None,
        line=line,
    )


def _doubts(row: dict[str, Any]) -> list[str]:
    """Return the reasons why a method is not reliable, as text."""
    if not row["n_frames"]:
        return ["no frame after the reference"]
    reasons = []
    if row["trusted_share"] < MIN_TRUSTED:
        reasons.append(
            f"{format_percent(row['trusted_share'])} of the frames are trusted "
            f"(at least {format_percent(MIN_TRUSTED)})"
        )
    share, region = _coverage(row)
    if share < MIN_CONFIDENT:
        reasons.append(
            f"{format_percent(share)} of {region} is confident "
            f"(at least {format_percent(MIN_CONFIDENT)})"
        )
    wrong = row["confident_wrong_share"]
    if wrong is not None and wrong > MAX_WRONG:
        reasons.append(
            f"{format_percent(wrong)} of the confident pixels are off by more than "
            f"{WRONG_FLOW_MM:g} mm (at most {format_percent(MAX_WRONG)})"
        )
    return reasons


def _coverage(row: dict[str, Any]) -> tuple[float, str]:
    """Confident share of a method, and the region that it is a share of."""
    moving = row["coverage"] is not None
    share = row["coverage"] if moving else row["confident_share"]
    if row["name"] == DOTS_METHOD:
        return share, "the moving dots" if moving else "the dots"
    return share, "the moving pattern" if moving else "the image"


def _recommendation(method: dict[str, Any], error: str | None, simulated: bool) -> str:
    share, region = _coverage(method)
    text = f"Use {method['name']}: "
    if error is not None:
        text += f"mean error {method[error]:.4f} mm {ERROR_LABELS[error]}, "
    text += (
        f"{method['ms_per_frame']:.0f} ms CPU per frame. The flow can be trusted: "
        f"{format_percent(method['trusted_share'])} of {method['n_frames']} frames are trusted, "
        f"{format_percent(share)} of {region} is confident"
    )
    wrong = method["confident_wrong_share"]
    if wrong is not None:
        text += f", {format_percent(wrong)} of this in error by over {WRONG_FLOW_MM:g} mm"
    return text + (" (simulated)." if simulated else " (no truth to compare with).")


@dataclass
class TrackingResult:
    """Figures by method (`ErrorTally.figures`), and the table of frames.

    dots: None where they were not tracked. left_out: one line per comparison not made.
    """

    FORMAT: ClassVar = 2
    """Of tracking.json; before, "paper" was another tracker."""
    PAPER_BEST_MM: ClassVar = 0.08
    """Pattern Selection: d = 0.075, r = 0.6, real sensor, at the dots."""
    WRONG_MM: ClassVar = WRONG_FLOW_MM
    format_percent: ClassVar = staticmethod(format_percent)
    RULE: ClassVar = (
        f"A method is reliable if at least {format_percent(MIN_TRUSTED)} of frames are trusted, "
        f"at least {format_percent(MIN_CONFIDENT)} of the moving pattern (without truth: of the "
        f"image) is confident, and at most {format_percent(MAX_WRONG)} of the confident pixels "
        f"are off by more than {WRONG_FLOW_MM:g} mm. Of the reliable methods, the one with the "
        "smallest error is recommended. The flow can be trusted if a method is reliable."
    )

    methods: list[dict[str, Any]]
    by_indenter: list[dict[str, Any]]
    dots: dict[str, Any] | None
    left_out: list[str]
    frames: pd.DataFrame
    mm_per_px: float
    simulated: bool
    seed: int

    @property
    def verdict(self) -> TrackingVerdict:
        """The recommended method, and whether the experiment can be trusted."""
        return judge_methods(self.methods, self.simulated)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the table of frames."""
        return {
            "format": self.FORMAT,
            "verdict": asdict(self.verdict),
            "simulated": self.simulated,
            "seed": self.seed,
            "mm_per_px": self.mm_per_px,
            "moving_threshold_mm": MOVING_MM,
            "wrong_threshold_mm": WRONG_FLOW_MM,
            "paper_mean_at_dots_mm": self.PAPER_BEST_MM,
            "left_out": self.left_out,
            "dots": self.dots,
            "methods": self.methods,
            "by_indenter": self.by_indenter,
        }

    def save(self, folder: Path) -> list[Path]:
        """Write tracking.json and tracking.csv (one row per frame and method)."""
        return write_results(folder, {"tracking.json": self.as_dict(), "tracking.csv": self.frames})

    @classmethod
    def load(cls, folder: Path) -> TrackingResult:
        """Read what `save` wrote.

        Raises InputError if it is missing, does not parse, or is of an earlier version.
        """
        try:
            data = read_json(folder / "tracking.json")
            frames = pd.read_csv(folder / "tracking.csv")
            if "paper" in frames["method"].values and data.get("format") != cls.FORMAT:
                raise ValueError("its 'paper' is what 'farneback/summed' is now")
            return cls(
                data["methods"], data["by_indenter"], data["dots"], data["left_out"], frames,
                data["mm_per_px"], data["simulated"], data["seed"],
            )  # fmt: skip
        except (InputError, OSError, ValueError, KeyError) as error:
            raise InputError(
                f"{folder}: no readable tracking analysis ({error}); run `deltact-fab analyze "
                "tracking` again"
            ) from error
