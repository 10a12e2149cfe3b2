"""`deltact-fab record`: check, show, note and export recorded runs."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import click

from .group import CommandGroup
from .options import PATH, out_file, out_folder
from .output import Answer, answers, compact, facts, progress, table

RUN = click.argument("run", type=PATH)


@click.group(cls=CommandGroup)
def record() -> None:
    """Recorded runs: verify, look at, annotate, export. A RUN is the folder of one."""


@record.command()
@RUN
@answers
def check(run: Path) -> Answer:
    """Verify that RUN is complete and undamaged.

    Checks the journal, the hash of every image, every sample and truth, and that each id occurs
    once. The verdict comes first, then one line for each problem. What a press that was cut off
    lacks is no damage. Nothing is changed. Exit code 1 on damage.
    """
    from deltact_fab.bench import check_run as verify

    with progress("check") as bar:
        verdict = verify(run, bar)
    shown = compact(("", "where", "what"), rows) if (rows := verdict.rows()) else ()
    return Answer(verdict.as_dict(), [verdict.line, *shown], None if verdict.intact else "")


@record.command()
@RUN
@answers
def show(run: Path) -> Answer:
    """Describe RUN: protocol, specimen, rig, counts, events, registration, notes."""
    from deltact_fab.bench import open_run

    data = open_run(run).describe()
    times = {key: data[key] and _day(data[key]) for key in ("begun_s", "ended_s")}
    told = table(("key", "value"), facts({**data, **times, "notes": None}))
    return Answer(data, [*told, *map(_note, data["notes"])])


@record.command()
@RUN
@click.argument("text")
@answers
def note(run: Path, text: str) -> Answer:
    """Add the remark TEXT to RUN, during the run or later."""
    from deltact_fab.bench import RunNote

    added = RunNote(text).add_to(run)
    return Answer(added, [_note(added)])


@record.command("import", epilog="Example: deltact-fab record import recording.toml --out bubble")
@click.argument("recording", type=PATH, metavar="RECORDING.toml")
@out_folder("New run folder.", required=True)
@answers
def import_(recording: Path, out: Path) -> Answer:
    """Make a run of images, times, force and pose that were recorded elsewhere.

    RECORDING.toml says where they are, in which columns and units, and which way force points.
    Images: a folder or a video. The run is marked as imported; what nobody said
    stays unknown. Says how much force lags the images. Nothing is written unless all is right.
    """
    from deltact_fab.bench import import_recording, open_images
    from deltact_fab.fabricate import load_design

    with progress("import") as bar:
        done = import_recording(recording, out, open_images, load_design, bar)
    samples = "".join(f", {n} samples of {name}" for name, n in done["samples"].items())
    told = [f"{out}: {done['frames']} images imported{samples}"]
    return Answer({"out": str(out), **done}, [*told, *(f"  {note}" for note in done["notes"])])


@record.command(epilog="Example: deltact-fab record export smoke-run --format csv --out tables")
@click.argument("runs", metavar="RUN...", type=PATH, nargs=-1, required=True)
@click.option("--format", "form", required=True,
              type=click.Choice(["csv", "parquet", "mcap", "lerobot"]),
              help="Format to write.")  # fmt: skip
@out_folder("New folder for csv, parquet or lerobot.")
@out_file("New file for mcap.", "file")
@click.option("--deformation/--no-deformation", default=True, help="In a dataset, the measured "
              "motion of the face, which takes most of the time.")  # fmt: skip
@answers
def export(
    runs: tuple[Path, ...], form: str, out: Path | None, file: Path | None, deformation: bool
) -> Answer:
    """Write RUN as CSV, Parquet or MCAP, or one or more as a LeRobot dataset.

    csv and parquet give tables of frames, force, pose, steps and events, without images; the names
    of the columns have the units. mcap gives one file for Foxglove with images, pose (m) and
    wrench (N, N m) on one time line over all sessions, and every image is verified against its
    hash. lerobot gives a LeRobotDataset 3.0, an episode a press: video of the images (lossy) and of
    the measured deformation, and pose, wrench, contact and action as float32. All but csv need the
    extra `export`.
    """
    from deltact_fab.bench import export_run as write
    from deltact_fab.bench import open_run

    place, other = (file, out) if form == "mcap" else (out, file)
    if place is None or other is not None:
        right = "-o FILE" if form == "mcap" else "--out DIR"
        raise click.UsageError(f"--format {form}: {right} says where it goes")
    with progress("export") as bar:
        opened = [open_run(run) for run in runs]
        if deformation and form == "lerobot":
            from deltact_fab.estimate import open_follower

            rows = write(opened, form, place, bar, open_follower)
        else:
            rows = write(opened, form, place, bar)
    told = f"{place}: " + ", ".join(f"{n} {name}" for name, n in rows.items())
    return Answer({"out": str(place), "format": form, "rows": rows}, [told])


def _note(note: dict[str, Any]) -> str:
    return f"note {_day(note['wall_s'])}: {note['text']}"


def _day(wall_s: float) -> str:
    return datetime.fromtimestamp(wall_s).astimezone().isoformat(" ", "seconds")
