"""`deltact-fab cad`: list, check, export, order and assemble parts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from deltact_fab.common import InputError, catalogue_names, find_file, read_toml, write_whole

from .group import CommandGroup
from .old_keys import of_part
from .options import DESIGN_OPTION, JOBS_OPTION, NAME_OR_PATH, NEW_FILE, out_file, out_folder
from .output import Answer, answers, check_lines, columns_of, file_note, listing, progress, table

if TYPE_CHECKING:
    from deltact_fab.fabricate import Design


@click.group(cls=CommandGroup)
def cad() -> None:
    """Parametric parts of the sensor, its mold, bench and indenters.

    Every dimension is in a design (`cad list designs`); --set changes one for a single command.
    """


def design_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add options that name a design and change it."""
    command = click.option(
        "--set",
        "changes",
        multiple=True,
        metavar="SECTION.KEY=VALUE",
        help="Change a dimension, as in skin.width_mm=44; repeatable. `cad show PART` lists them.",
    )(command)
    return DESIGN_OPTION(command)


SENSORS_OPTION = click.option(
    "--sensors", type=int, default=1, metavar="N", help="Number of sensors to make.",
)  # fmt: skip


FORCE_OPTION = click.option(
    "--force", is_flag=True, help="Write a design that fails, marked as not to be built.",
)  # fmt: skip


def load_feasible(design: str, changes: tuple[str, ...]) -> Design:
    """Load the design with its changes. Raises InputError if a design rule fails."""
    from deltact_fab.fabricate import check_feasible, load_design

    loaded = load_design(design, changes)
    check_feasible(loaded, design)
    return loaded


@cad.command(epilog="Example: deltact-fab cad new tip --face 24x24 --gel 6")
@click.argument("name")
@click.option("--base", type=NAME_OR_PATH, default="deltact", metavar="DESIGN",
              help="Design to start from: a name of `cad list designs` or a path.")  # fmt: skip
@click.option("--face", metavar="WxL", help="Solve for a face of this size in mm, such as 60x50.")
@click.option("--share", type=float, metavar="SHARE",
              help="Smallest fraction of the face that the camera sees; default: 0.55, without "
              "--face the base's.")  # fmt: skip
@click.option("--gel", type=float, metavar="MM",
              help="Thickness of the gel, 2 mm or more; default: that of the base.")  # fmt: skip
@click.option("--camera", metavar="CAMERA",
              help="Camera from `cad list cameras`; default: that of the base.")  # fmt: skip
@click.option("--mount", metavar="HOLES",
              help="Flange with a pattern of holes: '30x30 M3', 'circle 50 6xM4', "
              "'ISO 9409-1-50-4-M6'; default: the base's mount.")  # fmt: skip
@click.option("--cable", metavar="SIDE", help="Side of the cable: -y, -x or +x.")
@click.option("--nearest", is_flag=True,
              help="If no design passes, write the nearest one that does.")  # fmt: skip
