"""Everything that `analyze tracking` prints and draws, and its files."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ... import reading
from ...errors import InputError
from ...files import write_whole
from ..frames import make_folder
from .tally import MOVING_MM, WRONG_MM
from .verdict import TrackingVerdict, judge

if TYPE_CHECKING:
    import pandas as pd

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
            "verdict": self.verdict.as_dict(),
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
        import pandas as pd

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
