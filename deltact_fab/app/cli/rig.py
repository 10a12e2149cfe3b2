"""`deltact-fab rig`: describe benches, check, register, drive by hand, photograph boards."""

from __future__ import annotations

import signal
import sys
from dataclasses import asdict, replace
from pathlib import Path

import click

from deltact_fab.common import InputError, catalogue_names, validate, write_whole

from . import rig_stage
from .group import CommandGroup
from .old_keys import of_device
from .options import (
    DESIGN_OPTION,
    JSON_OPTION,
    NAME_OR_PATH,
    NEW_FILE,
    PATH_TYPE,
    TIP_IS_CLEAR,
    Finite,
    Point,
    out_file,
    out_folder,
    seed,
)
from .output import Answer, answers, check_lines, echo_json, grade, listing, pairs, progress, table

RIG_ARGUMENT = click.argument("name", metavar="RIG", type=NAME_OR_PATH)


@click.group(cls=CommandGroup)
def rig() -> None:
    """Benches: describe, check, move the stage by hand, photograph boards.

    A RIG is a name of `rig list` or a path. A `virtual` rig is simulated, a `grbl` rig is real.
    """


@rig.command("list")
@answers
def list_() -> Answer:
    """List rigs: your own and the shipped ones."""
    from deltact_fab.bench import load_rig

    rows = []
    for name in catalogue_names("protocols/rigs"):
        bench = load_rig(name)[0]
        camera = ["camera"] if bench.camera is not None or bench.kind == "virtual" else []
        rows.append((name, bench.kind, camera + (["force"] if bench.force is not None else [])))
    return listing(("rig", "kind", "measures"), rows)


@rig.command()
@RIG_ARGUMENT
@answers
def show(name: str) -> Answer:
    """Show the settings of RIG, including defaults; no device is opened."""
    from deltact_fab.bench import load_rig

    rig_config, path = load_rig(name)
    data = rig_config.model_dump(mode="json")
    return Answer(data, [f"{name} ({path.name})\n", *table(("key", "value"), pairs(data))])


@rig.command(epilog="Example: deltact-fab rig photograph fisheye --board skin --out photos")
@RIG_ARGUMENT
@click.option("--board", metavar="skin|NXxNYxMM",
              help="Board on the face of a virtual rig's sensor.")  # fmt: skip
@click.option("--contact", default=5, metavar="N",
              help="Images with the board on the face; one for a skin.")  # fmt: skip
@click.option("--air", default=0, metavar="N",
              help="Images with the board in the air beyond the face.")  # fmt: skip
@click.option("--air-board", metavar="NXxNYxMM", show_default="same as --board",
              help="Board in the air.")  # fmt: skip
@DESIGN_OPTION
@seed("Seed of positions, tilts and noise.")
@out_folder("New folder for the images.", required=True)
@answers
def photograph(
    name: str, board: str | None, contact: int, air: int, air_board: str | None, design: str,
    seed: int, out: Path,
) -> Answer:  # fmt: skip
    """Photograph boards with the camera of RIG, for `calibrate lens`.

    A real rig waits for Enter before each of the --contact images, if there is a terminal, and
    writes them to DIR/contact. A virtual rig photographs through its true lens: --board skin is the
    shipped chessboard skin, --board 9x7x3 a board of 9 x 7 squares of 3 mm wetted onto the face.
    DIR gets contact/, air/, a blank frame for the flat field, and truth/.
    """
    from deltact_fab.bench import GrblConfig, load_rig
    from deltact_fab.fabricate import load_design
    from deltact_fab.simulate import take_photographs

    from .calibrate import parse_board

    bench, path = load_rig(name)
    if isinstance(bench, GrblConfig):
        from deltact_fab.bench import take_photograph as by_camera

        def ask(number: int) -> None:
            if sys.stdin.isatty():
                click.prompt(f"image {number} of {contact}: Enter", "", prompt_suffix="",
                             show_default=False, err=True)  # fmt: skip

        if bench.camera is None:
            raise InputError(f"{path}: camera: missing table")
        images = by_camera(bench.camera, path.parent, out, contact, ask)
        paths = [str(file) for file in images]
        return Answer({"simulated": False, "files": paths}, paths)
    if bench.virtual.lens is None:
        raise InputError(f"{path}: needs [virtual.lens], such as the rig fisheye")
    if board is None:
        raise click.UsageError("--board: missing; a virtual rig needs the board on the face")
    board_in_air = None if air_board is None else parse_board(air_board, "--air-board")
    files = take_photographs(
        bench, load_design(design), parse_board(board, "--board"), out, contact=contact, air=air,
        air_board=board_in_air, seed=seed
    )  # fmt: skip
    paths = [str(file) for file in files]
    note = f"simulated, seed {seed}; the true lens is in {out / 'truth'}"
    return Answer({"simulated": True, "seed": seed, "files": paths}, [*paths, note])


