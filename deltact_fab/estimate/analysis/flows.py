"""Flow at the settled frames of a press, cached by content so that a press is tracked once."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from deltact_fab.bench import Run
from deltact_fab.common import Array, InputError, Store, code_digest

from ..measure.face import FaceFlow
from ..measure.flow.tracker import FlowTracker
from ..measure.health import RestPattern
from .runs import camera_of, settled_rows

_FLOW_STORE = Store("face-flow", limit_bytes=2 << 30)
MAP_EVERY_PX = 4  # of maps drawn or exported; by hand: finer maps take longer to draw and store


def flow_key(run: Run, press: str) -> str:
    """Return a hash of the flows' inputs: images up to the last settled one, camera, code."""
    frames = run.frames(press)
    chosen = settled_rows(frames)
    followed = frames[frames["seq"] <= chosen["seq"].max()]
    text = hashlib.sha256()
    text.update(
        code_digest(
            "estimate.measure.flow.tracker", "estimate.measure.face", "bench.record.run"
        ).encode()
    )
    for seq, sha256 in zip(followed["seq"], followed["sha256"], strict=True):
        text.update(f"{sha256} {seq in set(chosen['seq'])}\n".encode())
    text.update(repr(camera_of(run).as_dict()).encode())
    flat = run.folder / "camera.flat.png"
    text.update(flat.read_bytes() if flat.is_file() else b"")
    return text.hexdigest()


def settled_flows(run: Run, press: str, spacing_px: int) -> list[FaceFlow]:
    """The face's flow at each settled frame of a press, from its first frame on.

    Frames in between are tracked and not kept. Raises RunFailed for an unreadable image,
    SensorError for a first one without a pattern, InputError for an imported run without a dense
    pattern.
    """
    key = {"of": flow_key(run, press), "every_px": spacing_px}
    flows: list[FaceFlow] | None = _FLOW_STORE.read(key)
    if flows is None:
        flows = _track_press(run, press, spacing_px)
        _FLOW_STORE.write(key, flows)
    return flows


def open_follower(run: Run) -> Callable[[Array], FaceFlow]:
    """Open a tracker for the images of a press, to be called with each in order (`Run.image`)."""
    tracker = _tracker()
    return lambda image: FaceFlow.from_flow(tracker.update(image), run.camera, MAP_EVERY_PX)


def _tracker() -> FlowTracker:
    import cv2

    cv2.setNumThreads(1)  # the flow depends on their number
    return FlowTracker(full=False)


def _track_press(run: Run, press: str, spacing_px: int) -> list[FaceFlow]:
    tracker, frames, camera = _tracker(), run.frames(press), camera_of(run)
    settled_seq = set(settled_rows(frames)["seq"])
    if run.imported and (
        lacks := RestPattern.recognise(run.image(str(frames["file"].iloc[0]))).lacks
    ):
        # The tracker would interpolate between markers, and call that trusted.
        raise InputError(f"{run.folder}: {lacks}; force and shape need a dense pattern")
    flows = []
    for row in frames.itertuples():
        if row.seq > max(settled_seq):
            break
        observed = tracker.update(run.image(str(row.file)))
        if row.seq in settled_seq:
            flows.append(FaceFlow.from_flow(observed, camera, spacing_px=spacing_px))
    return flows
