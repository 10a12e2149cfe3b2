"""Runs as a LeRobotDataset, version 3.0: numbers in Parquet, images and motion as video.

The layout is what its loader reads (huggingface/lerobot, `datasets`). An episode is a press, which
starts tared and at rest. The format knows one rate, and `timestamp` is a frame's number over it;
when it was really taken stand in `t_press_s` and `time_ns`. Both videos are VP9 in RGB planes: dots
of a few pixels in colour do not outlive the halved colour of other formats (25 dB). Numbers are
float32; the motion is exact to its levels, the image is lossy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from deltact_fab.common import InputError, Progress

from ..files import UNKNOWN_SENSOR, json_bytes
from ..run import Run
from ..streams import FORCE_COLUMNS, POSE_COLUMNS
from .tables import LINE, TABLES, TimeLine, described, of_press

RAW, MOTION = "observation.images.raw", "observation.images.deformation"
MM_PER_LEVEL, REST = 0.025, 128
ABOUT = {
    MOTION: "red and green: x and y of the way of each point of the face since the press's first "
    f"frame, {MM_PER_LEVEL:g} mm per level from {REST}, cut off at 1 and 255; blue: 255 where it "
    "was found in the image, else 0",
    RAW: "as the camera gave it; lossy",
    "timestamp": "frame_index / fps, as the format asks; t_press_s and time_ns say when",
}
RATE_HZ = 10  # of frames at stops, which have none
FILE_FRAMES = 500  # some 300 MB; the loader finds frames to 0.1 ms by float32 s, so not many more
CHUNK_FILES = 1000
QUALITY = {RAW: {"crf": "20", "b": "0"}, MOTION: {"lossless": "1"}}
EVERY = 16  # pixels between those that statistics are of
INDEX = ("frame_index", "episode_index", "index", "task_index")
Stats = dict[str, NDArray[Any]]


def levels(motion: Any) -> NDArray[np.uint8]:
    """(h, w, 3) RGB of a motion, as `ABOUT` says."""
    shift = np.clip(np.rint(motion.shift_mm / MM_PER_LEVEL) + REST, 1, 255)
    return np.dstack([shift, np.where(motion.known, 255, 0)]).astype(np.uint8)


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


class _Part:
    """The n-th file of each kind: whole episodes, numbers held until it ends, videos written."""

    def __init__(self, folder: Path, n: int, rate_hz: int) -> None:
        self._folder, self._rate_hz = folder, rate_hz
        self.chunk, self.file = divmod(n, CHUNK_FILES)
        self.frames = 0
        self.tables: list[Any] = []
        self.rows: list[dict[str, Any]] = []
        self._videos: dict[str, Any] = {}

    def place(self, kind: str, suffix: str) -> Path:
        """Of the file of a kind, its folder made."""
        path = self._folder / kind / f"chunk-{self.chunk:03d}" / f"file-{self.file:03d}.{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def film(self, key: str, image: NDArray[np.uint8]) -> None:
        """Add an image (h, w, 3) RGB to a video."""
        if key not in self._videos:
            out = av.open(self.place(f"videos/{key}", "mp4"), "w")
            options = {"g": "2", "deadline": "realtime", "cpu-used": "8", **QUALITY[key]}
            stream: Any = out.add_stream("libvpx-vp9", rate=self._rate_hz, options=options)
            stream.height, stream.width = image.shape[:2]
            stream.pix_fmt = "gbrp"
            self._videos[key] = out, stream
        out, stream = self._videos[key]
        out.mux(stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")))

    def close(self) -> None:
        """End all files."""
        for out, stream in self._videos.values():
            out.mux(stream.encode())
            out.close()
        if self.rows:
            pq.write_table(pa.concat_tables(self.tables), self.place("data", "parquet"))
            rows = pa.Table.from_pylist(self.rows)
            pq.write_table(rows, self.place("meta/episodes", "parquet"))


def write(
    runs: Sequence[Run], folder: Path, follow: Follow | None, progress: Progress
) -> dict[str, int]:
    """Write the dataset into a new folder; return how many episodes and frames it has.

    Raises InputError for runs of different rates or images, else as `episodes` and its images do.
    """
    rates = {str(run.folder): _rate_hz(run) for run in runs}
    if len(set(rates.values())) > 1:
        raise InputError(f"runs at different rates make no dataset, which has one: {rates} Hz")
    rate_hz = max(1, round(min(rates.values())))
    tasks: dict[str, int] = {}
    total: dict[str, Stats] = {}
    features: dict[str, Any] = {}
    part, frames, at = _Part(folder, 0, rate_hz), 0, -1
    for at, episode in enumerate(episodes(runs, follow, progress)):
        if part.frames >= FILE_FRAMES:
            part.close()
            part = _Part(folder, part.chunk * CHUNK_FILES + part.file + 1, rate_hz)
        n = len(episode.table)
        known = episode.indenter != UNKNOWN_SENSOR
        task = "press the sensor" + (f" with {episode.indenter}" if known else "")
        columns = {key: _single(values_of(episode.table, c)) for key, c in FIELDS.items()}
        numbers = (np.arange(n), np.full(n, at), np.arange(frames, frames + n),
                   np.full(n, tasks.setdefault(task, len(tasks))))  # fmt: skip
        columns |= dict(zip(INDEX, numbers, strict=True))
        columns["timestamp"] = _single(np.arange(n) / rate_hz)
        part.tables.append(_table(columns))
        where = {"chunk_index": part.chunk, "file_index": part.file}
        row: dict[str, Any] = {
            "episode_index": at, "tasks": [task], "length": n, "dataset_from_index": frames,
            "dataset_to_index": frames + n, "run": str(episode.run.meta["name"]),
            "press": episode.press, "indenter": episode.indenter,
        }  # fmt: skip
        begun = {"from_timestamp": part.frames / rate_hz,
                 "to_timestamp": (part.frames + n) / rate_hz}  # fmt: skip
        pixels = _filmed(episode, part, features, rate_hz)
        for kind in ("data", "meta/episodes"):
            row |= {f"{kind}/{name}": value for name, value in where.items()}
        for key in pixels:
            row |= {f"videos/{key}/{name}": value for name, value in (where | begun).items()}
        for key, values in (columns | pixels).items():
            stats = _stats(values, key in pixels)
            total[key] = _merged(total[key], stats) if key in total else stats
            row |= {f"stats/{key}/{name}": value.tolist() for name, value in stats.items()}
        part.rows.append(row)
        part.frames += n
        frames += n
        for key, values in columns.items():
            names = list(FIELDS.get(key, (key,)))
            features[key] = {"dtype": values.dtype.name, "shape": [len(names)], "names": names}
    part.close()
    info = {
        "codebase_version": "v3.0", "robot_type": "deltact-fab", "fps": rate_hz,
        "total_episodes": at + 1, "total_frames": frames, "total_tasks": len(tasks),
        "chunks_size": CHUNK_FILES, "data_files_size_in_mb": 100, "video_files_size_in_mb": 500,
        "splits": {"train": f"0:{at + 1}"}, "features": features,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    }  # fmt: skip
    meta = folder / "meta"
    (meta / "info.json").write_bytes(json_bytes(info))
    plain = {key: {name: v.tolist() for name, v in stats.items()} for key, stats in total.items()}
    (meta / "stats.json").write_bytes(json_bytes(plain))
    pd.DataFrame({"task_index": tasks.values()}, index=list(tasks)).to_parquet(
        meta / "tasks.parquet"
    )
    about = {"runs": [described(run) for run in runs], "about": ABOUT, "mm_per_level": MM_PER_LEVEL}
    (meta / "deltact-fab.json").write_bytes(json_bytes(about))
    return {"episodes": at + 1, "frames": frames}


def _rate_hz(run: Run) -> float:
    if run.imported:  # no protocol said it
        every_s = np.median(np.diff(run.frames()["t_s"])) if len(run.frames()) > 1 else 0.0
        return 1 / float(every_s) if every_s > 0 else RATE_HZ
    capture = (run.meta.get("protocol") or {}).get("capture") or {}
    return float(capture.get("rate_hz") or RATE_HZ)


def _single(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.float32) if values.dtype == np.float64 else values


def _table(columns: dict[str, NDArray[Any]]) -> Any:
    """As Arrow: a column of vectors is one of lists of one length."""

    def arrow(values: NDArray[Any]) -> Any:
        flat = pa.array(values.ravel())
        return flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, len(values[0]))

    return pa.table({key: arrow(values) for key, values in columns.items()})


def _filmed(
    episode: Episode, part: _Part, features: dict[str, Any], rate_hz: int
) -> dict[str, NDArray[Any]]:
    """Write an episode's videos; return some of their pixels, (n, 3), for statistics."""
    pixels: dict[str, list[NDArray[Any]]] = {}
    for image, motion in episode.images():
        for key, shown in ((RAW, image), (MOTION, None if motion is None else levels(motion))):
            if shown is None:
                continue
            told = {
                "dtype": "video", "shape": list(shown.shape),
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": shown.shape[0], "video.width": shown.shape[1],
                    "video.channels": 3, "video.codec": "vp9", "video.pix_fmt": "gbrp",
                    "video.fps": rate_hz, "video.is_depth_map": False, "has_audio": False,
                },
            }  # fmt: skip
            if features.setdefault(key, told) != told:
                raise InputError(f"{episode.run.folder}: {episode.press}: images of another size")
            part.film(key, shown)
            pixels.setdefault(key, []).append(shown[::EVERY, ::EVERY].reshape(-1, 3))
    return {key: np.concatenate(seen) for key, seen in pixels.items()}


def _stats(values: NDArray[Any], picture: bool) -> Stats:
    """By column, what is not known (nan) left out; of a picture in [0, 1], channels (3, 1, 1)."""
    rows = np.asarray(values, float).reshape(len(values), -1) / (255 if picture else 1)
    rows = np.where(np.isfinite(rows).any(axis=0), rows, 0.0)
    told = {"min": np.nanmin(rows, axis=0), "max": np.nanmax(rows, axis=0),
            "mean": np.nanmean(rows, axis=0), "std": np.nanstd(rows, axis=0)}  # fmt: skip
    shaped = {name: value.reshape(3, 1, 1) if picture else value for name, value in told.items()}
    return shaped | {"count": np.array([len(rows)])}


def _merged(a: Stats, b: Stats) -> Stats:
    share = b["count"] / (count := a["count"] + b["count"])
    way = b["mean"] - a["mean"]
    spread = a["std"] ** 2 * (1 - share) + b["std"] ** 2 * share + way**2 * share * (1 - share)
    return {
        "min": np.minimum(a["min"], b["min"]), "max": np.maximum(a["max"], b["max"]),
        "mean": a["mean"] + share * way, "std": np.sqrt(spread), "count": count,
    }  # fmt: skip