@rig.command(epilog="Example: deltact-fab rig new bench")
@click.argument("name")
@NEW_FILE
@answers
def new(name: str, out: Path | None) -> Answer:
    """Write a new rig file with the serial ports and cameras of this computer.

    No device is opened. Fill in the values that the file marks with MEASURE, then test it with
    `rig check NAME`.
    """
    from ..lab import rig as write

    file, by_kind = write(name, out)
    lines = [
        f"{kind}: {', '.join(d.name for d in devices) or 'none found'}"
        for kind, devices in by_kind.items()
    ]
    then = f"`deltact-fab rig check {name if out is None else out}`"
    lines.append(f"written: {file}; fill in the values marked MEASURE, then run {then}")
    data = {kind: [asdict(device) for device in devices] for kind, devices in by_kind.items()}
    return Answer({"file": str(file), **data}, lines)


@rig.command(epilog="Example: deltact-fab rig simulate grbl-bench --out bench")
@RIG_ARGUMENT
@DESIGN_OPTION
@click.option("--pattern", "recipe", type=NAME_OR_PATH, default="dense-with-dots",
              metavar="RECIPE", help="Pattern of the face.")  # fmt: skip
@click.option("--indenter", default="sphere:10", metavar="NAME", help="Mounted indenter.")
@seed("Seed of noise.")
@out_folder("New folder for its rig file and its images.", required=True)
@JSON_OPTION
def simulate(
    name: str, design: str, recipe: str, indenter: str, seed: int, out: Path, as_json: bool
) -> None:
    """Simulate the devices of RIG on this computer's interfaces until Ctrl-C.

    DIR/rig.toml names them: a controller on a pseudo-terminal, a force sensor on sockets, a camera
    as a command. Use it like a real rig from another terminal. A tip in the gel changes the force,
    but not the images. `[virtual.mount]` of a virtual RIG moves the face. The controller homes and
    jogs; it does not run a G-code program.
    """
    from deltact_fab.bench import load_rig
    from deltact_fab.fabricate import load_design, load_recipe
    from deltact_fab.simulate import serve_rig

    bench, _ = load_rig(name)
    sensor, chosen = load_design(design), load_recipe(recipe)
    with serve_rig(bench, sensor, chosen, indenter, out, seed=seed) as file:
        if as_json:
            echo_json({"rig": str(file), "simulated": True, "seed": seed})
        else:
            click.echo(f"{file}: simulated devices, until Ctrl-C")
        signal.sigwait({signal.SIGINT, signal.SIGTERM, signal.SIGHUP})


@rig.command()
@RIG_ARGUMENT
@click.option("--seconds", type=Finite(0.1, 60), default=2.0, metavar="S",
              help="Time to observe each device.")  # fmt: skip
