"""Export of a run as an MCAP file for Foxglove: images, pose and wrench on one time line.

Messages are JSON with Foxglove's own schemas, so the file is self-describing and needs no library
but `mcap`; chunks are packed with zstd, which compensates for base64 in images. Foxglove has no
wrench schema: the message has the fields of ROS's `geometry_msgs/WrenchStamped`. Lengths are in
metres and torques in newton metres, as both require.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from mcap.writer import Writer
from numpy.typing import NDArray

from deltact_fab.common import Progress

from ..images import encode_png
from ..run import Run
from ..streams import FORCE_COLUMNS, POSE_COLUMNS
from .tables import TIME_COLUMN, TimeLine, describe_run, press_rows

MCAP_CHUNK_BYTES = 4 * 1024 * 1024  # by hand: one frame of 1280 x 720 with its samples
SENSOR_FRAME = "sensor"  # frame of reference: the sensor frame, z = 0 at the resting face
CAMERA_FRAME = "camera"
METADATA_TEXTS = {
    "time": "log_time: ns since 1970 UTC: the rig's clock plus one offset per session, which sets "
    "its first event to its wall-clock time, but not before the end of the previous session",
    "units": "positions m, forces N on the sensor (a press has z < 0), torques N m about the "
    "centre of the resting face; frame 'sensor': x width, y length, z out of the sensor",
    "images": "raw camera images, timed by their exposure",
}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_STRING_TYPE, _NUMBER_TYPE, _INTEGER_TYPE, _BOOLEAN_TYPE = (
    {"type": kind} for kind in ("string", "number", "integer", "boolean")
)
_TIME_TYPE = _object(sec=_INTEGER_TYPE, nsec=_INTEGER_TYPE)
_XYZ_TYPE = _object(**dict.fromkeys("xyz", _NUMBER_TYPE))
_POSE_TYPE = _object(position=_XYZ_TYPE, orientation=_object(**dict.fromkeys("xyzw", _NUMBER_TYPE)))
TOPIC_SCHEMAS = {
    "/camera/image": ("foxglove.CompressedImage", _object(
        timestamp=_TIME_TYPE, frame_id=_STRING_TYPE, format=_STRING_TYPE,
        data=_STRING_TYPE | {"contentEncoding": "base64"},
    )),
    "/stage/pose": ("foxglove.PoseInFrame", _object(
        timestamp=_TIME_TYPE, frame_id=_STRING_TYPE, pose=_POSE_TYPE,
    )),
    "/force/wrench": ("geometry_msgs/WrenchStamped", _object(
        header=_object(stamp=_TIME_TYPE, frame_id=_STRING_TYPE), saturated=_BOOLEAN_TYPE,
        wrench=_object(force=_XYZ_TYPE, torque=_XYZ_TYPE),
    )),
}  # fmt: skip
"""Schema name (Foxglove chooses the display by it) and fields of each topic."""
Message = tuple[int, str, dict[str, Any]]  # time ns, topic, JSON content


def write(run: Run, path: Path, progress: Progress) -> dict[str, int]:
    """Write the file; return the number of messages per topic.

    Raises RunFailed for a damaged run, MissingLibrary for JPEG XL without the extra `images`.
    """
    line = TimeLine.from_run(run)
    counts = dict.fromkeys(TOPIC_SCHEMAS, 0)
    with path.open("wb") as out:
        writer = Writer(out, chunk_size=MCAP_CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile="", library="deltact-fab")
        channels = {}
        for topic, (title, fields) in TOPIC_SCHEMAS.items():
            data = json.dumps({"title": title, **fields}).encode()
            schema_id = writer.register_schema(title, "jsonschema", data)
            channels[topic] = writer.register_channel(topic, "json", schema_id)
        metadata = {key: json.dumps(value) for key, value in describe_run(run).items()}
        writer.add_metadata("deltact-fab", {**metadata, **METADATA_TEXTS})
        for time_ns, topic, message in _presses(run, line, progress):
            data = json.dumps(message, separators=(",", ":")).encode()
            writer.add_message(channels[topic], time_ns, data, time_ns, counts[topic])
            counts[topic] += 1
        writer.finish()
    return counts


def _presses(run: Run, line: TimeLine, progress: Progress) -> Iterator[Message]:
    """Yield the messages press by press in order of time; one image in memory at a time."""
    for number, press in enumerate(line.presses, start=1):
        frames, pose, force = (
            press_rows(run, line, name, press).sort_values(TIME_COLUMN, kind="stable")
            for name in ("frames", "pose", "force")
        )
        yield from merge(_frames(run, frames), _poses(pose), _wrenches(force), key=itemgetter(0))
        progress(number, len(line.presses), press)


def _stamp(time_ns: int) -> dict[str, int]:
    sec, nsec = divmod(time_ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _frames(run: Run, table: pd.DataFrame) -> Iterator[Message]:
    for time_ns, file in zip(map(int, table[TIME_COLUMN]), table["file"], strict=True):
        if isinstance(file, str):  # else the step has no image
            data = base64.b64encode(_png(run, file)).decode()
            image = {"timestamp": _stamp(time_ns), "frame_id": CAMERA_FRAME, "data": data}
            yield time_ns, "/camera/image", {**image, "format": "png"}


def _png(run: Run, file: str) -> bytes:
    """Frame as PNG bytes: its own file if it is a PNG, else re-encoded without loss."""
    return run.data(file) if file.endswith(".png") else encode_png(run.raw(file))


def _poses(table: pd.DataFrame) -> Iterator[Message]:
    at_m = table[[*POSE_COLUMNS]].to_numpy(float) / 1e3
    for time_ns, position in zip(map(int, table[TIME_COLUMN]), at_m, strict=True):
        orientation = {"x": 0, "y": 0, "z": 0, "w": 1}
        pose = {"position": _vector(position), "orientation": orientation}
        message = {"timestamp": _stamp(time_ns), "frame_id": SENSOR_FRAME, "pose": pose}
        yield time_ns, "/stage/pose", message


def _wrenches(table: pd.DataFrame) -> Iterator[Message]:
    values = table[[*FORCE_COLUMNS]].to_numpy(float) / (1, 1, 1, 1e3, 1e3, 1e3)
    saturated = table["saturated"].fillna(False).to_numpy(bool)
    for time_ns, wrench, over in zip(map(int, table[TIME_COLUMN]), values, saturated, strict=True):
        message = {
            "header": {"stamp": _stamp(time_ns), "frame_id": SENSOR_FRAME},
            "wrench": {"force": _vector(wrench[:3]), "torque": _vector(wrench[3:])},
            "saturated": bool(over),
        }
        yield time_ns, "/force/wrench", message


def _vector(values: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))