@NEW_FILE
@answers
def new(
    name: str, base: str, face: str | None, share: float | None, gel: float | None,
    camera: str | None, mount: str | None, cable: str | None, nearest: bool, out: Path | None,
) -> Answer:  # fmt: skip
    """Write a new design with every dimension explained.

    Each dimension of the base is listed, commented out; uncomment those to change. With --face,
    --gel, --camera, --mount or --cable all that depends on them is solved and set: housing, plate,
    gap, view, light, screws, pegs, envelope, mold. The result is checked like by `cad check`; its
    verdict heads the file, exit code 1 if it fails. An impossible request is refused, with the
    changes that make it possible.
    """
    from ..lab import design as write
    from ..lab import new_file

    if (face, gel, camera, mount, cable) == (None,) * 5:
        if share is not None or nearest:
            raise InputError("--share and --nearest need --face, such as --face 60x50")
        return file_note(write(name, base, out), f"cad check --design {name}")
    from deltact_fab.fabricate import Wish, load_design, solve_wish

    start = load_design(base)
    if share is None and face is None:
        share = start.optics.least_view_share
    face = face or f"{start.skin.width_mm:g}x{start.skin.length_mm:g}"
    wish = Wish.parse(face, share, camera, gel, mount, cable)
    if (file := new_file("design", name, out)).exists():
        raise InputError(f"{file}: already exists; name a new file")
    with progress("cad new") as tell:
        solution = solve_wish(wish, start, name, tell, nearest)
    figures, verdict = [asdict(figure) for figure in solution.figures], solution.verdict
    head = [solution.summary, *solution.notes]
    faults = [str(finding.value) for finding in verdict.findings()][1:]
    file = write(name, base, out, solution.design, [*head, *faults])
    note = file_note(file, f"cad check --design {name}")
    data = {
        **note.data, "wish": asdict(solution.wish), "figures": figures,
        "notes": solution.notes, "verdict": verdict.failure or verdict.text,
        "failed": [row.as_dict() for row in verdict.failed],
    }  # fmt: skip
    lines = [
        *head, "",
        *columns_of(("name", "value", "base", "unit"), figures), "",
        *(check_lines(verdict.failed) if verdict.failed else ()), *note.lines,
    ]  # fmt: skip
    return Answer(data, lines, verdict.failure)


@cad.command("list", epilog="Example: deltact-fab cad list designs")
@click.argument("kind", type=click.Choice(["parts", "designs", "cameras"]), default="parts",
                metavar="[WHAT]")  # fmt: skip
@answers
def list_(kind: str) -> Answer:
    """List parts that can be exported; or designs or cameras.

    Parts with group, material, process and quantity; your own and the shipped designs; cameras of
    cad/cameras.toml with their sources.
    """
    return {"parts": _list_parts, "designs": _list_designs, "cameras": _list_cameras}[kind]()


def _list_parts() -> Answer:
    from deltact_fab.fabricate import list_parts as parts

    columns = ("part", "group", "material", "process", "quantity")
    rows = [(p.name, p.group, p.material, p.process, p.quantity) for p in parts()]
    note = "Indenters are parts too: sphere:DIAMETER_MM, star:SIZE_MM and others."
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
    """Show the dimensions of PART, a name of `cad list`, with meaning and limits."""
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
    """Check the whole design on its solids; exit code 1 if a check fails."""
    from deltact_fab.fabricate import judge_design, load_design, shorten_key

    with progress("cad check") as tell:
        verdict = judge_design(load_design(design, changes), design, tell, without_kernel=False)
    rows = verdict.rows
    data = [{**row.as_dict(), **of_part(row)} for row in rows]
    short_rows = (replace(r, basis=tuple(dict.fromkeys(map(shorten_key, r.basis)))) for r in rows)
    return Answer(data, [*check_lines(short_rows), "", verdict.text], verdict.failure)


@cad.command(epilog="Example: deltact-fab cad export sensor sphere:12.5 --out parts")
@click.argument("parts", nargs=-1, metavar="[PART]...")
@design_options
@click.option("--format", "formats", default="step,stl,3mf,dxf,glb,svg,pdf", metavar="LIST",
              help="Formats, comma-separated; each part is written in those for it.")  # fmt: skip
@click.option("--tolerance", "tolerance_mm", type=float, default=0.01, metavar="MM",
              help="Largest distance of a mesh from the true surface.")  # fmt: skip
