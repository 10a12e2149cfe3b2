"""`deltact-fab pattern`: list recipes, make a sticker's file, show what a file was made from."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def pattern() -> None:
    """Pattern stickers: list, make, show."""


JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@pattern.command("list")
@JSON
def list_(as_json: bool) -> None:
    """Recipes that can be named: local ones and shipped ones."""
    from .. import catalog
    from ..patterns import load_recipe
    from .output import echo_json, echo_table

    names = catalog.names("patterns")
    if as_json:
        echo_json(names)
        return
    recipes = [(name, load_recipe(name)) for name in names]
    echo_table(
        ("recipe", "law", "d_mm", "r", "dots"),
        [
            (name, r.law, r.patch_mm, r.r, r.dots and f"{r.dots.columns} x {r.dots.rows}")
            for name, r in recipes
        ],
    )


@pattern.command()
@click.argument("recipe", required=False)
@click.option("-d", "patch_mm", type=float, help="Patch size in mm, instead of a RECIPE.")
@click.option("-r", "factor", type=float, help="Randomness factor, 0 <= r < 1; goes with -d.")
@click.option("--size", "size_mm", type=float, help="Side of the sticker in mm.  [default: 35]")
@click.option("--seed", type=int, help="Seed of the draw.  [default: the recipe's, or 7]")
@click.option("--dots", "with_dots", is_flag=True, help="Add the 13 x 13 white marker dots.")
@click.option("--dpi", type=float, help="Printer's resolution.  [default: 1200 with dots]")
@click.option(
    "-o", "out", required=True, type=click.Path(path_type=Path), help="PNG file to write."
)
@JSON
def make(
    recipe: str | None,
    patch_mm: float | None,
    factor: float | None,
    size_mm: float | None,
    seed: int | None,
    with_dots: bool,
    dpi: float | None,
    out: Path,
    as_json: bool,
) -> None:
    """Make a sticker's PNG from a RECIPE (a path or a name), or from -d and -r.

    One image pixel is one patch, unless --dpi or dots ask for printer dots. The centres of the
    dots are written beside it, as NAME.dots.csv.
    """
    from ..patterns import make as make_file
    from ..patterns import recipe_from_options
    from .output import echo_json

    chosen = recipe_from_options(recipe, patch_mm, factor, size_mm, seed, with_dots)
    made = make_file(chosen, out, dpi)
    if as_json:
        echo_json(made.as_dict())
        return
    for line in made.lines():
        click.echo(line)


@pattern.command()
@click.argument("file", type=click.Path(path_type=Path))
@JSON
def show(file: Path, as_json: bool) -> None:
    """Print the recipe that a pattern's PNG carries."""
    from ..patterns import read_recipe
    from .output import echo_json, echo_table

    recipe = read_recipe(file)
    data = recipe.model_dump(exclude_none=True)
    if as_json:
        echo_json(data)
        return
    rows = [(key, value) for key, value in data.items() if key != "dots"]
    rows += [("n", recipe.n), ("printed_mm", recipe.printed_mm)]
    rows += [(f"dots.{key}", value) for key, value in data.get("dots", {}).items()]
    echo_table(("key", "value"), rows)
