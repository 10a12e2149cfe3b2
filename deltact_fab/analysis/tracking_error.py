"""Tracking error of dense flow: at the dots as the paper has it, and off the dots against truth.

The paper's error (Eq. 7) compares the flow with the white dots, which are features themselves and
flatter the flow; on a virtual rig the truth is known everywhere, so the error of the pattern
between the dots is reported beside it. An error is the endpoint error of the projected motion in
pixels times mm/px at rest. In-plane surface motion is another figure: what remains when the
projected flow is taken for it stands in its own column.
"""

from __future__ import annotations

import io
import json
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .. import record
from ..errors import InputError, RunFailed
from ..measure.flow import FLOW_METHODS, FlowTracker, Reference, Renewal
from ..occlusion import in_dispute
from ..optics import CameraModel

if TYPE_CHECKING:
    import pandas as pd

PAPER_BEST_MM = 0.08  # Pattern Selection: d = 0.075, r = 0.6, real sensor, at the dots
MOVING_MM = 0.1
DEFAULT_METHODS = (
    "dis-medium",
    "dis-fast",
    "farneback",
    "dis-medium/static",
    "dis-medium/summed-every",
    "dis-medium/composed-every",
)
# How the flow is kept from the first image on: the reference's bookkeeping and its renewal.
REFERENCES: dict[str, tuple[Reference, Renewal]] = {
    "composed": ("composed", "adaptive"),
    "summed": ("summed", "adaptive"),
    "static": ("static", "adaptive"),
    "composed-every": ("composed", "every-frame"),
    "summed-every": ("summed", "every-frame"),
}
BIN_MM = 1e-4
BINS = 50_000  # errors beyond 5 mm fall into the last bin
DOT_MARGIN_PX = 3.0
ARROW_STEP_PX = 26


@dataclass
class Tally:
    """Sums over frames of one method and one indenter; percentiles from a 0.1 um histogram."""

    dots_sum: float = 0.0
    dots_n: int = 0
    moving_dots_sum: float = 0.0
    moving_dots_n: int = 0
    still_sum: float = 0.0
    still_n: int = 0
    in_plane_sum: float = 0.0
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS, np.int64))
    off_sum: float = 0.0
    off_n: int = 0
    peak_true_mm: float = 0.0
    peak_in_plane_mm: float = 0.0
    ms: list[float] = field(default_factory=list)
    switches: int = 0
    bad_frames: int = 0

    def add(self, other: Tally) -> None:
        """Join the sums of another part of the run."""
        for name in (
            "dots_sum", "dots_n", "moving_dots_sum", "moving_dots_n", "still_sum", "still_n",
            "in_plane_sum", "off_sum", "off_n", "switches", "bad_frames",
        ):  # fmt: skip
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.histogram = self.histogram + other.histogram
        self.peak_true_mm = max(self.peak_true_mm, other.peak_true_mm)
        self.peak_in_plane_mm = max(self.peak_in_plane_mm, other.peak_in_plane_mm)
        self.ms += other.ms

    def figures(self) -> dict[str, Any]:
        """The figures of the report; None where nothing was measured."""
        p95 = None
        if self.off_n:
            p95 = float(np.searchsorted(np.cumsum(self.histogram), 0.95 * self.off_n) + 1) * BIN_MM
        return {
            "mean_at_dots_mm": _ratio(self.dots_sum, self.dots_n),
            "mean_at_moving_dots_mm": _ratio(self.moving_dots_sum, self.moving_dots_n),
            "mean_off_dots_mm": _ratio(self.off_sum, self.off_n),
            "p95_off_dots_mm": p95,
            "mean_still_mm": _ratio(self.still_sum, self.still_n),
            "mean_as_in_plane_mm": _ratio(self.in_plane_sum, self.off_n),
            "n_moving_px": self.off_n,
            "n_dots": self.dots_n,
            "peak_true_mm": self.peak_true_mm if self.off_n or self.still_n else None,
            "peak_in_plane_mm": self.peak_in_plane_mm if self.off_n or self.still_n else None,
            "ms_per_frame": float(np.median(self.ms)) if self.ms else None,
            "reference_switches": self.switches,
            "frames_with_bad_match": self.bad_frames,
        }


@dataclass
class DotTally:
    """Errors of the dots themselves against truth, and how many were lost."""

    errors_mm: list[float] = field(default_factory=list)
    lost: int = 0
    seen: int = 0

    def figures(self) -> dict[str, Any]:
        """Mean and 95th percentile against truth (None on a real rig), lost dots."""
        e = np.asarray(self.errors_mm)
        return {
            "mean_vs_truth_mm": float(e.mean()) if e.size else None,
            "p95_vs_truth_mm": float(np.percentile(e, 95)) if e.size else None,
            "max_vs_truth_mm": float(e.max()) if e.size else None,
            "seen": self.seen,
            "lost": self.lost,
        }


