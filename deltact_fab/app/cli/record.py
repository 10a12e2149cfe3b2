"""`deltact-fab record`: check, show, note and export recorded runs."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import click

from .group import CommandGroup
from .options import PATH_TYPE, out_file, out_folder
from .output import Answer, answers, columns_of, compact, pairs, progress, table

RUN_ARGUMENT = click.argument("run", type=PATH_TYPE)


@click.group(cls=CommandGroup)
def record() -> None:
    """Recorded runs: list, verify, show, annotate, export. A RUN is a folder."""


@record.command("list")
@click.argument("folder", type=PATH_TYPE, default=Path())
@answers
def list_(folder: Path) -> Answer:
    """List the runs in FOLDER and its folders, with their presses complete and planned."""
    from deltact_fab.bench import Run

    rows = Run.list_runs(folder)
    return Answer(rows, columns_of(Run.LIST_COLUMNS, rows))


@record.command()
@RUN_ARGUMENT
@answers
def check(run: Path) -> Answer:
    """Verify that RUN is complete and undamaged.

    Checks the journal, the hash of every image, every sample and truth, and that each id occurs
    once. The verdict comes first, then one line per problem. Missing data of an interrupted press
    is not damage. Nothing is changed. Exit code 1 on damage.
    """
    from deltact_fab.bench import check_run as verify

    with progress("check") as bar:
        verdict = verify(run, bar)
    lines = compact(("", "location", "problem"), rows) if (rows := verdict.rows()) else ()
    return Answer(verdict.as_dict(), [verdict.line, *lines], None if verdict.intact else "")


@record.command()
@RUN_ARGUMENT
@click.option("--settings", is_flag=True, help="Show the controller's $ settings too.")
@answers
def show(run: Path, settings: bool) -> Answer:
    """Describe RUN: protocol, specimen, rig, counts, events, registration, notes."""
    from deltact_fab.bench import open_run

    data = open_run(run).describe()
    times = {key: data[key] and _format_time(data[key]) for key in ("begun_s", "ended_s")}
    rows = list(pairs({**data, **times, "notes": None}))
    visible = [row for row in rows if settings or ".settings.$" not in row[0]]
    if n_hidden := len(rows) - len(visible):
        visible.append(("devices.stage.settings", f"{n_hidden} values; --settings shows them"))
    lines = table(("key", "value"), visible)
    return Answer(data, [*lines, *map(_note_line, data["notes"])])


@record.command()
@RUN_ARGUMENT
@click.argument("text")
@answers
def note(run: Path, text: str) -> Answer:
    """Add the note TEXT to RUN, during the run or later."""
    from deltact_fab.bench import RunNote

    stored = RunNote(text).add_to(run)
    return Answer(stored, [_note_line(stored)])


@record.command("import", epilog="Example: deltact-fab record import recording.toml --out bubble")
@click.argument("recording", type=PATH_TYPE, metavar="RECORDING.toml")
@out_folder("New run folder.", required=True)
@answers
def import_(recording: Path, out: Path) -> Answer:
    """Convert images, times, force and pose that were recorded elsewhere to a run.

    RECORDING.toml names the files, columns and units, and the direction of force. Images are a
    folder or a video. The run is marked as imported; missing facts stay unknown. Reports the lag
    of force behind the images. Nothing is written if there is an error.
    """
    from deltact_fab.bench import import_recording, open_images
    from deltact_fab.fabricate import load_design

    with progress("import") as bar:
        data = import_recording(recording, out, open_images, load_design, bar)
    samples = "".join(f", {n} samples of {name}" for name, n in data["samples"].items())
    head = [f"{out}: {data['frames']} images imported{samples}"]
    return Answer({"out": str(out), **data}, [*head, *(f"  {note}" for note in data["notes"])])


@record.command(epilog="Example: deltact-fab record export smoke-run --format csv --out tables")
@click.argument("runs", metavar="RUN...", type=PATH_TYPE, nargs=-1, required=True)
@click.option("--format", "form", required=True,
              type=click.Choice(["csv", "parquet", "mcap", "lerobot"]),
              help="Format to write.")  # fmt: skip
@out_folder("New folder for csv, parquet or lerobot.")
@out_file("New file for mcap.", "file")
@click.option("--deformation/--no-deformation", default=True, help="Include the measured motion "
              "of the face in a dataset; takes most of the time.")  # fmt: skip
@answers
def export(
    runs: tuple[Path, ...], form: str, out: Path | None, file: Path | None, deformation: bool
) -> Answer:
    """Write RUN as CSV, Parquet or MCAP, or one or more as a LeRobot dataset.

    csv and parquet: tables of frames, force, pose, steps and events, without images; column names
    contain the units. mcap: one file for Foxglove with images, pose (m) and wrench (N, N m) on one
    time line over all sessions; every image is verified against its hash. lerobot: a LeRobotDataset
    3.0 with one episode per press: video of the images (lossy) and of the measured deformation, and
    pose, wrench, contact and action as float32. All but csv need the extra `export`.
    """
    from deltact_fab.bench import export_run as write
    from deltact_fab.bench import open_run

    place, unsuitable = (file, out) if form == "mcap" else (out, file)
    if place is None or unsuitable is not None:
        option = "-o FILE" if form == "mcap" else "--out DIR"
        raise click.UsageError(f"--format {form} needs {option}, and no other output")
    with progress("export") as bar:
        recordings = [open_run(run) for run in runs]
        if deformation and form == "lerobot":
            from deltact_fab.estimate import open_follower

            rows = write(recordings, form, place, bar, open_follower)
        else:
            rows = write(recordings, form, place, bar)
    summary = f"{place}: " + ", ".join(f"{n} {name}" for name, n in rows.items())
    return Answer({"out": str(place), "format": form, "rows": rows}, [summary])


def _note_line(note: dict[str, Any]) -> str:
    return f"note {_format_time(note['wall_s'])}: {note['text']}"


def _format_time(wall_s: float) -> str:
    return datetime.fromtimestamp(wall_s).astimezone().isoformat(" ", "seconds")
