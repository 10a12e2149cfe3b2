"""A study's folder: what it holds, how it is written whole, and how it is read again."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from .. import catalog, digest, reading
from ..errors import InputError, RunFailed
from ..files import making, write_together
from .result import Headline, StudyResult

PAGE, RESULT = "report.html", "result.json"
FORMAT = "deltact-fab study 2"


@dataclass(frozen=True)
class KeptResult:
    """What `result.json` holds of a study.

    made: day and time (UTC, ISO 8601) at which it was written. module, code: what made it, and its
    digest. versions: of what can change a number. figures, files: names. Beside them stands what
    `--json` prints.
    """

    study: str
    title: str
    verdict: tuple[str, ...]
    simulated: bool
    seed: int
    scale: float | None
    made: str
    headlines: tuple[Headline, ...]
    settings: dict[str, str]
    missing: tuple[str, ...]
    module: str
    code: str
    versions: dict[str, str]
    figures: tuple[str, ...]
    files: tuple[str, ...]

    @property
    def old(self) -> bool:
        """Whether other code than the present one made it."""
        return bool(self.module) and _code_of(self.module) != self.code


def _code_of(module: str) -> str:
    """The digest of a module; empty where the package has none of that name."""
    try:
        return digest.of(module) if module else ""
    except ValueError:
        return ""


def read_result(folder: str | Path) -> KeptResult:
    """What a study left in a folder. Raises InputError naming file and key."""
    path = Path(folder) / RESULT
    if not reading.is_file(path):
        raise InputError(
            f"{folder}: no study ({RESULT} is missing); name a folder that `study run` wrote"
        )
    found = reading.json_object(path)
    if (kept := found.get("format")) != FORMAT:
        raise InputError(f"{path}: format: {kept!r}; this version reads {FORMAT!r}")
    headlines = found.get("headlines")
    if isinstance(headlines, list):  # JSON has no NaN: a value that is no number is null there
        none = {"value": math.nan}
        headlines = [
            one | none if isinstance(one, dict) and one.get("value", 0) is None else one
            for one in headlines
        ]
    return catalog.validate(KeptResult, {**found, "headlines": headlines}, str(path))


def contents(result: StudyResult) -> dict[str, bytes]:
    """The files of a study but its page, by name; result.json last.

    Raises RunFailed for a number that JSON does not have.
    """
    from ..experiment import versions

    made = {
        f"{table.name}.csv": table.frame.to_csv(index=False).encode() for table in result.tables
    }
    made |= {name: text.encode() for name, text in result.files.items()}
    kept = {
        "format": FORMAT,
        "title": result.title,
        "made": f"{datetime.now(UTC):%Y-%m-%dT%H:%MZ}",
        "module": result.module,
        "code": _code_of(result.module),
        "versions": versions(),
        **result.data,
        "figures": [figure.name for figure in result.figures],
        "files": [PAGE, *made],
    }
    try:
        made[RESULT] = (json.dumps(kept, indent=1, allow_nan=False) + "\n").encode()
    except ValueError as why:
        raise RunFailed(f"{result.study}: its data hold a figure that is no number: {why}") from why
    return made


def make(folder: Path) -> None:
    """A folder to write into. Raises InputError where there can be none."""
    with making(folder):
        folder.mkdir(parents=True, exist_ok=True)


def refuse_strange(out: Path, study: str) -> None:
    """Raises InputError for a folder that is neither empty nor an earlier one of this study.

    Empty folders in it count for nothing: that of its figures may be one.
    """
    try:
        other = read_result(out).study
    except InputError:
        other = None
    files = (one for one in out.rglob("*") if not one.is_dir() and not one.name.startswith(".new-"))
    if other != study and any(files):
        held = f"holds the study {other}" if other else f"is not empty, and no earlier {study}"
        raise InputError(f"{out}: {held}; name another folder")


def place(files: Mapping[str, bytes], out: Path) -> None:
    """Put files into a study's folder; those that an earlier study left there go, others stay.

    Until all are on the disk the earlier ones stay as they are. Raises RunFailed when the disk
    refuses.
    """
    # Its list is the last to change: what is cut short here is found by the next.
    names = sorted(files, key=lambda name: name == RESULT)
    try:
        earlier = read_result(out).files
    except InputError:
        earlier = ()
    # A list that was changed by hand reaches into no other folder.
    gone = [out / name for name in earlier if name not in files and Path(name).name == name]
    write_together({out / name: files[name] for name in names}, gone, RunFailed)