@FORCE_OPTION
@out_folder("Folder to write into.", default=Path("cad-out"))
@JOBS_OPTION
@answers
def export(
    parts: tuple[str, ...], design: str, changes: tuple[str, ...], formats: str,
    tolerance_mm: float, force: bool, out: Path, jobs: int | None,
) -> Answer:  # fmt: skip
    """Write each PART and the assembly, with an index page; without PART, everything to order.

    Files lie in a folder per process: print, laser, machine, order, assembly. A design that fails
    its checks is refused: with PART its rules and the solids of these parts, else all of `cad
    check`.

    A PART is a name of `cad list`, a group (sensor, electronics, tools, bench, indenters), or an
    indenter as in a protocol: sphere:10, 4dots. Assembly and wiring are written with the complete
    sensor. STEP is for the machine shop, STL or 3MF for the printer, DXF for the laser, GLB
    for a 3D viewer; drawings are PDF and SVG.
    """
    from deltact_fab.fabricate import export_parts, judge_design, select_parts

    dims, chosen = load_feasible(design, changes), select_parts(parts)
    with progress("cad export") as tell:
        judge = cache(lambda: judge_design(dims, design, tell, chosen if parts else None))
        files = export_parts(
            dims, chosen, formats.split(","), tolerance_mm, out, tell, jobs=jobs, judge=judge,
            force=force,
        )  # fmt: skip
    plain = [asdict(f) for f in files]
    index = ", index.html" * (out / "index.html").is_file()  # needs the extra `report`
    summary = f"{len(files)} files, manifest.json{index} in {out}"
    lines = columns_of(("file", "quantity", "process", "volume_mm3", "mesh_deviation_mm"), plain)
    return Answer(plain, [judge().headline, "", *lines, "", summary])


@cad.command(epilog="Example: deltact-fab cad bom --sensors 4 -o bom.csv")
@design_options
@SENSORS_OPTION
@FORCE_OPTION
@out_file("File to write, .csv or .json, instead of printing.")
@answers
def bom(
    design: str, changes: tuple[str, ...], sensors: int, force: bool, out: Path | None
) -> Answer:
    """Write the bill of materials: parts, silicone, screws and electronics for several sensors.

    Its first line, item 0, is the verdict of `cad check` on the design.
    """
    from deltact_fab.fabricate import bom_lines, judge_design

    if out is not None and out.suffix not in (".csv", ".json"):
        raise InputError(f"-o {out}: must end in .csv or .json")
    dims = load_feasible(design, changes)
    bill = bom_lines(dims, sensors)
    with progress("cad check") as tell:
        verdict = judge_design(dims, design, tell)
    verdict.require(force)
    bill = bill.headed(verdict.headline)
    plain = [asdict(line) for line in bill]
    if out is not None:
        text = bill.csv() if out.suffix == ".csv" else json.dumps(plain, indent=1) + "\n"
        write_whole(out, text.encode())
        return file_note(out)
    columns = ("item", "part", "material", "process", "quantity", "unit", "note")
    rows = [
        (*(line[c] for c in columns), str(item.source or ("made here" if item.item else "")))
        for line, item in zip(plain, bill, strict=True)
    ]
    return Answer(plain, table((*columns, "to order"), rows))


@cad.command(epilog="Example: deltact-fab cad fit readings.csv -o mine.toml")
@click.argument("readings", type=click.Path(path_type=Path))
@DESIGN_OPTION
@out_file("Write a design based on --design with the measured values.")
@answers
def fit(readings: Path, design: str, out: Path | None) -> Answer:
    """Estimate the errors of your printer and laser from READINGS of the two coupons (CSV).

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
@SENSORS_OPTION
@FORCE_OPTION
@out_file("Page to write.", default=Path("guide.html"))
@answers
def guide(design: str, changes: tuple[str, ...], sensors: int, force: bool, out: Path) -> Answer:
    """Write the fabrication guide of a design, one offline page: print, cast, wire, assemble.

    Its head is the verdict of `cad check` on the design.
    """
    from deltact_fab.fabricate import judge_design, write_guide
    from deltact_fab.present import render_examples

    dims = load_feasible(design, changes)
    with progress("cad check") as tell:
        verdict = judge_design(dims, design, tell)
    with progress("cad guide") as tell:
        page = write_guide(
            dims, out, sensors, tell, examples=render_examples, verdict=verdict, force=force
        )
    return file_note(page)
