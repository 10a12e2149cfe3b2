"""`deltact-fab cad`: parts to look up, check, write, buy and put together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from .group import CommandGroup
from .options import (
    CAMERA_NAME,
    DESIGN,
    DESIGN_NAME,
    JSON,
    NEW_FILE,
    ON,
    PART_NAME,
    PATH,
    PROCESSES,
    out_file,
    out_folder,
)

if TYPE_CHECKING:
    from ..cad.dimensions import Design

F = TypeVar("F", bound=Callable[..., Any])


@click.group(cls=CommandGroup)
def cad() -> None:
    """Parametric parts of the sensor, its mold, bench and indenters.

    Every number is in a design (`cad designs`); --set changes one for a single command.
    """


def of_design(command: F) -> F:
    """Options that name a design and change it."""
    command = click.option(
        "--set",
        "changes",
        multiple=True,
        metavar="SECTION.KEY=VALUE",
        help="Change a dimension, as in skin.width_mm=44; repeatable. `cad show PART` lists them.",
    )(command)
    return DESIGN(command)


SENSORS = click.option(
    "--sensors", type=int, default=1, show_default=True, metavar="N",
    help="How many sensors to make.",
)  # fmt: skip
CACHE = click.option(
    "--cache/--no-cache", default=True, show_default=True, help="Reuse earlier results."
)


def load(design: str, changes: tuple[str, ...]) -> Design:
    """The design with its changes, every inequality enforced."""
    from ..cad import feasibility
    from ..cad.design import load_design

    loaded = load_design(design, changes)
    feasibility.check(loaded, design)
    return loaded


@contextmanager
def file_to_write(out: Path) -> Iterator[None]:
    """Refuse a folder and make the parent before the work inside, which writes the file.

    On failure the folders that were made go again. Raises InputError.
    """
    from ..errors import InputError

    if out.is_dir():
        raise InputError(f"-o {out}: a folder; expected the name of a file")
    made = [path for path in out.parents if not path.exists()]
    try:
        try:
            out.parent.mkdir(parents=True, exist_ok=True)
        except OSError as why:
            raise InputError(f"-o {out}: its folder cannot be made: {why.strerror}") from why
        yield
    except BaseException:
        for path in made:
            with suppress(OSError):
                path.rmdir()
        raise


@cad.command(epilog="Example: deltact-fab cad new mine --base skin-44x40")
@click.argument("name")
@click.option("--base", type=DESIGN_NAME, default="deltact", show_default=True, metavar="DESIGN",
              help="Design to start from: a name of `cad designs` or a path.")  # fmt: skip
@click.option("--face", metavar="WxL", help="Solve for a face of these sides in mm, as in 60x50.")
@click.option("--share", type=float, default=0.55, show_default=True,
              help="Least share of the face that the camera sees.")  # fmt: skip
@click.option("--camera", type=CAMERA_NAME, metavar="CAMERA",
              help="A camera of `cad cameras`; the base's unless given.")  # fmt: skip
@NEW_FILE
@JSON
def new(
    name: str,
    base: str,
    face: str | None,
    share: float,
    camera: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Write a new design with every dimension explained.

    Each dimension is there as its base has it, commented out; uncomment those to change. With
    --face, what follows from it and from the camera is solved for and set: housing, plate, gap,
    view, light, screws, pegs, envelope, mold. What cannot be is refused, with the smallest change
    that can.
    """
    from ..errors import InputError
    from ..lab import design as write
    from .output import echo_written

    wish = None
    if face is not None:
        from ..cad.intent import wish_of

        wish = wish_of(face, share, camera)
    elif camera is not None:
        raise InputError("--camera: say for which face it is, as in --face 60x50")
    echo_written(write(name, base, out, wish), as_json, f"cad check --design {name}")


