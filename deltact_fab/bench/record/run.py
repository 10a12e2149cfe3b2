"""Reading of a run: tables, streams, images and, on a virtual rig, the truth."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deltact_fab.common import (
    DeltactFabError,
    InputError,
    Note,
    RunFailed,
    disk_errors,
    parse_json,
    read_toml,
    validate,
)
from deltact_fab.sensor import (
    CameraModel,
    FlatField,
    Indenter,
    Rectified,
    restore_camera,
    restore_indenter,
)

from ..protocols.plan import Protocol, Step, expand_protocol
from ..protocols.tables import DeadWeights
from . import notes
from .files import FLAT_FILE, IMPORTED_MARK, LATTICE_FILE, UNKNOWN_SENSOR, load_run_file
from .folder import UnsafeFile, check_folder, has_file, read_file
from .images import NOT_AN_IMAGE, decode, image_size_px, require_size
from .journal import is_claimed, journal_errors, open_journal, read_press_rows, schema_faults
from .streams import FORCE_COLUMNS, MONITOR_PREFIX, POSE_COLUMNS, Chunk, interpolate_at, unpack
from .truth import RunTruth, load_truth

if TYPE_CHECKING:
    import pandas as pd

_STREAM_COLUMNS = {"pose": POSE_COLUMNS, "force": FORCE_COLUMNS}
_SAMPLED_KEYS = (*POSE_COLUMNS, *FORCE_COLUMNS)
MAX_VIEW_RATIO = 10  # pixels of a view by those of its raw image; by hand: ours have 0.5
_SKEW_KEYS = ("pose_skew_s", "force_skew_s")
_LATENESS_KEYS = ("late_s", "late", "dropped", "repeated")


class Run:
    """A recorded run, read only."""

    UNKNOWN: ClassVar = UNKNOWN_SENSOR
    """Kind of the frames of an imported run; their indenter if unknown."""
    LIST_COLUMNS: ClassVar = ("run", "protocol", "begun", "rig", "simulated", "air", "serial",
                              "complete", "planned", "state", "fault")  # fmt: skip
    """Keys of `list_runs`; complete, planned: numbers of presses."""

    def __init__(self, folder: Path):
        check_folder(folder)
        if not has_file(folder, "run.json"):
            problem = "not a run folder (no run.json)" if folder.exists() else "no such folder"
            raise InputError(f"{folder}: {problem}")
        self.folder = folder
        self.meta: dict[str, Any] = load_run_file(folder, "run.json")
        self.pattern: dict[str, Any] = load_run_file(folder, "pattern.json")
        self.format = int(self.meta["format"])
        """Format number of the folder: of this version, or of 0.2.0."""
        self._sound = False

    @staticmethod
    def list_runs(folder: Path) -> list[dict[str, Any]]:
        """Return a row of LIST_COLUMNS for each run that a folder is, or has in it to two levels.

        A damaged one has a fault. Raises InputError if there is no folder.
        """
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder")
        files = ("run.json", "journal.sqlite")
        names = [f"{above}{name}" for above in ("", "*/", "*/*/") for name in files]
        rows = []
        for place in sorted({file.parent for name in names for file in folder.glob(name)}):
            try:
                run = Run(place)
                row = {**run.describe(), "begun": run.begun.isoformat(" ", "seconds")}
                row["serial"] = (row["specimen"] or {}).get("serial")
                row["complete"], row["planned"] = run.count_presses()
            except DeltactFabError as error:
                row = {"fault": str(error)}
            rows.append({"run": str(place), **{key: row.get(key) for key in Run.LIST_COLUMNS[1:]}})
        return rows

    @cached_property
    def begun(self) -> datetime:
        """Time of the first event, the beginning of the run; UTC."""
        with self.reader() as db:
            first = db.execute("SELECT wall_s FROM events ORDER BY seq LIMIT 1").fetchone()
        return datetime.fromtimestamp(first[0], UTC)

    @property
    def id(self) -> str:
        """Name of the protocol and time of the beginning: unchanged by a copy or a resume."""
        return f"{self.meta['protocol'].get('name')}-{self.begun:%Y%m%d-%H%M%S-%f}"

    @property
    def state(self) -> str:
        if is_claimed(self.folder):
            return "being written now"
        return "finished" if self.finished else "unfinished"

    @property
    def skipped(self) -> list[str]:
        """Presses and changes of indenter that were not made, as the run ended before them."""
        return list(self.summary().get("skipped", ()))

    def planned_steps(self) -> list[Step]:
        """Steps planned by the run's protocol, also those skipped by an early end.

        Raises InputError if protocol.toml is unusable.
        """
        path = self.folder / "protocol.toml"
        declared = read_toml(path)
        if declared.pop("presses", None) is not None:  # the list is in the record
            declared["press"] = (self.meta.get("protocol") or {}).get("press")
        protocol = validate(Protocol, declared, str(path))
        return expand_protocol(protocol, bool(self.meta.get("air")))

    def count_presses(self) -> tuple[int, int]:
        """Return the numbers of complete and of planned presses; equal for an imported run."""
        with self.reader() as db:
            if self.imported:
                return (db.execute("SELECT count(DISTINCT press) FROM frames").fetchone()[0],) * 2
            done_ids = {id for (id,) in db.execute("SELECT step_id FROM steps")}
        last = {step.press: step.id for step in self.planned_steps() if step.kind != "change"}
        return sum(id in done_ids for id in last.values()), len(last)

    def frames(self, press: str | None = None) -> pd.DataFrame:
        """Frames (of one press), one row per frame in order of capture.

        Pose (x_mm, y_mm, z_mm) and force (fx_n to tz_nmm) are interpolated linearly to the frame's
        time between the samples of its step; pose_skew_s, force_skew_s: time to the nearest sample.
        All are nan without samples. t_s: on the rig's clock; t_step_s, t_press_s: since the start
        of the step, of the press. settled: the tip had rested for the protocol's settling time.
        late_s: delay of the exposure; late: by more than half the frame period of a sweep;
        dropped, repeated: frames lost or delivered twice since the previous one.
        """
        table = self._table("frames", press)
        table["settled"] = table["settled"].astype(bool)
        table["late"] = self._late(table)
        rows = table.groupby("step_id").indices
        sampled = {name: np.full(len(table), np.nan) for name in (*_SAMPLED_KEYS, *_SKEW_KEYS)}
        for stream, names in _STREAM_COLUMNS.items():
            for _, step_id, chunk in self._chunks(stream, press):
                if step_id not in rows:
                    continue
                index = rows[step_id]
                values, skew_s = interpolate_at(chunk, table["t_press_s"].to_numpy()[index], names)
                for name, column in zip(names, values.T, strict=True):
                    sampled[name][index] = column
                sampled[f"{stream}_skew_s"][index] = skew_s
        table = table.assign(**sampled)
        last = ["wall_s", "t_press_s", *_SKEW_KEYS, "settled", *_LATENESS_KEYS]
        first = [name for name in table if name not in (*last, *_SAMPLED_KEYS)]
        return table[[*first, *_SAMPLED_KEYS, *last]]

    def force(self, press: str | None = None) -> pd.DataFrame:
        """Samples of the force sensor (of one press), one row each in order of time.

        fx_n to tz_nmm: on the sensor. t_s: on the rig's clock; t_press_s: since the press's tare.
        saturated: a gauge was out of range. A run of 45 presses of an hour each has 160 million
        rows: read it press by press.
        """
        return self._samples("force", press, "saturated")

    def pose(self, press: str | None = None) -> pd.DataFrame:
        """Tip positions x_mm, y_mm, z_mm reported by the stage (of one press), one row each.

        t_s is the time of the request. Times as in `force`.
        """
        return self._samples("pose", press)

    def monitors(self, press: str | None = None) -> pd.DataFrame:
        """Readings of the rig's monitors, one row each: monitor, unit, value.

        Times as in `force`; before a press's tare, as in a pause before it, t_press_s is negative.
        A simulated run, whose time does not pass meanwhile, has one reading per press.
        """
        import pandas as pd

        tables = (self.meta.get("rig") or {}).get("monitor") or ()
        units = {table["name"]: table["unit"] for table in tables}
        parts = []
        for stream in self.monitor_streams() or [MONITOR_PREFIX]:
            name = stream.removeprefix(MONITOR_PREFIX)
            rows = self._samples(stream, press)
            parts.append(rows.assign(monitor=name, unit=units.get(name, "")))
        return pd.concat([part for part in parts if len(part)] or parts[:1], ignore_index=True)

    def monitor_streams(self) -> list[str]:
        """Names of the recorded streams of monitors."""
        with self.reader() as db:
            query = "SELECT DISTINCT stream FROM samples WHERE stream GLOB ? ORDER BY stream"
            return [stream for (stream,) in db.execute(query, (f"{MONITOR_PREFIX}*",))]

    def events(self) -> pd.DataFrame:
        """Events of all sessions, one row each in order of writing.

        t_s: on the rig's clock of that session, nan before it ran; wall_s: wall time.
        """
        return self._table("events")

    def notes(self) -> pd.DataFrame:
        """Operators' notes, one row each in order of writing: wall_s, text."""
        import pandas as pd

        valid = [note for _, note in notes.read_notes(self.folder) if note is not None]
        return pd.DataFrame(valid, columns=["wall_s", "text"])

    def steps(self, press: str | None = None) -> pd.DataFrame:
        """Finished steps (of one press), one row each."""
        return self._table("steps", press)

    def press_roles(self) -> dict[str, str]:
        """Role of each press that is planned and not skipped; empty if not recorded.

        "fit", "validate" or "reference".
        """
        rows, skipped = self.meta.get("presses", []), {*self.skipped}
        return {press["name"]: press["role"] for press in rows if press["name"] not in skipped}

    def decisions(self) -> list[dict[str, Any]]:
        """Decisions to end the run or to go on, in order. Raises RunFailed for a damaged one."""
        with self.reader() as db:
            query = "SELECT text FROM events WHERE kind = 'decision' ORDER BY seq"
            texts = [text for (text,) in db.execute(query)]
        try:
            return [parse_json(text, f"{self.folder}/journal.sqlite") for text in texts]
        except InputError as error:
            raise RunFailed(str(error)) from error

    def press_rows(self) -> dict[str, list[tuple[Any, ...]]]:
        """Rows of the presses by table, without clocks, to compare two runs."""
        return read_press_rows(self.folder)

    @cached_property
    def camera(self) -> CameraModel:
        """Camera model of the tracked images. Raises InputError without a camera."""
        stored = self.meta["camera"]
        if stored is None:
            text = "recorded without a camera"
            if self.imported:
                text = "imported without a camera; set `camera` and `design` in the recording file "
                text += "and import it again"
            raise InputError(f"{self.folder}: {text}")
        source = f"{self.folder}/run.json: camera"
        camera = restore_camera(stored, source)
        raw = getattr(camera, "lens", camera)
        size_px = raw.width_px, raw.height_px
        with self.reader() as db:
            first = db.execute("SELECT file FROM frames WHERE file IS NOT NULL LIMIT 1").fetchone()
        if first and has_file(self.folder, first[0]):
            # Before maps of the camera's size are computed.
            found_px = image_size_px(read_file(self.folder, first[0])) or size_px
            if found_px != size_px:
                raise InputError(f"{source}: {size_px} px, but {first[0]} has {found_px} px")
        if camera.width_px * camera.height_px > MAX_VIEW_RATIO * size_px[0] * size_px[1]:
            view = f"{camera.width_px} x {camera.height_px} px"
            raise InputError(f"{source}: view of {view}; at most {MAX_VIEW_RATIO} raw images")
        return camera

    @property
    def weights(self) -> DeadWeights | None:
        """Dead weights applied by hand; None if a stage pressed. Raises InputError."""
        stored = self.meta["protocol"].get("weights")
        return None if stored is None else validate(DeadWeights, stored, str(self.folder))

    @property
    def simulated(self) -> bool:
        """True when no hardware was involved."""
        return bool(self.meta["simulated"])

    @property
    def imported(self) -> bool:
        """True for a recording made elsewhere; much may be unknown (run.json: imported)."""
        return IMPORTED_MARK in self.meta

    def dots_mm(self) -> NDArray[np.float64]:
        """Centres (n, 2) mm of the pattern's dots at rest; n = 0 without dots."""
        return np.asarray(self.pattern.get("dots_mm", []), dtype=float).reshape(-1, 2)

    def image(self, file: str) -> NDArray[np.uint8]:
        """Frame (h, w, 3) BGR as it is tracked: rectified if a lens is calibrated.

        Also divided by the flat field if the camera has one. Raises RunFailed if it is missing,
        differs from its hash, does not decode or does not have the lens's size.
        """
        raw = self.raw(file)
        if self.meta["camera"] is None or not isinstance(self.camera, Rectified):
            return raw
        try:
            view = np.asarray(self.camera.rectify(raw), np.uint8)
            return view if self.flat is None else self.flat.apply(view)
        except InputError as error:
            raise RunFailed(f"{self.folder / file}: {error}") from error

    @cached_property
    def flat(self) -> FlatField | None:
        """Flat field of the rectified view, or None. Raises InputError if damaged."""
        view = self.camera
        if not has_file(self.folder, FLAT_FILE):
            return None
        assert isinstance(view, Rectified), "a flat field comes with a lens"
        source, size = str(self.folder / FLAT_FILE), (view.lens.width_px, view.lens.height_px)
        data = read_file(self.folder, FLAT_FILE)
        require_size(data, source)
        return FlatField.from_png(data, source, size).for_view(view)

    def raw(self, file: str) -> NDArray[np.uint8]:
        """Raw camera frame (h, w, 3) BGR. Raises as `image` does."""
        path, data = self.folder / file, self.data(file)
        try:
            if image_size_px(data) is None:
                raise ValueError(NOT_AN_IMAGE)
            return decode(data, str(path))
        except ValueError as error:
            raise RunFailed(f"{path}: {error}") from error

    def data(self, file: str) -> bytes:
        """Bytes of a frame's file. Raises RunFailed if missing or damaged."""
        path = self.folder / file
        with disk_errors(path, "read"):
            data = read_file(self.folder, file)
        if hashlib.sha256(data).hexdigest() != self._hash_of(file):
            raise RunFailed(
                f"{path}: damaged: its {len(data)} bytes do not match the hash in the journal"
            )
        return data

    @property
    def finished(self) -> bool:
        """True if the run ended; False while it is running or if it was interrupted."""
        return has_file(self.folder, "summary.json")

    def indenter(self, name: str) -> Indenter:
        """Indenter by its name in this run; a lab's own shape as stored with the run."""
        return restore_indenter(
            name, self.meta.get("shapes", {}), f"{self.folder / 'run.json'}: shapes"
        )

    def summary(self) -> dict[str, Any]:
        """Summary written at the end of the run; empty if unfinished."""
        if not self.finished:
            return {}
        try:
            return load_run_file(self.folder, "summary.json")
        except UnsafeFile:
            raise
        except InputError as error:
            raise RunFailed(str(error)) from error

    def remarks(self) -> tuple[list[str], list[str]]:
        """Return the warnings of the summary, without prefix, and its other notes."""
        summary = self.summary()
        stored = summary.get("remarks", ())
        remarks = [Note(r["id"], r["text"], r.get("warns", False)) for r in stored]
        if "remarks" not in summary:  # imported, or 0.3.0 and before: lines only
            lines = summary.get("notes", ())
            remarks = [Note.from_line(line) for line in lines]
        return [r.text for r in remarks if r.warns], [r.text for r in remarks if not r.warns]

    def truth(self) -> RunTruth | None:
        """Truth of all complete presses on a virtual rig; None for a real run.

        Raises RunFailed if damaged.
        """
        if not has_file(self.folder, LATTICE_FILE):
            return None
        with self.reader() as db:
            query = "SELECT press, count(*) FROM frames GROUP BY press ORDER BY min(seq)"
            presses = dict(db.execute(query).fetchall())
        channels = self.meta["protocol"]["channels"]
        return load_truth(self.folder, self.camera, presses, "traction" in channels)

    def describe(self) -> dict[str, Any]:
        """Protocol, specimen, rig, counts, events by kind and notes as plain data.

        begun_s, ended_s: wall time of the first and the last event. Raises RunFailed.
        """
        meta, summary, events = self.meta, self.summary(), self.events()
        protocol = meta.get("protocol") or {}
        with self.reader() as db:
            frames, images = db.execute("SELECT count(*), count(file) FROM frames").fetchone()
            steps = db.execute("SELECT count(*) FROM steps").fetchone()[0]
            presses = db.execute(
                "SELECT count(*) FROM"
                " (SELECT press FROM steps WHERE kind = 'press' UNION SELECT press FROM frames)"
            ).fetchone()[0]
        # Pose of the face in the rig file, and its registration file, if any.
        stage = (meta.get("rig") or {}).get("stage") or {}
        placed_by = ("registration", "origin_machine_mm", "angle_deg", "tilt_deg")
        begun = events.index[events["kind"] == "session"]
        session = events.loc[begun[-1] :] if len(begun) else events  # the last one
        return {
            "folder": str(self.folder),
            "state": self.state,
            "format": self.format,
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
            "registration": {key: stage.get(key) for key in placed_by},
            "indenters": [str(t) for t in session["text"][session["kind"] == "indenter"]],
            "camera": None
            if meta.get("camera") is None
            else meta["camera"].get("model", "pinhole"),
            "devices": summary.get("devices"),
            "remarks": summary.get("notes", []),
            "notes": self.notes().to_dict("records"),
            "versions": meta.get("versions"),
        }

    def _late(self, table: pd.DataFrame) -> pd.Series[bool]:
        capture = self.meta.get("protocol", {}).get("capture", {})
        overrides = {kind: (capture.get(kind) or {}).get("rate_hz") for kind in ("hold", "retract")}
        rates_hz = [overrides.get(kind, capture.get("rate_hz")) or np.nan for kind in table["kind"]]
        limit_s = 0.5 / np.array(rates_hz)  # nan: never late
        return (table["late_s"] > limit_s) & ~table["settled"]

    def _hash_of(self, file: str) -> str | None:
        hashes: dict[str, str] = self.__dict__.setdefault("hashes", {})
        if file not in hashes:  # also frames added meanwhile, in a running run
            with self.reader() as db:
                hashes.update(db.execute("SELECT file, sha256 FROM frames WHERE file IS NOT NULL"))
        return hashes.get(file)

    def _samples(self, stream: str, press: str | None, *extra: str) -> pd.DataFrame:
        import pandas as pd

        names = _STREAM_COLUMNS.get(stream, ("value",))
        parts = [
            pd.DataFrame(
                {
                    "press": of_press,
                    "step_id": step_id,
                    "t_s": chunk.origin_s + chunk.t_press_s(),
                    "t_press_s": chunk.t_press_s(),
                    **{name: chunk.values(name) for name in names},
                    **{name: chunk.columns.get(name) for name in extra},
                }
            )
            for of_press, step_id, chunk in self._chunks(stream, press)
        ]
        if not parts:
            return pd.DataFrame(columns=["press", "step_id", "t_s", "t_press_s", *names, *extra])
        return pd.concat(parts, ignore_index=True)

    def damaged_samples(self, press: str) -> Iterator[str]:
        """Yield the first damaged chunk of a press in each stream."""
        for stream in (*_STREAM_COLUMNS, *self.monitor_streams()):
            try:
                for _ in self._chunks(stream, press):
                    pass
            except RunFailed as error:
                yield str(error)

    def _chunks(self, stream: str, press: str | None) -> Iterator[tuple[str, str, Chunk]]:
        """Yield (press, step, samples) step by step. Raises RunFailed for a damaged chunk."""
        with self.reader() as db:
            rows = db.execute(
                "SELECT press, step_id, stream, origin_s, n, columns, data FROM samples "
                "WHERE stream = ? AND press = coalesce(?, press) ORDER BY seq",
                (stream, press),
            )
            for of_press, step_id, *stored in rows:
                try:
                    yield of_press, step_id, unpack(*stored)
                except (ValueError, UnsafeFile) as error:
                    place = f"{self.folder / 'journal.sqlite'}: {stream} of {step_id}"
                    if isinstance(error, UnsafeFile):
                        raise UnsafeFile(f"{place}: {error}") from error
                    raise RunFailed(f"{place}: damaged samples") from error

    def _table(self, name: str, press: str | None = None) -> pd.DataFrame:
        import pandas as pd

        condition = "" if press is None else "WHERE press = :press "
        with self.reader() as db:
            try:
                return pd.read_sql_query(
                    f"SELECT * FROM {name} {condition}ORDER BY seq", db, params={"press": press}
                )
            except pd.errors.DatabaseError as error:
                raise sqlite3.DatabaseError(str(error.__cause__ or error)) from error

    @contextmanager
    def reader(self) -> Iterator[sqlite3.Connection]:
        """Open the journal read-only. Raises RunFailed if it cannot be read."""
        with (
            journal_errors(self.folder, "the journal cannot be read"),
            closing(open_journal(self.folder, "ro")) as db,
        ):
            if not self._sound:
                for line in schema_faults(db, self.format):
                    raise sqlite3.DatabaseError(line)
                self._sound = True
            yield db


def open_run(folder: str | Path) -> Run:
    """Open a run folder. Raises InputError if it is not one."""
    return Run(Path(folder))
