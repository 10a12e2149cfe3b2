"""A run as a learner takes it: presses of frames, with image, motion and what was felt.

What a frame has is one table, `FIELDS`, of columns of `TABLES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Progress
from ...errors import InputError
from ..run import Run
from ..streams import FORCE_COLUMNS, POSE_COLUMNS
from ..timeline import TimeLine
from .tables import LINE, TABLES, of_press

if TYPE_CHECKING:
    import pandas as pd

CONTACT_N = 0.1  # several times the noise of the sensors that a bench has
_TARGET = ("target_x_mm", "target_y_mm", "target_z_mm")
COLUMNS = {**TABLES["frames"], "contact": "int8", **dict.fromkeys(_TARGET, "float64")}
"""contact: 1 where fz_n < -CONTACT_N or, where no force is known, z_mm < 0; 0 where neither; -1
where neither is known. target: where the step under way leads the tip."""

FIELDS: dict[str, tuple[str, ...]] = {
    "time_ns": (LINE,),
    "t_press_s": ("t_press_s",),
    "seq": ("seq",),
    "settled": ("settled",),
    "observation.state": POSE_COLUMNS,
    "observation.wrench": FORCE_COLUMNS,
    "observation.contact": ("contact",),
    "action": _TARGET,
}
"""The columns that each feature of the dataset is made of."""

Follow = Callable[[Run], Callable[[NDArray[np.uint8]], Any]]
"""What follows a press of a run, from its first image on; the record knows no tracker.

It gives the pattern's motion at points of the face: shift_mm (h, w, 2), known (h, w), x_mm (w,),
y_mm (h,), trusted."""


def values_of(table: pd.DataFrame, columns: tuple[str, ...]) -> NDArray[Any]:
    """(n,) of one column, (n, columns) of more; nan where a float is not known."""
    values = table[list(columns)].to_numpy(COLUMNS[columns[0]])
    return values if len(columns) > 1 else values[:, 0]


@dataclass(frozen=True)
class Episode:
    """A press with frames. table: of its frames, with `COLUMNS`; follow: None without motion."""

    run: Run
    line: TimeLine
    press: str
    table: pd.DataFrame
    follow: Follow | None

    @property
    def indenter(self) -> str:
        """Which was mounted."""
        return str(self.table["indenter"].iloc[0])

    def images(self) -> Iterator[tuple[NDArray[np.uint8], Any]]:
        """Of each frame the image as the camera gave it, (h, w, 3) RGB, and the motion.

        One at a time; none of a run without images. Raises as `Run.image` and the tracker do.
        """
        import cv2

        track = self.follow(self.run) if self.follow and self.run.meta["camera"] else None
        for file in self.table["file"].dropna():
            raw = self.run.raw(file)
            motion = track(self.run.image(file)) if track else None
            yield np.asarray(cv2.cvtColor(raw, cv2.COLOR_BGR2RGB), np.uint8), motion


def episodes(runs: Sequence[Run], follow: Follow | None, progress: Progress) -> Iterator[Episode]:
    """All presses that have frames, run by run in the order they were begun.

    Raises InputError where no run has one, or where one has images and another has not.
    """
    lines = [TimeLine.of(run) for run in runs]
    done, total, seen = 0, sum(len(line.presses) for line in lines), set()
    for run, line in zip(runs, lines, strict=True):
        for press in line.presses:
            done += 1
            table = of_press(run, line, "frames", press)
            if table.empty:  # a change of the indenter
                continue
            seen.add(bool(table["file"].notna().all()))
            if len(seen) > 1:
                raise InputError(f"{run.folder}: {press}: frames with and without images")
            yield Episode(run, line, press, _told(run, line, press, table), follow)
            progress(done, total, press)
    if not seen:
        raise InputError(f"{runs[0].folder}: no press has frames")


def _told(run: Run, line: TimeLine, press: str, table: pd.DataFrame) -> pd.DataFrame:
    """With targets and contact."""
    targets = of_press(run, line, "steps", press).set_index("step_id")[list(POSE_COLUMNS)]
    named = targets.rename(columns=dict(zip(POSE_COLUMNS, _TARGET, strict=True)))
    fz_n, z_mm = table["fz_n"], table["z_mm"]
    contact = np.select([fz_n.notna(), z_mm.notna()], [fz_n < -CONTACT_N, z_mm < 0], -1)
    return table.join(named, on="step_id").assign(contact=contact.astype(np.int8))
