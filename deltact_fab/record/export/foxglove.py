"""A run as one MCAP file that Foxglove shows: images, pose, wrench and events on one time line.

Messages are JSON with Foxglove's own schemas, so that the file needs no library but `mcap` to be
written and says by itself what it holds; chunks are packed with zstd, which takes back what base64
adds to an image. Foxglove has no schema of a wrench: the message has the fields of ROS's
`geometry_msgs/WrenchStamped`. Lengths are metres and torques newton metres there, as both ask.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...aliases import Progress
from ..images import encode_png
from ..run import Run
from ..timeline import TimeLine
from .tables import LINE, described, events, of_press, presses

CHUNK_BYTES = 4 * 1024 * 1024  # a frame of 1280 x 720 and what was felt with it
SENSOR = "sensor"  # frame of reference: the sensor frame, z = 0 at the resting face
CAMERA = "camera"
ATTACHED = {
    "run.json": "application/json",
    "protocol.toml": "application/toml",
    "pattern.json": "application/json",
    "summary.json": "application/json",
    "notes.jsonl": "application/jsonl",
    "camera.flat.png": "image/png",
}
# Of foxglove.Log: 2 info, 4 error; what is neither is a trouble that a run went on with, 3.
USUAL = ("session", "begin", "homed", "indenter", "begun", "complete", "note")
LEVELS = {**dict.fromkeys(USUAL, 2), "fault": 4, "stop": 4}
ABOUT = {
    "time": "log_time: ns since 1970 UTC; the rig's clock, moved by one offset a session to the "
    "day's time at its first event, and never back behind the session before",
    "units": "positions m, forces N on the sensor (a press has z < 0), torques N m about the "
    "centre of the resting face; frame 'sensor': x width, y length, z out of the sensor",
    "images": "raw, as the camera gave them, in time of exposure",
}


def _object(title: str, **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


def _xyz(title: str) -> dict[str, Any]:
    return _object(title, **{axis: {"type": "number"} for axis in "xyz"})


_STRING = {"type": "string"}
_NUMBER = {"type": "number"}
_INTEGER = {"type": "integer"}
_TIME = _object(
    "time",
    sec={"type": "integer", "minimum": 0},
    nsec={"type": "integer", "minimum": 0, "maximum": 999_999_999},
)
_QUATERNION = _object("foxglove.Quaternion", **dict.fromkeys("xyzw", _NUMBER))
SCHEMAS = {
    "/camera/image": _object(
        "foxglove.CompressedImage",
        timestamp=_TIME,
        frame_id=_STRING,
        data={"type": "string", "contentEncoding": "base64"},
        format=_STRING,
    ),
    "/camera/frame": _object(
        "deltact_fab.Frame",
        timestamp=_TIME,
        id=_STRING,
        press=_STRING,
        step_id=_STRING,
        indenter=_STRING,
        kind=_STRING,
        k=_INTEGER,
        settled={"type": "boolean"},
        late={"type": "boolean"},
        dropped=_INTEGER,
        file=_STRING,
        sha256=_STRING,
    ),
    "/stage/pose": _object(
        "foxglove.PoseInFrame",
        timestamp=_TIME,
        frame_id=_STRING,
        pose=_object("foxglove.Pose", position=_xyz("foxglove.Vector3"), orientation=_QUATERNION),
    ),
    "/force/wrench": _object(
        "geometry_msgs/WrenchStamped",
        header=_object("std_msgs/Header", stamp=_TIME, frame_id=_STRING),
        wrench=_object(
            "geometry_msgs/Wrench",
            force=_xyz("geometry_msgs/Vector3"),
            torque=_xyz("geometry_msgs/Vector3"),
        ),
        saturated={"type": "boolean"},
    ),
    "/events": _object(
        "foxglove.Log",
        timestamp=_TIME,
        level=_INTEGER,
        message=_STRING,
        name=_STRING,
        file=_STRING,
        line=_INTEGER,
    ),
}
Message = tuple[int, str, str]  # time, topic, JSON


def write(run: Run, path: Path, progress: Progress) -> dict[str, int]:
    """Write the file; return how many messages each topic has.

    Raises RunFailed for a damaged run, MissingLibrary for JPEG XL without the extra `images`.
    """
    from mcap.writer import Writer

    line, names = TimeLine.of(run), presses(run)
    counts = dict.fromkeys(SCHEMAS, 0)
    with path.open("wb") as out:
        writer = Writer(out, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile="", library="deltact-fab")
        channels = {}
        for topic, schema in SCHEMAS.items():
            data = json.dumps(schema).encode()
            schema_id = writer.register_schema(schema["title"], "jsonschema", data)
            channels[topic] = writer.register_channel(topic, "json", schema_id)
        said = {key: json.dumps(value) for key, value in described(run).items()}
        writer.add_metadata("deltact-fab", {**said, **ABOUT})
        waiting = list(_events(run, line))  # few; each goes in where its time comes
        for number, press in enumerate(names, start=1):
            for time_ns, topic, text in _press(run, line, press):
                while waiting and waiting[0][0] <= time_ns:
                    _add(writer, channels, counts, waiting.pop(0))
                _add(writer, channels, counts, (time_ns, topic, text))
            progress(number, len(names), press)
        for message in waiting:
            _add(writer, channels, counts, message)
        for name, media_type in ATTACHED.items():
            if (run.folder / name).is_file():
                writer.add_attachment(0, 0, name, media_type, (run.folder / name).read_bytes())
        writer.finish()
    return counts


def _add(writer: Any, channels: dict[str, int], counts: dict[str, int], message: Message) -> None:
    time_ns, topic, text = message
    writer.add_message(channels[topic], time_ns, text.encode(), time_ns, counts[topic])
    counts[topic] += 1


def _press(run: Run, line: TimeLine, press: str) -> Iterator[Message]:
    """All messages of a press in order of time; of images only one is held at once."""
    frames = of_press(run, line, "frames", press)
    pose = of_press(run, line, "pose", press)
    force = of_press(run, line, "force", press)
    sources = [
        (frames[LINE].to_numpy(np.int64), lambda i: _frame(run, frames.iloc[i])),
        (pose[LINE].to_numpy(np.int64), _poses(pose)),
        (force[LINE].to_numpy(np.int64), _wrenches(force)),
    ]
    times = np.concatenate([t_ns for t_ns, _ in sources])
    which = np.repeat(np.arange(len(sources)), [len(t_ns) for t_ns, _ in sources])
    place = np.concatenate([np.arange(len(t_ns)) for t_ns, _ in sources])
    for at in np.argsort(times, kind="stable").tolist():
        time_ns = int(times[at])
        for topic, text in sources[which[at]][1](int(place[at])):
            yield time_ns, topic, text.replace(_STAMP, _stamp(time_ns), 1)


_STAMP = '"STAMP"'  # where a message's time comes in


def _stamp(time_ns: int) -> str:
    sec, nsec = divmod(time_ns, 1_000_000_000)
    return f'{{"sec":{sec},"nsec":{nsec}}}'


def _frame(run: Run, row: Any) -> list[tuple[str, str]]:
    told = {
        "timestamp": "STAMP",
        "id": str(row["frame_id"]),
        **{key: str(row[key]) for key in ("press", "step_id", "indenter", "kind")},
        "k": int(row["k"]),
        "settled": bool(row["settled"]),
        "late": bool(row["late"]),
        "dropped": int(row["dropped"]),
    }
    if not isinstance(row["file"], str):  # the scene had no image
        return [("/camera/frame", json.dumps(told))]
    told |= {"file": row["file"], "sha256": row["sha256"]}
    image = {
        "timestamp": "STAMP",
        "frame_id": CAMERA,
        "data": base64.b64encode(_png(run, row["file"])).decode(),
        "format": "png",
    }
    return [("/camera/image", json.dumps(image)), ("/camera/frame", json.dumps(told))]


def _png(run: Run, file: str) -> bytes:
    """A frame as PNG: its own file where that is one, else made anew from the same pixels."""
    return run.data(file) if file.endswith(".png") else encode_png(run.raw(file))


def _poses(table: Any) -> Any:
    values = table[["x_mm", "y_mm", "z_mm"]].to_numpy(float) / 1e3

    def message(i: int) -> list[tuple[str, str]]:
        text = (
            f'{{"timestamp":{_STAMP},"frame_id":"{SENSOR}","pose":{{"position":{_vector(values[i])}'
            ',"orientation":{"x":0,"y":0,"z":0,"w":1}}}'
        )
        return [("/stage/pose", text)]

    return message


def _wrenches(table: Any) -> Any:
    names = ["fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"]
    values = table[names].to_numpy(float) / (1, 1, 1, 1e3, 1e3, 1e3)
    saturated = table["saturated"].fillna(False).to_numpy(bool)

    def message(i: int) -> list[tuple[str, str]]:
        text = (
            f'{{"header":{{"stamp":{_STAMP},"frame_id":"{SENSOR}"}},"wrench":{{"force":'
            f'{_vector(values[i, :3])},"torque":{_vector(values[i, 3:])}}},"saturated":'
            f"{'true' if saturated[i] else 'false'}}}"
        )
        return [("/force/wrench", text)]

    return message


def _vector(values: Any) -> str:
    x, y, z = values.tolist()
    return f'{{"x":{x},"y":{y},"z":{z}}}'


def _events(run: Run, line: TimeLine) -> Iterator[Message]:
    for row in events(run, line).to_dict("records"):
        text = {
            "timestamp": "STAMP",
            "level": LEVELS.get(row["kind"], 3),
            "message": str(row["text"]) or str(row["kind"]),
            "name": str(row["kind"]),
            "file": row["step_id"] if isinstance(row["step_id"], str) else "",
            "line": 0,
        }
        time_ns = int(row[LINE])
        yield time_ns, "/events", json.dumps(text).replace(_STAMP, _stamp(time_ns), 1)
