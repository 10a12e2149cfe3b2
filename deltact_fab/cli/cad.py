"""`deltact-fab cad`: list the parts, write them as STEP and STL."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def cad() -> None:
    """Parametric parts: list and export."""


JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@cad.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Parts that can be exported, with material, process and quantity."""
    from ..cad.registry import listed
    from .output import echo_json, echo_table

    columns = ("part", "material", "process", "quantity", "default")
    rows = [(p.name, p.material, p.process, p.quantity, p.default) for p in listed()]
    if as_json:
        echo_json([dict(zip(columns, row, strict=True)) for row in rows])
        return
    echo_table(columns, [(*row[:4], "yes" if row[4] else "no") for row in rows])
    click.echo("\nAny indenter is a part too: sphere:DIAMETER_MM, star:SIZE_MM and so on.")


@cad.command()
@click.argument("parts", nargs=-1, metavar="[PART]...")
@click.option("--design", default="deltact", show_default=True, help="Design: a path or a name.")
@click.option(
    "--format", "formats", default="step,stl", show_default=True, help="Formats, by commas."
)
@click.option(
    "--tolerance",
    "tolerance_mm",
    type=float,
    default=0.01,
    show_default=True,
    help="Largest distance in mm of an STL from the surface.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("cad-out"),
    show_default=True,
    help="Folder to write.",
)
@JSON
def export(
    parts: tuple[str, ...],
    design: str,
    formats: str,
    tolerance_mm: float,
    out: Path,
    as_json: bool,
) -> None:
    """Write each PART as STEP and STL, with a manifest.json; without PART, the default ones.

    A PART is a name of `cad list`, or an indenter as a protocol names it: sphere:10, 4dots.
    """
    from dataclasses import asdict

    from ..cad.design import load_design
    from ..cad.export import export_parts
    from ..cad.registry import select
    from .output import echo_json, echo_table, progress

    dims, chosen = load_design(design), select(parts)
    with progress("cad export") as tell:
        files = export_parts(dims, chosen, formats.split(","), tolerance_mm, out, tell)
    if as_json:
        echo_json([asdict(f) for f in files])
        return
    echo_table(
        ("file", "volume_mm3", "mesh_deviation_mm", "process"),
        [(str(out / f.file), f.volume_mm3, f.mesh_deviation_mm, f.process) for f in files],
    )