@cad.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Parts that can be exported, with group, material, process and quantity."""
    from ..cad.registry import listed
    from .output import echo_rows

    columns = ("part", "group", "material", "process", "quantity")
    rows = [(p.name, p.group, p.material, p.process, p.quantity) for p in listed()]
    echo_rows(columns, rows, as_json)
    if not as_json:
        click.echo("\nAny indenter is a part too: sphere:DIAMETER_MM, star:SIZE_MM and so on.")


@cad.command()
@JSON
def cameras(as_json: bool) -> None:
    """Cameras that a design can be made for (cad/cameras.toml), each with its sources."""
    from ..cad.cameras import load_cameras
    from .output import echo_rows

    columns = ("camera", "module", "focal_length_mm", "projection", "picture_px", "source")
    rows = [
        (name, c.name, c.focal_length_mm, c.projection, f"{c.crop_width_px} x {c.crop_height_px}",
         c.source)
        for name, c in load_cameras().items()
    ]  # fmt: skip
    echo_rows(columns, rows, as_json)


@cad.command("designs")
@JSON
def designs_(as_json: bool) -> None:
    """Designs that can be named: your own and the shipped ones."""
    from ..cad.design import load_design
    from ..catalog import designs, find, read
    from .output import echo_rows

    rows = []
    for name in designs():
        skin = load_design(name).skin
        base = read(find("cad", name)).get("base")
        rows.append((name, base, skin.width_mm, skin.length_mm, skin.thickness_mm))
    columns = ("design", "base", "width_mm", "length_mm", "thickness_mm")
    echo_rows(columns, rows, as_json)


@cad.command(epilog="Example: deltact-fab cad show shell --design franka")
@click.argument("part", type=PART_NAME)
@of_design
@JSON
def show(part: str, design: str, changes: tuple[str, ...], as_json: bool) -> None:
    """Dimensions of PART with meaning and limits, and the inequalities that they must satisfy.

    PART is a name of `cad list`.
    """
    from dataclasses import asdict

    from ..cad.design import load_design
    from ..cad.registry import find
    from ..cad.show import describe
    from .output import echo_json, echo_table

    told = describe(find(part), load_design(design, changes))
    if as_json:
        echo_json(asdict(told))
        return
    for title, columns, rows in told.tables():
        click.echo(f"\n{title}" if title else "")
        echo_table(columns, rows)


@cad.command()
@of_design
@CACHE
@JSON
def check(design: str, changes: tuple[str, ...], cache: bool, as_json: bool) -> None:
    """Check the whole design on its solids: a table of passes and failures.

    Exit code 1 when a check fails.
    """
    from dataclasses import asdict

    from ..cad.check import run
    from ..cad.design import load_design
    from ..errors import RunFailed
    from .output import echo_json, echo_table, progress

    with progress("cad check") as tell:
        rows = run(load_design(design, changes), tell, cached=cache)
    if as_json:
        echo_json([{**asdict(row), "verdict": row.verdict} for row in rows])
    else:
        columns = ("check", "part", "found", "limit", "verdict")
        echo_table(columns, [(r.check, r.part, r.found, r.limit, r.verdict) for r in rows])
        unverified = sum(bool(r.rests_on) for r in rows if r.passed)
        click.echo(
            f"\n{sum(r.passed for r in rows)} of {len(rows)} checks pass, {unverified} of them on "
            "values that nobody has measured yet"
        )
    failed = [row for row in rows if row.verdict == "FAIL"]
    if failed:
        named = ", ".join(dict.fromkeys(f"{row.check} ({row.part})" for row in failed))
        raise RunFailed(f"{design}: {len(failed)} of {len(rows)} checks failed: {named}")


@cad.command(epilog="Example: deltact-fab cad export sensor sphere:12.5 --out parts")
@click.argument("parts", nargs=-1, metavar="[PART]...", type=PART_NAME)
@of_design
@click.option(
    "--format",
    "formats",
    default="step,stl,3mf,dxf,glb,svg,pdf",
    show_default=True,
    metavar="LIST",
    help="Formats, separated by commas; each part gets those that suit it.",
)
@click.option(
    "--tolerance",
    "tolerance_mm",
    type=float,
    default=0.01,
    show_default=True,
    metavar="MM",
    help="Largest distance of a mesh from the true surface.",
)
@out_folder("Folder to write into.", default=Path("cad-out"), show_default=True)
@PROCESSES
@ON
@CACHE
@JSON
def export(
    parts: tuple[str, ...],
    design: str,
    changes: tuple[str, ...],
    formats: str,
    tolerance_mm: float,
    out: Path,
    jobs: int | None,
    on: str,
    cache: bool,
    as_json: bool,
) -> None:
    """Write each PART and the assembly, with a manifest.json; without PART, everything.

    A PART is a name of `cad list`, a group (sensor, electronics, tools, bench, indenters), or an
    indenter as in a protocol: sphere:10, 4dots. The assembly and the wiring are written with the
    whole sensor. STEP is for the machine shop, STL or 3MF for the printer, DXF for the laser, GLB
    for a 3D viewer; drawings are PDF and SVG.

    Files of an earlier export that this one does not write again are removed, unless you changed
    them.
    """
    from dataclasses import asdict

    from ..cad.export import export_parts
    from ..cad.registry import select
    from ..jobs import executor
    from .output import echo_json, echo_table, progress

    dims, chosen = load(design, changes), select(parts)
    # Where nobody says how, the work that is left decides.
    here = nullcontext() if on == "local" else executor(on, jobs)
    with here as where, progress("cad export") as tell:
        files = export_parts(
            dims, chosen, formats.split(","), tolerance_mm, out, tell,
            cached=cache, jobs=jobs, executor=where,
        )  # fmt: skip
    if as_json:
        echo_json([asdict(f) for f in files])
        return
    rows = []
    for part in dict.fromkeys(f.part for f in files):
        own = [f for f in files if f.part == part]
        deviations = [f.mesh_deviation_mm for f in own if f.mesh_deviation_mm is not None]
        kinds = " ".join(f.file.removeprefix(f"{part}.") for f in own)
        worst = max(deviations, default=None)
        rows.append((part, own[0].quantity, kinds, own[0].volume_mm3, worst, own[0].process))
    columns = ("part", "pieces", "files", "volume_mm3", "mesh_deviation_mm", "process")
    echo_table(columns, rows)
    click.echo(f"\n{len(files)} files and manifest.json in {out}")


@cad.command(epilog="Example: deltact-fab cad bom --sensors 4 -o bom.csv")
@of_design
@SENSORS
@out_file("Write it as .csv or .json instead of printing it.")
@JSON
def bom(
    design: str, changes: tuple[str, ...], sensors: int, out: Path | None, as_json: bool
) -> None:
    """Bill of materials: parts, silicone, screws and electronics for a number of sensors."""
    import json
    from dataclasses import asdict

    from ..cad.fabrication.bom import csv_text, lines
    from ..errors import InputError
    from ..files import write_whole
    from .output import echo_json, echo_table, echo_written

    if out is not None and out.suffix not in (".csv", ".json") and not out.is_dir():
        raise InputError(f"-o {out}: end the name in .csv or .json")
    listed = lines(load(design, changes), sensors)
    plain = [asdict(line) for line in listed]
    if out is not None:
        text = csv_text(listed) if out.suffix == ".csv" else json.dumps(plain, indent=1) + "\n"
        with file_to_write(out):
            write_whole(out, text.encode())
        echo_written(out, as_json)
    elif as_json:
        echo_json(plain)
    else:
        columns = ("item", "part", "material", "process", "quantity", "unit", "note")
        rows = [
            (*(line[c] for c in columns), str(at.source or "made here"))
            for line, at in zip(plain, listed, strict=True)
        ]
        echo_table((*columns, "to order"), rows, names=2)


@cad.command(epilog="Example: deltact-fab cad fit readings.csv -o mine.toml")
@click.argument("readings", type=PATH)
@DESIGN
@out_file("Design to write: --design with the measured values in it.")
@JSON
def fit(readings: Path, design: str, out: Path | None, as_json: bool) -> None:
    """What your printer and laser really do, from READINGS of the two coupons, a CSV file.

    Columns: coupon (fit-coupon, kerf-coupon), feature (hole, slot, outside, height; strip,
    thickness), nominal_mm, measured_mm, and pieces for strips measured side by side. A spread is
    the 95 % interval of the next piece.
    """
    import math
    from dataclasses import asdict

    from ..cad.design import load_design
    from ..cad.fabrication.readings import as_design, estimates, read
    from ..files import write_whole
    from .output import echo_json, echo_table, echo_written

    found = estimates(read(readings), load_design(design))
    if out is not None:
        with file_to_write(out):
            write_whole(out, as_design(design, found, readings.name).encode())
    if as_json:
        plain = [asdict(e) for e in found]
        for row in plain:
            row["spread_mm"] = None if math.isnan(row["spread_mm"]) else row["spread_mm"]
        echo_json(plain)
        return
    rows = [
        (
            e.key, f"{e.value:g}", f"{e.before:g}", e.count, f"{e.bias_mm:+.3f}",
            "" if math.isnan(e.spread_mm) else f"{e.spread_mm:.3f}",
        )
        for e in found
    ]  # fmt: skip
    echo_table(("key", "read", "design", "readings", "bias_mm", "spread_mm (95 %)"), rows)
    if out is not None:
        echo_written(out, as_json)


@cad.command(epilog="Example: deltact-fab cad guide --sensors 4 -o guide.html")
@of_design
@SENSORS
@out_file("Page to write.", default=Path("guide.html"), show_default=True)
@JSON
def guide(design: str, changes: tuple[str, ...], sensors: int, out: Path, as_json: bool) -> None:
    """Fabrication guide of a design, one offline page: print, cast, wire, assemble."""
    from ..report.guide import write
    from .output import echo_written, progress

    dims = load(design, changes)
    with file_to_write(out), progress("cad guide") as tell:
        page = write(dims, out, sensors, tell)
    echo_written(page, as_json)