@dataclass
class TrackingResult:
    """Everything that `analyze tracking` prints and draws."""

    methods: list[dict[str, Any]]
    by_indenter: list[dict[str, Any]]
    dots: dict[str, Any]
    frames: pd.DataFrame
    arrows: dict[str, NDArray[np.float32]]
    """Flow (px) of the first method at every ARROW_STEP_PX pixel, (rows, cols, 2), by frame id."""
    mm_per_px: float
    simulated: bool
    seed: int

    def as_dict(self) -> dict[str, Any]:
        """Plain data, without the table of frames."""
        return {
            "simulated": self.simulated,
            "seed": self.seed,
            "mm_per_px": self.mm_per_px,
            "moving_threshold_mm": MOVING_MM,
            "paper": {
                "best_mean_at_dots_mm": PAPER_BEST_MM,
                "note": "real sensor, d = 0.075 mm, r = 0.6, five indenters to 10 mm",
            },
            "dots": self.dots,
            "methods": self.methods,
            "by_indenter": self.by_indenter,
        }

    def save(self, folder: Path) -> list[Path]:
        """Write tracking.json, tracking.csv (one row a frame and method) and the arrows."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as why:
            raise RunFailed(f"{folder}: cannot be made: {why.strerror}; name --out") from why
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
            record.write_whole(folder / name, data)
        return [folder / name for name in files]

    @classmethod
    def load(cls, folder: Path) -> TrackingResult:
        """Read what `save` wrote. Raises InputError when it is not there or does not parse."""
        import pandas as pd

        try:
            data = json.loads((folder / "tracking.json").read_text())
            frames = pd.read_csv(folder / "tracking.csv")
            with np.load(folder / "arrows.npz") as stored:
                arrows = {key.replace("|", "/"): stored[key] for key in stored.files}
            return cls(
                data["methods"], data["by_indenter"], data["dots"], frames, arrows,
                data["mm_per_px"], data["simulated"], data["seed"],
            )  # fmt: skip
        except (OSError, ValueError, KeyError) as why:
            raise InputError(f"{folder}: no readable tracking analysis: {why}") from why


PressResult = tuple[
    dict[str, Tally], DotTally, list[dict[str, Any]], dict[str, NDArray[np.float32]]
]


@dataclass(frozen=True)
class Job:
    """One press of one run under some methods: a pure function of the run folder."""

    folder: str
    press: str
    methods: tuple[str, ...]


def split_name(name: str) -> tuple[str, str]:
    """`method` or `method/reference` to its two parts. Raises InputError naming what is valid."""
    method, _, reference = name.partition("/")
    reference = reference or "composed"
    if method not in FLOW_METHODS:
        raise InputError(f"flow method {method!r}: valid: {', '.join(FLOW_METHODS)}")
    if reference not in REFERENCES:
        raise InputError(f"flow reference {reference!r}: valid: {', '.join(REFERENCES)}")
    return method, reference


def analyse(
    folder: str | Path,
    methods: Sequence[str] = DEFAULT_METHODS,
    executor: Executor | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> TrackingResult:
    """Tracking error of every method over a whole run, press by press in parallel.

    Raises InputError for an unknown method or a run without images or dots.
    """
    for name in methods:
        split_name(name)
    run = record.open(folder)
    frames = run.frames()
    if not run.finished:
        raise InputError(f"{folder}: the run is not finished; go on with `run --resume`")
    if frames.empty or frames["file"].isna().any():
        raise InputError(f"{folder}: no images were recorded; tracking needs the channel 'image'")
    presses = list(dict.fromkeys(frames["press"]))
    indenter_of = dict(zip(frames["press"], frames["indenter"], strict=True))
    jobs = [Job(str(folder), press, tuple(methods)) for press in presses]
    if executor is not None:
        results = _collect(executor, jobs, progress)
    else:
        with ProcessPoolExecutor(
            max_workers=min(2, len(jobs)), mp_context=multiprocessing.get_context("spawn")
        ) as local:
            results = _collect(local, jobs, progress)
    return _assemble(run, results, indenter_of, methods)


def _collect(
    executor: Executor, jobs: list[Job], progress: Callable[[int, int, str], None] | None
) -> list[PressResult]:
    futures = [executor.submit(analyse_press, job) for job in jobs]
    results = []
    for done, (job, future) in enumerate(zip(jobs, futures, strict=True), start=1):
        results.append(future.result())
        if progress is not None:
            progress(done, len(jobs), job.press)
    return results


def _assemble(
    run: record.Run,
    results: list[PressResult],
    indenter_of: dict[str, str],
    methods: Sequence[str],
) -> TrackingResult:
    import pandas as pd

    total = {name: Tally() for name in methods}
    parts: dict[tuple[str, str], Tally] = {}
    dots = DotTally()
    rows: list[dict[str, Any]] = []
    arrows: dict[str, NDArray[np.float32]] = {}
    for (tallies, seen, part, drawn), indenter in zip(results, indenter_of.values(), strict=True):
        for name, tally in tallies.items():
            total[name].add(tally)
            parts.setdefault((name, indenter), Tally()).add(tally)
        dots.errors_mm += seen.errors_mm
        dots.lost += seen.lost
        dots.seen += seen.seen
        rows += part
        arrows.update(drawn)
    return TrackingResult(
        methods=[{"name": name, **tally.figures()} for name, tally in total.items()],
        by_indenter=[
            {"name": name, "indenter": indenter, **tally.figures()}
            for (name, indenter), tally in parts.items()
        ],
        dots=dots.figures(),
        frames=pd.DataFrame(rows),
        arrows=arrows,
        mm_per_px=run.camera.mm_per_px,
        simulated=run.simulated,
        seed=int(run.meta["seed"]),
    )


def analyse_press(job: Job) -> PressResult:
    """All frames of one press: the first one is the reference of flow and dots."""
    import cv2

    from ..measure.dots import DotTracker

    cv2.setNumThreads(1)  # one thread, so that milliseconds compare
    run = record.open(job.folder)
    camera, truth = run.camera, run.truth()
    scale = camera.mm_per_px
    frames = run.frames(job.press)
    dots_mm = run.dots_mm()
    if not len(dots_mm):
        raise InputError(f"{job.folder}: the pattern has no dots; the error at the dots needs them")
    tracker = DotTracker(camera.rest_px(dots_mm), run.dot_diameter_mm() / scale)
    flows = {}
    for name in job.methods:
        method, reference = split_name(name)
        flows[name] = FlowTracker(method, *REFERENCES[reference])
    off = _off_dots(camera, dots_mm, run.dot_diameter_mm() / 2 / scale + DOT_MARGIN_PX)
    tallies = {name: Tally() for name in job.methods}
    dots, rows, arrows = DotTally(), [], {}
    start_px: NDArray[np.float64] | None = None
    for at, row in enumerate(frames.itertuples()):
        image = run.image(str(row.file))
        if image.shape[:2] != (camera.height_px, camera.width_px):
            raise RunFailed(f"{row.file}: size {image.shape[1]} x {image.shape[0]} differs")
        seen = tracker.update(image)
        if start_px is None:
            start_px = seen.position_px.copy()
        moved_px = seen.position_px - start_px
        frame = _TrueFrame.read(truth, str(row.frame_id), off, dots_mm, scale) if truth else None
        _tally_dots(dots, moved_px, frame, scale)
        for name, flow_tracker in flows.items():
            observed = flow_tracker.update(image)
            flow, last = observed.flow_px, observed.diagnostics
            tally = tallies[name]
            if name == job.methods[0]:
                half = ARROW_STEP_PX // 2
                arrows[str(row.frame_id)] = flow[half::ARROW_STEP_PX, half::ARROW_STEP_PX].copy()
            if at == 0:
                continue  # the reference compared with itself is no measurement
            figures = _tally_frame(tally, flow, start_px, moved_px, frame, scale)
            tally.ms.append(last.cpu_ms)
            tally.bad_frames += int(not last.trusted)
            tally.switches = last.n_reference_switches
            rows.append(
                {
                    "frame_id": row.frame_id,
                    "seq": row.seq,
                    "press": row.press,
                    "indenter": row.indenter,
                    "step_id": row.step_id,
                    "method": name,
                    **figures,
                    "ms": last.cpu_ms,
                }
            )
    return tallies, dots, rows, arrows


@dataclass(frozen=True)
class _TrueFrame:
    """Truth of one frame, cut into moving and still pixels off the dots."""

    flow_px: NDArray[np.float64]
    in_plane_mm: NDArray[np.float64]
    moving: NDArray[np.bool_]
    still: NDArray[np.bool_]
    dots_px: NDArray[np.float64]
    peak_mm: float
    peak_in_plane_mm: float

    @classmethod
    def read(
        cls,
        truth: record.Truth,
        frame_id: str,
        off: NDArray[np.bool_],
        dots_mm: NDArray[np.float64],
        scale: float,
    ) -> _TrueFrame:
        flow = truth.flow_px(frame_id)
        in_plane = truth.in_plane_mm(frame_id)
        h, w = off.shape
        y, x = np.mgrid[:h, :w]
        to_x, to_y = x + flow[..., 0], y + flow[..., 1]
        visible = (to_x >= 0) & (to_x <= w - 1) & (to_y >= 0) & (to_y <= h - 1)
        # Where a steep flank hides what is behind it, no one point of the face is the true one.
        disputed = in_dispute(np.stack((to_x, to_y), -1), off.shape)
        ends = np.rint(to_y[visible]).astype(int), np.rint(to_x[visible]).astype(int)
        visible[visible] = ~disputed[ends]
        length_mm = np.hypot(flow[..., 0], flow[..., 1]) * scale
        moving = visible & off & (length_mm >= MOVING_MM)
        still = visible & off & (length_mm < MOVING_MM)
        return cls(
            flow,
            in_plane,
            moving,
            still,
            truth.points_px(frame_id, dots_mm),
            float(length_mm[visible].max()),
            float(np.hypot(in_plane[..., 0], in_plane[..., 1])[visible].max()),
        )


def _off_dots(
    camera: CameraModel, dots_mm: NDArray[np.float64], radius_px: float
) -> NDArray[np.bool_]:
    """Rest pixels that lie on no dot, with a margin for its blurred edge."""
    import cv2

    mask = np.ones((camera.height_px, camera.width_px), np.uint8)
    for x, y in camera.rest_px(dots_mm):
        cv2.circle(mask, (round(x), round(y)), int(np.ceil(radius_px)), 0, -1)
    return mask.astype(bool)


def _tally_dots(
    dots: DotTally, moved_px: NDArray[np.float64], frame: _TrueFrame | None, scale: float
) -> None:
    found = np.isfinite(moved_px[:, 0])
    dots.seen += int(found.sum())
    dots.lost += int((~found).sum())
    if frame is not None:
        errors = np.linalg.norm(moved_px[found] - frame.dots_px[found], axis=1) * scale
        dots.errors_mm += [float(e) for e in errors]


def _tally_frame(
    tally: Tally,
    flow: NDArray[np.float32],
    start_px: NDArray[np.float64],
    moved_px: NDArray[np.float64],
    frame: _TrueFrame | None,
    scale: float,
) -> dict[str, Any]:
    found = np.isfinite(moved_px[:, 0]) & np.isfinite(start_px[:, 0])
    at_dots = _sample(flow, start_px[found])
    dot_errors = np.linalg.norm(at_dots - moved_px[found], axis=1) * scale
    tally.dots_sum += float(dot_errors.sum())
    tally.dots_n += len(dot_errors)
    moved_mm = np.linalg.norm(moved_px[found], axis=1) * scale
    tally.moving_dots_sum += float(dot_errors[moved_mm >= MOVING_MM].sum())
    tally.moving_dots_n += int((moved_mm >= MOVING_MM).sum())
    figures: dict[str, Any] = {"mean_at_dots_mm": _ratio(dot_errors.sum(), len(dot_errors))}
    if frame is None:
        return figures
    errors = np.linalg.norm(flow - frame.flow_px, axis=-1) * scale
    moving = errors[frame.moving]
    tally.off_sum += float(moving.sum())
    tally.off_n += moving.size
    index = np.minimum((moving / BIN_MM).astype(np.int64), BINS - 1)
    tally.histogram += np.bincount(index, minlength=BINS)
    tally.still_sum += float(errors[frame.still].sum())
    tally.still_n += int(frame.still.sum())
    as_plane = np.linalg.norm(flow[frame.moving] * scale - frame.in_plane_mm[frame.moving], axis=-1)
    tally.in_plane_sum += float(as_plane.sum())
    tally.peak_true_mm = max(tally.peak_true_mm, frame.peak_mm)
    tally.peak_in_plane_mm = max(tally.peak_in_plane_mm, frame.peak_in_plane_mm)
    return {
        **figures,
        "mean_off_dots_mm": _ratio(moving.sum(), moving.size),
        "p95_off_dots_mm": float(np.percentile(moving, 95)) if moving.size else None,
        "n_moving_px": moving.size,
        "peak_true_mm": frame.peak_mm,
    }


def _sample(flow: NDArray[np.float32], px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Flow (h, w, 2) at points (n, 2) px, bilinear in float64."""
    h, w = flow.shape[:2]
    x = np.clip(px[:, 0], 0, w - 1.001)
    y = np.clip(px[:, 1], 0, h - 1.001)
    i, j = y.astype(int), x.astype(int)
    a, b = (y - i)[:, None], (x - j)[:, None]
    top = flow[i, j] * (1 - b) + flow[i, j + 1] * b
    bottom = flow[i + 1, j] * (1 - b) + flow[i + 1, j + 1] * b
    return np.asarray(top * (1 - a) + bottom * a, float)


def _ratio(total: float, count: int) -> float | None:
    return float(total) / count if count else None
