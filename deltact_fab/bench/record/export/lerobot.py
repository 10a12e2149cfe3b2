"""Export of runs as a LeRobotDataset v3.0: numbers in Parquet, images and motion as video.

The layout is what its loader reads (huggingface/lerobot, `datasets`). An episode is a press, which
starts tared and at rest. The format has one rate, and `timestamp` is the frame number over it;
`t_press_s` and `time_ns` hold the true times. Both videos are VP9 in RGB planes: chroma subsampling
would blur coloured dots of a few pixels (25 dB). Numbers are
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
from .tables import TABLE_COLUMNS, TIME_COLUMN, TimeLine, describe_run, press_rows

RAW_KEY, MOTION_KEY = "observation.images.raw", "observation.images.deformation"
MM_PER_LEVEL, REST_LEVEL = 0.025, 128  # by hand: 8 bits for +-3.2 mm; finer steps clip sooner
FEATURE_TEXTS = {
    MOTION_KEY: "red and green: x and y displacement of each point of the face since the press's "
    f"first frame, {MM_PER_LEVEL:g} mm per level from {REST_LEVEL}, clipped to 1 to 255; blue: 255 "
    "where the point was found in the image, else 0",
    RAW_KEY: "raw camera image; lossy",
    "timestamp": "frame_index / fps, as the format requires; true times: t_press_s, time_ns",
}
STOP_RATE_HZ = 10  # by hand: nominal, for frames at stops, which have no rate
FILE_FRAMES = 500  # about 300 MB; format: the loader seeks to 0.1 ms in float32 s
CHUNK_FILES = 1000  # format: LeRobot's default chunks_size
VIDEO_OPTIONS = {RAW_KEY: {"crf": "20", "b": "0"}, MOTION_KEY: {"lossless": "1"}}
STATS_STRIDE_PX = 16  # by hand: every 16th pixel counts in the statistics; fewer bias them
INDEX_FEATURES = ("frame_index", "episode_index", "index", "task_index")
Stats = dict[str, NDArray[Any]]


def levels(motion: Any) -> NDArray[np.uint8]:
    """Image (h, w, 3) RGB of a motion, encoded as `FEATURE_TEXTS` states."""
    shift = np.clip(np.rint(motion.shift_mm / MM_PER_LEVEL) + REST_LEVEL, 1, 255)
    return np.dstack([shift, np.where(motion.known, 255, 0)]).astype(np.uint8)


CONTACT_FORCE_N = 0.1  # by hand: several times the sensor noise; lower gives false contacts
_TARGET_COLUMNS = ("target_x_mm", "target_y_mm", "target_z_mm")
_ADDED_COLUMNS = {"contact": "int8", **dict.fromkeys(_TARGET_COLUMNS, "float64")}
EPISODE_COLUMNS = TABLE_COLUMNS["frames"] | _ADDED_COLUMNS
"""contact: 1 if fz_n < -CONTACT_FORCE_N or, without a force, z_mm < 0; else 0; -1 if neither is
recorded. target: end point of the current step."""

FEATURE_COLUMNS: dict[str, tuple[str, ...]] = {
    "time_ns": (TIME_COLUMN,),
    "t_press_s": ("t_press_s",),
    "seq": ("seq",),
    "settled": ("settled",),
    "observation.state": POSE_COLUMNS,
    "observation.wrench": FORCE_COLUMNS,
    "observation.contact": ("contact",),
    "action": _TARGET_COLUMNS,
}
"""Columns that make up each feature of the dataset."""

Follow = Callable[[Run], Callable[[NDArray[np.uint8]], Any]]
"""Factory of a tracker of one press, from its first image on (`record` imports no tracker).

