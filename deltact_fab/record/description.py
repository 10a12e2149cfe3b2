"""What a run is, in a few words: for a person who finds the folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .journal import being_written
from .run import Run

if TYPE_CHECKING:
    import pandas as pd


def about(run: Run) -> dict[str, Any]:
    """Protocol, specimen, rig, counts, events by kind, notes, as plain data. Raises RunFailed.

    begun_s, ended_s: the day's time of the first and the last event.
    """
    meta, summary, events = run.meta, run.summary(), run.events()
    protocol = meta.get("protocol") or {}
    with run.reader() as db:
        frames, images = db.execute("SELECT count(*), count(file) FROM frames").fetchone()
        steps = db.execute("SELECT count(*) FROM steps").fetchone()[0]
        presses = db.execute(
            "SELECT count(DISTINCT press) FROM steps WHERE kind = 'press'"
        ).fetchone()[0]
    state = "finished" if run.finished else "unfinished"
    return {
        "folder": str(run.folder),
        "state": "being written now" if being_written(run.folder) else state,
        "format": run.format,
        "protocol": protocol.get("name"),
        "description": protocol.get("description"),
        "channels": protocol.get("channels"),
        "specimen": protocol.get("specimen"),
        "rig": meta.get("rig_name"),
        "kind": (meta.get("rig") or {}).get("kind"),
        "simulated": meta.get("simulated"),
        "air": meta.get("air", False),
        "seed": meta.get("seed"),
        "begun_s": float(events["wall_s"].min()),
        "ended_s": float(events["wall_s"].max()),
        "sessions": int((events["kind"] == "session").sum()),
        "steps": steps,
        "presses": presses,
        "frames": frames,
        "images": images,
        "events": {str(k): int(n) for k, n in events["kind"].value_counts(sort=False).items()},
        "registration": _registration(meta),
        "indenters": _mounted(events),
        "camera": None if meta.get("camera") is None else meta["camera"].get("model", "pinhole"),
        "devices": summary.get("devices"),
        "remarks": summary.get("notes", []),
        "notes": run.notes().to_dict("records"),
        "versions": meta.get("versions"),
    }


def _registration(meta: dict[str, Any]) -> dict[str, Any]:
    """Where the rig file had the face, and the file that it was registered by, if it was."""
    stage = (meta.get("rig") or {}).get("stage") or {}
    keys = ("registration", "origin_machine_mm", "angle_deg", "tilt_deg")
    return {key: stage.get(key) for key in keys}


def _mounted(events: pd.DataFrame) -> list[str]:
    """What was mounted in the last session, and where its tip found the face."""
    begun = events.index[events["kind"] == "session"]
    last = events.loc[begun[-1] :] if len(begun) else events
    return [str(text) for text in last["text"][last["kind"] == "indenter"]]