@answers
def check(name: str, seconds: float) -> Answer:
    """Test the connection to each device of RIG and report faults with their remedies.

    Nothing moves. Nothing may touch the sensor, as its force is tared. Exit code 1 if a check
    fails.
    """
    from deltact_fab.bench import GrblConfig, load_rig
    from deltact_fab.bench import check_rig as look

    bench, path = load_rig(name)
    if not isinstance(bench, GrblConfig):
        raise InputError(f"{path}: kind: 'virtual' has no devices; expected a 'grbl' rig")
    with progress("rig check"):
        rows = list(look(bench, path.parent, seconds))
    failed = sum(row.failed for row in rows)
    summary = f"{path}: {f'faults: {failed}' if failed else 'ready'}"
    data = {
        "rig": str(path), "ok": not failed, "checks": [row.as_dict() for row in rows],
        "rows": [of_device(row) for row in rows],
    }  # fmt: skip
    return Answer(data, [*check_lines(rows), summary], "" if failed else None)


@rig.command(epilog="Example: deltact-fab rig sensors --new A1")
@click.option("--new", metavar="SERIAL", help="First write the file of a new sensor, to fill in.")
@answers
def sensors(new: str | None) -> Answer:
    """List the sensors in the ledger of this folder, files sensors/SERIAL.toml.

    If the folder sensors/ exists, `run`, `calibrate`, `measure` and `rig accept` add events to the
    file of a sensor whose serial number is stated. Presses are the complete ones of all runs, each
    once; simulated events count only for a sensor without real ones. `schema sensor` lists the keys
    of a file.
    """
    from deltact_fab.bench import SensorLedger

    notes = [] if new is None else [f"written: {SensorLedger.create(new)}; fill it in"]
    return listing(SensorLedger.COLUMNS, SensorLedger.list_sensors(), *notes)


@rig.command(epilog="Example: deltact-fab rig accept 0 dense --serial A1")
@click.argument("source", type=NAME_OR_PATH)
@click.argument("recipe", required=False, type=NAME_OR_PATH)
@click.option("--serial", metavar="TEXT", help="Serial number, used as file name.")
@click.option("--camera", type=PATH_TYPE, metavar="FILE", show_default="the design's lens",
              help="Camera file made by `calibrate lens`.")  # fmt: skip
@click.option("--design", type=NAME_OR_PATH, metavar="DESIGN", help="Design of the sensor.")
@click.option("--frames", type=click.IntRange(1, 10000), default=100,
              metavar="N", help="Number of images at rest.")  # fmt: skip
@click.option("--step", type=PATH_TYPE, metavar="RUN",
              help="Run of the protocol known-step on this sensor.")  # fmt: skip
@out_file("Annotated PNG of the face to write.", "picture", "--picture")
@seed("Seed of a virtual rig.")
@out_file("Acceptance file to write.", show_default="sensors/SERIAL.toml")
@answers
def accept(
    source: str, recipe: str | None, serial: str | None, camera: Path | None, design: str | None,
    frames: int, step: Path | None, picture: Path | None, seed: int, out: Path | None,
) -> Answer:  # fmt: skip
    """Check a finished sensor against its design before the first press.

    SOURCE is as for `measure`: a camera, a video, a folder of images, a run or a rig; nothing may
    touch the face. RECIPE is its pattern, if the source does not state it. The result is saved
    with an image of the face at rest, and `measure --serial` then reports changes. Exit code 1 if
    a row fails.
    """
    from deltact_fab.bench import SensorLedger
    from deltact_fab.fabricate import PatternRecipe, load_design, load_recipe
    from deltact_fab.present import accept_sensor, check_known_step, open_source

    if out is None and serial is not None:
        out = SensorLedger.file(serial)
    if out is not None:
        SensorLedger.require_not_accepted(out)
    steps = [] if step is None else check_known_step(step)
    images = open_source(source, camera, design, serial, seed, rest_only=True)
    try:
        model = images.model
        if recipe is None and model.recipe is None:
            raise InputError("RECIPE: missing; a name of `pattern list` or a recipe's file")
        expected = load_recipe(recipe) if recipe else validate(PatternRecipe, model.recipe, source)
        result = accept_sensor(images, expected, load_design(model.design or "deltact"), frames)
    finally:
        images.close()
    result = replace(result, rows=(*result.rows, *steps))
    if picture is not None:
        write_whole(picture, result.picture(model.camera))
    notes = [model.simulated] if model.simulated else []
    if out is not None and result.passed:
        notes += result.save(model, seed, out)
    if result.passed:
        notes.append(f"written: {out}" if out else "not saved: give --serial")
    return grade(source, result, "accepted", "", *notes)