The tracker returns the motion at points of the face: shift_mm (h, w, 2), known (h, w), x_mm (w,),
y_mm (h,), trusted."""


def values_of(table: pd.DataFrame, columns: tuple[str, ...]) -> NDArray[Any]:
    """Values (n,) of one column, (n, columns) of several; nan for a missing float."""
    values = table[list(columns)].to_numpy(EPISODE_COLUMNS[columns[0]])
    return values if len(columns) > 1 else values[:, 0]


@dataclass(frozen=True)
class Episode:
    """A press with frames. table: its frames, `EPISODE_COLUMNS`; follow: None for no motion."""

    run: Run
    line: TimeLine
    press: str
    table: pd.DataFrame
    follow: Follow | None

    @property
    def indenter(self) -> str:
        """Name of the mounted indenter."""
        return str(self.table["indenter"].iloc[0])

    def images(self) -> Iterator[tuple[NDArray[np.uint8], Any]]:
        """Yield the raw image (h, w, 3) RGB and the motion of each frame.

        Empty for a run without images. Raises as `Run.image` and the tracker do.
        """
        track = self.follow(self.run) if self.follow and self.run.meta["camera"] else None
        for file in self.table["file"].dropna():
            raw = self.run.raw(file)
            motion = track(self.run.image(file)) if track else None
            yield np.asarray(cv2.cvtColor(raw, cv2.COLOR_BGR2RGB), np.uint8), motion


def episodes(runs: Sequence[Run], follow: Follow | None, progress: Progress) -> Iterator[Episode]:
    """Yield all presses with frames, run by run in the order they began.

    Raises InputError if there is none, or if only some have images.
    """
    lines = [TimeLine.from_run(run) for run in runs]
    count, total, has_images = 0, sum(len(line.presses) for line in lines), set()
    for run, line in zip(runs, lines, strict=True):
        for press in line.presses:
            count += 1
            table = press_rows(run, line, "frames", press)
            if table.empty:  # a change of the indenter
                continue
            has_images.add(bool(table["file"].notna().all()))
            if len(has_images) > 1:
                raise InputError(f"{run.folder}: {press}: only some frames have images")
            yield Episode(run, line, press, _with_targets(run, line, press, table), follow)
            progress(count, total, press)
    if not has_images:
        raise InputError(f"{runs[0].folder}: no press has frames")


def _with_targets(run: Run, line: TimeLine, press: str, table: pd.DataFrame) -> pd.DataFrame:
    """Add targets and contact to the frames of a press."""
    targets = press_rows(run, line, "steps", press).set_index("step_id")[list(POSE_COLUMNS)]
    target_columns = targets.rename(columns=dict(zip(POSE_COLUMNS, _TARGET_COLUMNS, strict=True)))
    fz_n, z_mm = table["fz_n"], table["z_mm"]
    contact = np.select([fz_n.notna(), z_mm.notna()], [fz_n < -CONTACT_FORCE_N, z_mm < 0], -1)
    return table.join(target_columns, on="step_id").assign(contact=contact.astype(np.int8))


class _FilePart:
    """n-th file of each kind: whole episodes; tables are written at the end, videos at once."""

    def __init__(self, folder: Path, n: int, rate_hz: int) -> None:
        self._folder, self._rate_hz = folder, rate_hz
        self.chunk, self.file = divmod(n, CHUNK_FILES)
        self.frames = 0
        self.tables: list[Any] = []
        self.rows: list[dict[str, Any]] = []
        self._videos: dict[str, Any] = {}

    def place(self, kind: str, suffix: str) -> Path:
        """Path of the file of a kind; creates its folder."""
        path = self._folder / kind / f"chunk-{self.chunk:03d}" / f"file-{self.file:03d}.{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def film(self, key: str, image: NDArray[np.uint8]) -> None:
        """Add an image (h, w, 3) RGB to a video."""
        if key not in self._videos:
            out = av.open(self.place(f"videos/{key}", "mp4"), "w")
            options = {"g": "2", "deadline": "realtime", "cpu-used": "8", **VIDEO_OPTIONS[key]}
            stream: Any = out.add_stream("libvpx-vp9", rate=self._rate_hz, options=options)
            stream.height, stream.width = image.shape[:2]
            stream.pix_fmt = "gbrp"
            self._videos[key] = out, stream
        out, stream = self._videos[key]
        out.mux(stream.encode(av.VideoFrame.from_ndarray(image, "rgb24")))

    def close(self) -> None:
        """Close all files."""
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
    """Write the dataset into a new folder; return its numbers of episodes and frames.

    Raises InputError for runs with different rates or image sizes, else as `episodes` does.
    """
    rates = {str(run.folder): _rate_hz(run) for run in runs}
    if len(set(rates.values())) > 1:
        raise InputError(f"a dataset needs one frame rate; runs have {rates} Hz")
    rate_hz = max(1, round(min(rates.values())))
    tasks: dict[str, int] = {}
    total: dict[str, Stats] = {}
    features: dict[str, Any] = {}
    part, frames, index = _FilePart(folder, 0, rate_hz), 0, -1
    for index, episode in enumerate(episodes(runs, follow, progress)):
        if part.frames >= FILE_FRAMES:
            part.close()
            part = _FilePart(folder, part.chunk * CHUNK_FILES + part.file + 1, rate_hz)
        n = len(episode.table)
        has_indenter = episode.indenter != UNKNOWN_SENSOR
        task = "press the sensor" + (f" with {episode.indenter}" if has_indenter else "")
        columns = {key: _single(values_of(episode.table, c)) for key, c in FEATURE_COLUMNS.items()}
        numbers = (np.arange(n), np.full(n, index), np.arange(frames, frames + n),
                   np.full(n, tasks.setdefault(task, len(tasks))))  # fmt: skip
        columns |= dict(zip(INDEX_FEATURES, numbers, strict=True))
        columns["timestamp"] = _single(np.arange(n) / rate_hz)
        part.tables.append(_table(columns))
        location = {"chunk_index": part.chunk, "file_index": part.file}
        row: dict[str, Any] = {
            "episode_index": index, "tasks": [task], "length": n, "dataset_from_index": frames,
            "dataset_to_index": frames + n, "run": str(episode.run.meta["name"]),
            "press": episode.press, "indenter": episode.indenter,
        }  # fmt: skip
        time_span = {"from_timestamp": part.frames / rate_hz,
                 "to_timestamp": (part.frames + n) / rate_hz}  # fmt: skip
        pixels = _write_videos(episode, part, features, rate_hz)
        for kind in ("data", "meta/episodes"):
            row |= {f"{kind}/{name}": value for name, value in location.items()}
        for key in pixels:
            row |= {f"videos/{key}/{name}": value for name, value in (location | time_span).items()}
        for key, values in (columns | pixels).items():
            stats = _stats(values, key in pixels)
            total[key] = _merge_stats(total[key], stats) if key in total else stats
            row |= {f"stats/{key}/{name}": value.tolist() for name, value in stats.items()}
        part.rows.append(row)
        part.frames += n
        frames += n
        for key, values in columns.items():
            names = list(FEATURE_COLUMNS.get(key, (key,)))
            features[key] = {"dtype": values.dtype.name, "shape": [len(names)], "names": names}
    part.close()
    info = {
        "codebase_version": "v3.0", "robot_type": "deltact-fab", "fps": rate_hz,
        "total_episodes": index + 1, "total_frames": frames, "total_tasks": len(tasks),
        "chunks_size": CHUNK_FILES, "data_files_size_in_mb": 100, "video_files_size_in_mb": 500,
        "splits": {"train": f"0:{index + 1}"}, "features": features,
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
    described = [describe_run(run) for run in runs]
    about = {"runs": described, "about": FEATURE_TEXTS, "mm_per_level": MM_PER_LEVEL}
    (meta / "deltact-fab.json").write_bytes(json_bytes(about))
    return {"episodes": index + 1, "frames": frames}


def _rate_hz(run: Run) -> float:
    if run.imported:  # an import has no protocol
        every_s = np.median(np.diff(run.frames()["t_s"])) if len(run.frames()) > 1 else 0.0
        return 1 / float(every_s) if every_s > 0 else STOP_RATE_HZ
    capture = (run.meta.get("protocol") or {}).get("capture") or {}
    return float(capture.get("rate_hz") or STOP_RATE_HZ)


def _single(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(np.float32) if values.dtype == np.float64 else values


def _table(columns: dict[str, NDArray[Any]]) -> Any:
    """Arrow table; a column of vectors becomes one of fixed-size lists."""

    def arrow(values: NDArray[Any]) -> Any:
        flat = pa.array(values.ravel())
        return flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, len(values[0]))

    return pa.table({key: arrow(values) for key, values in columns.items()})


def _write_videos(
    episode: Episode, part: _FilePart, features: dict[str, Any], rate_hz: int
) -> dict[str, NDArray[Any]]:
    """Write an episode's videos; return a sample of their pixels (n, 3) for statistics."""
    pixels: dict[str, list[NDArray[Any]]] = {}
    for image, motion in episode.images():
        drawing = None if motion is None else levels(motion)
        for key, picture in ((RAW_KEY, image), (MOTION_KEY, drawing)):
            if picture is None:
                continue
            feature = {
                "dtype": "video", "shape": list(picture.shape),
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": picture.shape[0], "video.width": picture.shape[1],
                    "video.channels": 3, "video.codec": "vp9", "video.pix_fmt": "gbrp",
                    "video.fps": rate_hz, "video.is_depth_map": False, "has_audio": False,
                },
            }  # fmt: skip
            if features.setdefault(key, feature) != feature:
                raise InputError(f"{episode.run.folder}: {episode.press}: image size differs")
            part.film(key, picture)
            sparse = picture[::STATS_STRIDE_PX, ::STATS_STRIDE_PX]
            pixels.setdefault(key, []).append(sparse.reshape(-1, 3))
    return {key: np.concatenate(parts) for key, parts in pixels.items()}


def _stats(values: NDArray[Any], picture: bool) -> Stats:
    """Statistics by column, ignoring nan; of a picture in [0, 1], by channel (3, 1, 1)."""
    rows = np.asarray(values, float).reshape(len(values), -1) / (255 if picture else 1)
    rows = np.where(np.isfinite(rows).any(axis=0), rows, 0.0)
    summary = {"min": np.nanmin(rows, axis=0), "max": np.nanmax(rows, axis=0),
            "mean": np.nanmean(rows, axis=0), "std": np.nanstd(rows, axis=0)}  # fmt: skip
    shaped = {name: value.reshape(3, 1, 1) if picture else value for name, value in summary.items()}
    return shaped | {"count": np.array([len(rows)])}


def _merge_stats(a: Stats, b: Stats) -> Stats:
    share = b["count"] / (count := a["count"] + b["count"])
    shift = b["mean"] - a["mean"]
    spread = a["std"] ** 2 * (1 - share) + b["std"] ** 2 * share + shift**2 * share * (1 - share)
    return {
        "min": np.minimum(a["min"], b["min"]), "max": np.maximum(a["max"], b["max"]),
        "mean": a["mean"] + share * shift, "std": np.sqrt(spread), "count": count,
    }  # fmt: skip
