"""`deltact-fab cad`: parts to look up, check, write, buy and put together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from .options import JSON, NEW_FILE

if TYPE_CHECKING:
    from ..cad.dimensions import Design

F = TypeVar("F", bound=Callable[..., Any])


@click.group()
def cad() -> None:
    """Parametric parts: list, new, show, check, fit, export, bill of materials, guide."""


def of_design(command: F) -> F:
    """Options that name a design and change it."""
    command = click.option(
        "--set",
        "changes",
        multiple=True,
        metavar="SECTION.KEY=VALUE",
        help="Change a dimension, as in skin.width_mm=44; may be repeated.",
    )(command)
    return click.option(
        "--design", default="deltact", show_default=True, help="Design: a path or a name."
    )(command)


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
        raise InputError(f"-o {out}: a folder; the name of a file is right")
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


@cad.command()
@click.argument("name")
@click.option("--base", default="deltact", show_default=True,
              help="Design that it takes the rest from, a name or a path.")  # fmt: skip
@NEW_FILE
@JSON
def new(name: str, base: str, out: Path | None, as_json: bool) -> None:
    """Write a design with every dimension explained.

    Each stands there as its base has it, in a comment; what is uncommented is changed.
    """
    from ..lab import design as write
    from .output import echo_written

    echo_written(write(name, base, out), f"cad check --design {name}", as_json)


@cad.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Parts that can be exported, with group, material, process and quantity."""
    from ..cad.registry import listed
    from .output import echo_json, echo_table

    columns = ("part", "group", "material", "process", "quantity")
    rows = [(p.name, p.group, p.material, p.process, p.quantity) for p in listed()]
    if as_json:
        echo_json([dict(zip(columns, row, strict=True)) for row in rows])
        return
    echo_table(columns, rows)
    click.echo("\nAny indenter is a part too: sphere:DIAMETER_MM, star:SIZE_MM and so on.")


@cad.command()
@click.argument("part")
@of_design
@JSON
def show(part: str, design: str, changes: tuple[str, ...], as_json: bool) -> None:
    """Dimensions of PART with meaning and limits, what follows from them, and its inequalities."""
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
@click.option("--cache/--no-cache", default=True, show_default=True, help="Reuse earlier rows.")
@JSON
def check(design: str, changes: tuple[str, ...], cache: bool, as_json: bool) -> None:
    """Check the whole design on its solids: one table, pass or fail; exit 1 when one fails."""
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
    failed = [row for row in rows if not row.passed]
    if failed:
        named = ", ".join(dict.fromkeys(f"{row.check} ({row.part})" for row in failed))
        raise RunFailed(f"{design}: {len(failed)} of {len(rows)} checks failed: {named}")


@cad.command()
@click.argument("parts", nargs=-1, metavar="[PART]...")
@of_design
@click.option(
    "--format",
    "formats",
    default="step,stl,3mf,dxf,glb,svg,pdf",
    show_default=True,
    help="Formats, by commas; each is written where it makes sense.",
)
@click.option(
    "--tolerance",
    "tolerance_mm",
    type=float,
    default=0.01,
    show_default=True,
    help="Largest distance in mm of a mesh from the surface.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("cad-out"),
    show_default=True,
    help="Folder to write.",
)
@click.option("--cache/--no-cache", default=True, show_default=True, help="Reuse earlier exports.")
@JSON
def export(
    parts: tuple[str, ...],
    design: str,
    changes: tuple[str, ...],
    formats: str,
    tolerance_mm: float,
    out: Path,
    cache: bool,
    as_json: bool,
) -> None:
    """Write each PART and the assembly, with a manifest.json; without PART, everything.

    A PART is a name of `cad list`, a group (sensor, electronics, tools, bench, indenters), or an
    indenter as a protocol names it: sphere:10, 4dots. The assembly and its wiring are written with
    the whole sensor. STEP for the machine shop, STL or 3MF for the printer, DXF for the laser, GLB
    to look at, drawings as PDF and SVG.
    Unchanged files of an earlier export that are not written again are removed; others stay.
    """
    from dataclasses import asdict

    from ..cad.export import export_parts
    from ..cad.registry import select
    from .output import echo_json, echo_table, progress

    dims, chosen = load(design, changes), select(parts)
    with progress("cad export") as tell:
        files = export_parts(
            dims, chosen, formats.split(","), tolerance_mm, out, tell, cached=cache
        )
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


@cad.command()
@of_design
@click.option("--sensors", type=int, default=1, show_default=True, help="Sensors to make.")
@click.option(
    "--format",
    "kind",
    type=click.Choice(("table", "csv", "json")),
    default="table",
    show_default=True,
    help="How to print it.",
)
@click.option(
    "-o", "out", type=click.Path(path_type=Path), help="File to write instead of printing."
)
def bom(design: str, changes: tuple[str, ...], sensors: int, kind: str, out: Path | None) -> None:
    """Bill of materials: parts, silicone, screws, electronics, for a number of sensors."""
    import json
    from dataclasses import asdict

    from ..cad.fabrication.bom import csv_text, lines
    from ..record import write_whole
    from .output import echo_table

    listed = lines(load(design, changes), sensors)
    text = csv_text(listed) if kind == "csv" else None
    if kind == "json":
        text = json.dumps([asdict(line) for line in listed], indent=1) + "\n"
    if out is not None:
        with file_to_write(out):
            write_whole(out, (text if text is not None else csv_text(listed)).encode())
        click.echo(str(out))
    elif text is not None:
        click.echo(text, nl=False)
    else:
        columns = ("item", "part", "material", "process", "quantity", "unit", "note")
        echo_table(columns, [tuple(asdict(line)[c] for c in columns) for line in listed])


@cad.command()
@click.argument("readings", type=click.Path(path_type=Path))
@click.option("--design", default="deltact", show_default=True, help="Design: a path or a name.")
@click.option(
    "-o",
    "out",
    type=click.Path(path_type=Path),
    help="Design to write: --design with what was read.",
)
@JSON
def fit(readings: Path, design: str, out: Path | None, as_json: bool) -> None:
    """What printer and laser do, from READINGS of the coupons, a CSV file, beside what was assumed.

    Columns: coupon (fit-coupon, kerf-coupon), feature (hole, slot, outside, height; strip,
    thickness), nominal_mm, measured_mm, and pieces for strips measured side by side. A spread is
    that of one further piece at 95 %.
    """
    import math
    from dataclasses import asdict

    from ..cad.design import load_design
    from ..cad.fabrication.readings import as_design, estimates, read
    from ..record import write_whole
    from .output import echo_json, echo_table

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
        click.echo(str(out))


@cad.command()
@of_design
@click.option("--sensors", type=int, default=1, show_default=True, help="Sensors to make.")
@click.option(
    "-o",
    "out",
    type=click.Path(path_type=Path),
    default=Path("guide.html"),
    show_default=True,
    help="Page to write.",
)
def guide(design: str, changes: tuple[str, ...], sensors: int, out: Path) -> None:
    """Fabrication guide as one offline page, from the same parts: print, cast, wire, assemble."""
    from ..report.guide import write
    from .output import progress

    dims = load(design, changes)
    with file_to_write(out), progress("cad guide") as tell:
        click.echo(str(write(dims, out, sensors, tell)))