@click.command()
@RIG_ARGUMENT
@click.option("--indenter", default="sphere:10", metavar="sphere:MM",
              help="Mounted ball.")  # fmt: skip
@click.option("--at", "places_mm", multiple=True, type=Point(), metavar="X,Y",
              help="Position of a touch, mm; give at least three.")  # fmt: skip
@DESIGN_OPTION
@TIP_IS_CLEAR
@out_file("Registration to write, .toml.", required=True)
@answers
def register(
    name: str, indenter: str, places_mm: tuple[tuple[float, float], ...], design: str,
    tip_is_clear: bool, out: Path,
) -> Answer:  # fmt: skip
    """Locate the face of the sensor by touching it with a ball.

    The rig homes, and the ball touches the face at several positions; height and tilt of the face
    are written to a file. Without --at four positions are touched, which also gives the flatness.
    Name the file as `registration` under [stage] of the rig file. The lateral position is found
    with a block around the sensor, see examples/find_the_block.py.
    """
    from deltact_fab.bench import register_rig
    from deltact_fab.fabricate import load_design

    registration = register_rig(name, load_design(design), indenter, places_mm, out, tip_is_clear)
    data = {"file": str(out), **registration.model_dump(mode="json", exclude_none=True)}
    return Answer(data, [f"{out}: {registration.line()}"])


@rig.command(epilog="Example: deltact-fab rig rehearse smoke --rig bench.toml --out rehearsed")
@click.argument("protocol", metavar="PROTOCOL", type=NAME_OR_PATH)
@click.option("--rig", "name", default="virtual", metavar="RIG",
              type=NAME_OR_PATH, help="Rig whose stage and guard are simulated.")  # fmt: skip
@click.option("--thorough", is_flag=True, help="Every fault at every moment (minutes).")
@out_folder("Folder for a page and JSON.")
@answers
def rehearse(protocol: str, name: str, thorough: bool, out: Path | None) -> Answer:
    """Rehearse a protocol with every fault on the simulated stage of a rig file.

    Lost and mangled answers, silence, a pulled cable, alarms, switches, an open door, forces over
    the limit, a lost sensor or camera, a full disk: at every change of state of the deepest press,
    and at random moments between. Reports the operator's message, how far the tip still moves, and
    whether --resume gives the same record. No device is opened. Exit code 1 if a fault has another
    outcome than required.
    """
    from deltact_fab.bench import check_limits, expand_protocol, load_protocol, load_rig
    from deltact_fab.common import Check, require_pages
    from deltact_fab.fabricate import load_design
    from deltact_fab.simulate import FaultScenario
    from deltact_fab.studies import rehearse

    declared, path = load_protocol(protocol)
    bench, bench_path = load_rig(name)
    if out is not None:
        require_pages()
    design, steps = load_design(declared.specimen.design), expand_protocol(declared)
    Check.require(check_limits(declared, design, bench.stage, steps), str(path))
    scenario = FaultScenario.from_protocol(declared, path.read_bytes(), bench)
    with progress("rehearse") as report:
        result = rehearse(scenario, thorough, report)
    data = result.as_dict()
    lines = [result.verdict()]
    lines += [f"{c.fault}, {c.moment}: {c.wrong}; {c.outcome}" for c in result.wrong]
    if out is not None:
        from deltact_fab.present import write_rehearsal_page

        lines += [f"written: {file}" for file in
                  write_rehearsal_page(data, path.stem, bench_path.stem, out)]  # fmt: skip
    return Answer(data, lines, "" if result.wrong else None)


for _command in rig_stage.STAGE_COMMANDS:
    rig.add_command(_command)
rig.add_command(register)
