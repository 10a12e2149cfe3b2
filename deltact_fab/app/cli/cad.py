"""`deltact-fab cad`: parts to look up, check, write, buy and put together."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from deltact_fab.common import InputError, catalogue_names, find_file, read_toml, write_whole

from .group import CommandGroup
from .old_keys import of_part
from .options import DESIGN, NAME_OR_PATH, NEW_FILE, PATH, PROCESSES, out_file, out_folder
from .output import Answer, answers, check_lines, columns_of, file_note, listing, progress, table

if TYPE_CHECKING:
    from deltact_fab.fabricate import Design

F = TypeVar("F", bound=Callable[..., Any])


@click.group(cls=CommandGroup)
def cad() -> None:
    """Parametric parts of the sensor, its mold, bench and indenters.

    Every number is in a design (`cad list designs`); --set changes one for a single command.
    """


def design_options(command: F) -> F:
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
    "--sensors", type=int, default=1, metavar="N", help="How many sensors to make.",
)  # fmt: skip


def load_feasible(design: str, changes: tuple[str, ...]) -> Design:
    """The design with its changes, every inequality enforced."""
    from deltact_fab.fabricate import check_feasible, load_design

    loaded = load_design(design, changes)
    check_feasible(loaded, design)
    return loaded


@cad.command(epilog="Example: deltact-fab cad new mine --base skin-44x40")
@click.argument("name")
@click.option("--base", type=NAME_OR_PATH, default="deltact", metavar="DESIGN",
              help="Design to start from: a name of `cad list designs` or a path.")  # fmt: skip
@click.option("--face", metavar="WxL", help="Solve for a face of these sides in mm, as in 60x50.")
@click.option("--share", type=float, default=0.55,
              help="Least share of the face that the camera sees.")  # fmt: skip
@click.option("--camera", metavar="CAMERA",
              help="A camera of `cad list cameras`; the base's unless given.")  # fmt: skip
@NEW_FILE
@answers
def new(
    name: str, base: str, face: str | None, share: float, camera: str | None, out: Path | None
) -> Answer:
    """Write a new design with every dimension explained.

    Each dimension is there as its base has it, commented out; uncomment those to change. With
    --face, what follows from it and from the camera is solved for and set: housing, plate, gap,
    view, light, screws, pegs, envelope, mold. What cannot be is refused, with the smallest change
    that can.
    """
    from ..lab import design as write

    wish = None
    if face is not None:
        from deltact_fab.fabricate import Wish

        wish = Wish.parse(face, share, camera)
    elif camera is not None:
        raise InputError("--camera: say for which face it is, as in --face 60x50")
    return file_note(write(name, base, out, wish), f"cad check --design {name}")


@cad.command("list", epilog="Example: deltact-fab cad list designs")
@click.argument("what", type=click.Choice(["parts", "designs", "cameras"]), default="parts",
                metavar="[WHAT]")  # fmt: skip
@answers
def list_(kind: str) -> Answer:
    """Parts that can be exported; or designs or cameras, where WHAT says so.

    A part has its group, material, process and quantity; designs are your own and the shipped ones;
    a camera, from cad/cameras.toml, has its sources.
    """
    return {"parts": _list_parts, "designs": _list_designs, "cameras": _list_cameras}[kind]()


def _list_parts() -> Answer:
    from deltact_fab.fabricate import list_parts as parts

    columns = ("part", "group", "material", "process", "quantity")
    rows = [(p.name, p.group, p.material, p.process, p.quantity) for p in parts()]
    note = "Any indenter is a part too: sphere:DIAMETER_MM, star:SIZE_MM and so on."
    return listing(columns, rows, "", note)


def _list_cameras() -> Answer:
    from deltact_fab.fabricate import load_cameras

    columns = ("camera", "module", "focal_length_mm", "projection", "picture_px", "source")
    rows = [
        (name, c.name, c.focal_length_mm, c.projection, f"{c.crop_width_px} x {c.crop_height_px}",
         c.source)
        for name, c in load_cameras().items()
    ]  # fmt: skip
    return listing(columns, rows)


def _list_designs() -> Answer:
    from deltact_fab.fabricate import load_design

    from ..lab import kind_of

    rows = []
    for name in catalogue_names("cad"):
        data = read_toml(find_file("cad", name))
        if kind_of("cad", data) != "design":
            continue
        skin = load_design(name).skin
        rows.append((name, data.get("base"), skin.width_mm, skin.length_mm, skin.thickness_mm))
    return listing(("design", "base", "width_mm", "length_mm", "thickness_mm"), rows)


@cad.command(epilog="Example: deltact-fab cad show shell --design franka")
@click.argument("part")
@design_options
@answers
def show(part: str, design: str, changes: tuple[str, ...]) -> Answer:
    """Dimensions of PART with meaning and limits.

    PART is a name of `cad list`.
    """
    from deltact_fab.fabricate import find_part, load_design

    entry = find_part(part)
    about = {n: getattr(entry, n) for n in ("name", "group", "material", "process", "quantity")}
    dimensions = list(entry.dimensions(load_design(design, changes)))
    dimension_lines = table(("key", "value", "limits", "meaning"), [d.row for d in dimensions])
    data = {**about, "dimensions": [asdict(d) for d in dimensions]}
    return Answer(data, [*columns_of(tuple(about), [about]), "", *dimension_lines])


@cad.command()
@design_options
@answers
def check(design: str, changes: tuple[str, ...]) -> Answer:
    """Check the whole design on its solids: a table of passes and failures.

    Exit code 1 when a check fails.
    """
    from deltact_fab.fabricate import check_design, load_design, shorten_key

    with progress("cad check") as tell:
        rows = check_design(load_design(design, changes), tell, cached=True)
    passed = [row for row in rows if row.status == "pass"]
    unverified = sum(bool(row.basis) for row in passed)
    summary = (
        f"{len(passed)} of {len(rows)} checks pass, {unverified} of them on "
        "values that nobody has measured yet"
    )
    data = [{**row.as_dict(), **of_part(row)} for row in rows]
    short_rows = (replace(r, basis=tuple(dict.fromkeys(map(shorten_key, r.basis)))) for r in rows)
    failed = sum(row.failed for row in rows)
    failure = f"{design}: {failed} of {len(rows)} checks failed" if failed else None
    return Answer(data, [*check_lines(short_rows), "", summary], failure)


@cad.command(epilog="Example: deltact-fab cad export sensor sphere:12.5 --out parts")
@click.argument("parts", nargs=-1, metavar="[PART]...")
@design_options
@click.option("--format", "formats", default="step,stl,3mf,dxf,glb,svg,pdf", metavar="LIST",
              help="Formats, separated by commas; each part gets those that suit it.")  # fmt: skip
@click.option("--tolerance", "tolerance_mm", type=float, default=0.01, metavar="MM",
              help="Largest distance of a mesh from the true surface.")  # fmt: skip
@out_folder("Folder to write into.", default=Path("cad-out"))
@PROCESSES
@answers
def export(
    parts: tuple[str, ...], design: str, changes: tuple[str, ...], formats: str,
    tolerance_mm: float, out: Path, jobs: int | None,
) -> Answer:  # fmt: skip
    """Write each PART and the assembly, with a manifest.json; without PART, everything.

    A PART is a name of `cad list`, a group (sensor, electronics, tools, bench, indenters), or an
    indenter as in a protocol: sphere:10, 4dots. The assembly and the wiring are written with the
    whole sensor. STEP is for the machine shop, STL or 3MF for the printer, DXF for the laser, GLB
    for a 3D viewer; drawings are PDF and SVG.
    """
    from deltact_fab.fabricate import export_parts, select_parts

    dims, chosen = load_feasible(design, changes), select_parts(parts)
    with progress("cad export") as tell:
        files = export_parts(dims, chosen, formats.split(","), tolerance_mm, out, tell, jobs=jobs)
    plain = [asdict(f) for f in files]
    summary = f"{len(files)} files and manifest.json in {out}"
    lines = columns_of(("file", "quantity", "process", "volume_mm3", "mesh_deviation_mm"), plain)
    return Answer(plain, [*lines, "", summary])


@cad.command(epilog="Example: deltact-fab cad bom --sensors 4 -o bom.csv")
@design_options
@SENSORS
@out_file("Write it as .csv or .json instead of printing it.")
@answers
def bom(design: str, changes: tuple[str, ...], sensors: int, out: Path | None) -> Answer:
    """Bill of materials: parts, silicone, screws and electronics for a number of sensors."""
    from deltact_fab.fabricate import bom_lines

    if out is not None and out.suffix not in (".csv", ".json"):
        raise InputError(f"-o {out}: end the name in .csv or .json")
    bill = bom_lines(load_feasible(design, changes), sensors)
    plain = [asdict(line) for line in bill]
    if out is not None:
        text = bill.csv() if out.suffix == ".csv" else json.dumps(plain, indent=1) + "\n"
        write_whole(out, text.encode())
        return file_note(out)
    columns = ("item", "part", "material", "process", "quantity", "unit", "note")
    rows = [
        (*(line[c] for c in columns), str(item.source or "made here"))
        for line, item in zip(plain, bill, strict=True)
    ]
    return Answer(plain, table((*columns, "to order"), rows))


@cad.command(epilog="Example: deltact-fab cad fit readings.csv -o mine.toml")
@click.argument("readings", type=PATH)
@DESIGN
@out_file("Design to write: --design with the measured values in it.")
@answers
def fit(readings: Path, design: str, out: Path | None) -> Answer:
    """Estimate what your printer and laser are off by, from READINGS of the two coupons (CSV).

    Columns: coupon (fit-coupon, kerf-coupon), feature (hole, slot, outside, height; strip,
    thickness), nominal_mm, measured_mm, and pieces for strips measured side by side. A spread is
    the 95 % interval of the next piece.
    """
    from deltact_fab.fabricate import fit_design

    estimates, text = fit_design(readings, design)
    if out is not None:
        write_whole(out, text.encode())
    plain = [asdict(e) for e in estimates]
    for row in plain:
        row["spread_mm"] = None if math.isnan(row["spread_mm"]) else row["spread_mm"]
    estimate_lines = columns_of(("key", "value", "before", "count", "bias_mm", "spread_mm"), plain)
    return Answer(plain, [*estimate_lines, *([f"written: {out}"] if out else [])])


@cad.command(epilog="Example: deltact-fab cad guide --sensors 4 -o guide.html")
@design_options
@SENSORS
@out_file("Page to write.", default=Path("guide.html"))
@answers
def guide(design: str, changes: tuple[str, ...], sensors: int, out: Path) -> Answer:
    """Fabrication guide of a design, one offline page: print, cast, wire, assemble."""
    from deltact_fab.fabricate import write_guide
    from deltact_fab.present import render_examples

    dims = load_feasible(design, changes)
    with progress("cad guide") as tell:
        return file_note(write_guide(dims, out, sensors, tell, examples=render_examples))
