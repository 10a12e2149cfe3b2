"""Runs as one Zarr group (format 3): what every frame has as arrays of one length, and all samples.

Images and motions are chunks of one frame in shards of some megabytes, so that a learner reads any
frame alone and 10^5 presses make no million files. Everything is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...aliases import Progress
from ..run import Run
from .episodes import COLUMNS, FIELDS, Follow, episodes, values_of
from .tables import described, of_press

BLOCK_BYTES, BLOCK_ROWS = 32 << 20, 1 << 16  # of one array, held until they are written
FRAME_BYTES = 4096  # a row from here on is a chunk of its own
STREAMS = {"force": ("time_ns", "wrench"), "pose": ("time_ns", "position_mm")}
PICTURES = {
    "image": ("", "as the camera gave it, RGB"),
    "shift_mm": (
        "mm",
        "x and y of the way of each point of the face since the press's first frame",
    ),
    "known": ("", "the way was found in the image; elsewhere it is a guess"),
    "trusted": ("", "the tracker's verdict on the frame"),
}
PRESS = "press_index"


def about(name: str) -> dict[str, Any]:
    """What stands with an array: unit, description, of fields their columns."""
    if name in PICTURES:
        unit, text = PICTURES[name]
        return {"unit": unit, "description": text}
    if name == PRESS:
        return {"unit": "", "description": "place in `presses`, of the group's attributes"}
    columns = [COLUMNS[column] for column in FIELDS[name][1]]
    told = {"unit": [c.unit for c in columns], "description": [c.text for c in columns]}
    joined = {key: "; ".join(dict.fromkeys(texts)) for key, texts in told.items()}
    return joined | {"columns": [c.name for c in columns]}


class _Arrays:
    """Arrays of a group that grow by whole shards, and by the rest at the end."""

    def __init__(self, group: Any) -> None:
        self._group = group
        self._held: dict[str, list[NDArray[Any]]] = {}

    def add(self, name: str, rows: NDArray[Any]) -> None:
        """Rows (k, ...) of an array."""
        from zarr.codecs import BloscCodec

        size, shape = rows.itemsize * int(np.prod(rows.shape[1:])), rows.shape[1:]
        block, alone = min(max(1, BLOCK_BYTES // size), BLOCK_ROWS), size >= FRAME_BYTES
        if name not in self._held:
            self._held[name] = []
            self._group.create_array(
                name, shape=(0, *shape), dtype=rows.dtype, attributes=about(name),
                chunks=(1 if alone else block, *shape), shards=(block, *shape) if alone else None,
                compressors=BloscCodec(cname="zstd", clevel=3, shuffle="shuffle"),
            )  # fmt: skip
        self._held[name].append(rows)
        if sum(map(len, self._held[name])) >= block:
            self._write(name, block)

    def close(self) -> None:
        """Write what is held."""
        for name in self._held:
            self._write(name, 1)

    def _write(self, name: str, block: int) -> None:
        rows = np.concatenate(self._held[name])
        whole = len(rows) // block * block
        self._group[name].append(rows[:whole])
        self._held[name] = [rows[whole:]]


def write(
    runs: Sequence[Run], folder: Path, follow: Follow | None, progress: Progress
) -> dict[str, int]:
    """Write the group into a new folder; return how many presses, frames and samples it has.

    Raises as `episodes` and its images do.
    """
    import zarr

    root = zarr.open_group(folder, mode="w-", zarr_format=3)
    frames, streams = _Arrays(root), {name: _Arrays(root.create_group(name)) for name in STREAMS}
    counts = dict.fromkeys(("presses", "frames", *STREAMS), 0)
    presses = []
    for at, episode in enumerate(episodes(runs, follow, progress)):
        n = len(episode.table)
        for name, (_, columns) in FIELDS.items():
            frames.add(name, values_of(episode.table, columns))
        frames.add(PRESS, np.full(n, at, np.int32))
        for image, motion in episode.images():
            frames.add("image", image[None])
            if motion is not None:
                for name in ("shift_mm", "known", "trusted"):
                    frames.add(name, np.asarray(getattr(motion, name))[None])
                for name in {"x_mm", "y_mm"} - set(root):
                    root.create_array(name, data=getattr(motion, name))
        for stream, names in STREAMS.items():
            samples = of_press(episode.run, episode.line, stream, episode.press)
            for name in names:
                streams[stream].add(name, values_of(samples, FIELDS[name][1]))
            streams[stream].add(PRESS, np.full(len(samples), at, np.int32))
            counts[stream] += len(samples)
        presses.append({"run": episode.run.meta["name"], "press": episode.press,
                        "indenter": episode.indenter, "first_frame": counts["frames"]})  # fmt: skip
        counts["frames"] += n
    for part in (frames, *streams.values()):
        part.close()
    counts["presses"] = len(presses)
    root.attrs.update({"runs": [described(run) for run in runs], "presses": presses})
    return counts
