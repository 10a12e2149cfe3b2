"""The paper's pattern series as one folder: recipes, one print job, contact sheet, figures.

DIR/
  recipes/d0p075-r0p6.toml ...   what every command takes as a RECIPE
  series.pdf                     one sticker of each
  views/d0p075-r0p6.png ...      the middle of each as the camera would see it, pixel by pixel
  quality.csv  quality.json      every figure, as designed and as seen
  patterns.html                  where a page is asked for
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from os.path import isfile
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from deltact_fab.common import (
    InputError,
    Progress,
    disk_errors,
    read_json,
    toml_text,
    validate,
    whole_file,
)
from deltact_fab.sensor import ImageSensor, Printer
from deltact_fab.version import PACKAGE_VERSION

from .code import encode
from .quality.measure import MM_PER_PX, measure_quality, photograph, sent
from .recipe import DEFAULT_SEED, PatternRecipe
from .sheet import job as sheet

SERIES_GRIDS = (
    ((0.1, 0.15, 0.2), (0.1, 0.3, 0.5)),
    ((0.05, 0.075, 0.1), (0.4, 0.5, 0.6)),
)
"""(d in mm, r) of the two rounds of the paper's Pattern Selection.

The second is printed as d in {0.5, 0.75, 0.1}. Taken: 0.05 and 0.075, for the text that follows
names d = 0.075 as the best of that round and d = 0.05 as too small, both "near" the first round's
0.1; 0.5 and 0.75 mm would be neither.
"""

PAPER_ERROR_MM = {(0.1, 0.5): 0.11, (0.075, 0.6): 0.08}
"""Mean tracking error at the dots, by (d, r): least of its round. On the authors' real sensor."""
PAPER_ABOUT_MM = {0.05: 0.5}
"""By d, of whichever r: "around 0.5 mm". The paper gives the others as columns of a chart only."""

VIEW_MM = 6.0
SERIES_FORMAT = "deltact-fab pattern series 3"
RECIPES = "recipes"
SHEET = "series.pdf"
SERIES_VIEWS = "views"
SERIES_FIGURES = "quality.json"
TABLE = "quality.csv"
SERIES_PAGE = "patterns.html"


@dataclass(frozen=True)
class SeriesEntry:
    """One pattern. rounds: 1, 2 or both, the rounds of the paper that it stands in, if any.

    paper_error_mm: the paper's, on a real sensor, None where it gives none; paper_about: it is
    said of all patterns of this d, as "around".
    """

    name: str
    recipe: PatternRecipe
    rounds: tuple[int, ...] = ()
    paper_error_mm: float | None = None
    paper_about: bool = False

    @property
    def words(self) -> str:
        """As `d 0.075 r 0.6`; the name of one that is none of Algorithm 1."""
        recipe = self.recipe
        return f"d {recipe.patch_mm:g} r {recipe.r:g}" if recipe.law == "algorithm1" else self.name

    @property
    def paper_says(self) -> str:
        """The paper's error in words, empty where it gives none."""
        known = self.paper_error_mm
        return "" if known is None else f"{'about ' * self.paper_about}{known:g} mm"


@dataclass(frozen=True)
class SeriesReport:
    """What `write` wrote. figures: the contents of quality.json."""

    out: Path
    files: tuple[Path, ...]
    pages: int
    figures: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `pattern series --json` prints it."""
        return {**self.figures, "out": str(self.out), "files": [str(f) for f in self.files]}


@dataclass(frozen=True)
class PatternSeries:
    """A series in its folder. figures: the contents of quality.json. page: where its page goes."""

    folder: Path
    figures: dict[str, Any]
    grids: ClassVar = SERIES_GRIDS

    @classmethod
    def load(cls, folder: Path) -> PatternSeries:
        """The series of a folder. Raises InputError for a folder that holds none."""
        kept = folder / SERIES_FIGURES
        if not isfile(kept):
            wanted = "name a folder that `pattern series` wrote"
            raise InputError(f"{folder}: no series: {kept.name} is missing; {wanted}")
        data = read_json(kept)
        if (form := data.get("format")) != SERIES_FORMAT:
            raise InputError(f"{kept}: format {form!r}; this version reads {SERIES_FORMAT!r}")
        return cls(folder, data)

    @property
    def page(self) -> Path:
        """File of its page."""
        return self.folder / SERIES_PAGE

    def view(self, name: str) -> bytes:
        """The camera's image of a pattern, as PNG. Raises InputError where it is missing."""
        file = self.folder / SERIES_VIEWS / f"{name}.png"
        if not isfile(file):
            raise InputError(f"{self.folder}: no series: {SERIES_VIEWS}/{file.name} is missing")
        return file.read_bytes()


def list_series(seed: int = DEFAULT_SEED, with_dots: bool = True) -> list[SeriesEntry]:
    """The 17 patterns of the paper's Pattern Selection, by d, then r; (0.1, 0.5) is in both rounds.

    with_dots: 13 x 13 white dots on top, as the paper's. Raises InputError for an unusable seed.
    """
    entries = []
    for d_mm, r in sorted({pair for grid in SERIES_GRIDS for pair in product(*grid)}):
        numbers = (k for k, grid in enumerate(SERIES_GRIDS, 1) if (d_mm, r) in product(*grid))
        data: dict[str, Any] = {"law": "algorithm1", "seed": seed, "patch_mm": d_mm, "r": r}
        if with_dots:
            data["dots"] = {}
        exact = PAPER_ERROR_MM.get((d_mm, r))
        entries.append(
            SeriesEntry(
                name=f"d{d_mm:g}-r{r:g}".replace(".", "p"),
                rounds=tuple(numbers),
                recipe=validate(PatternRecipe, data, "series"),
                paper_error_mm=PAPER_ABOUT_MM.get(d_mm) if exact is None else exact,
                paper_about=exact is None and d_mm in PAPER_ABOUT_MM,
            )
        )
    return entries


def write_series(
    out: Path,
    *,
    seed: int = DEFAULT_SEED,
    dpi: int = 1200,
    paper: str = "A4",
    transfer: sheet.Transfer = "face-down",
    entries: Sequence[SeriesEntry] | None = None,
    page: Callable[[Path], object] | None = None,
    progress: Progress | None = None,
) -> SeriesReport:
    """Write the series into the new folder `out`, which is whole afterwards or not there.

    seed: of every draw, of the printer's and the camera's too. dpi: of the print job and of the
    printer model. entries: other Algorithm 1 patterns than the paper's. page: called with the
    folder when all else is in it, to add `patterns.html`. Equal arguments and versions give equal
    bytes.

    Raises InputError for a folder that is there and not empty, for a seed below 0 and for what
    `sheet.write` refuses, RunFailed when the disk refuses, and whatever `page` raises.
    """
    chosen = list_series(seed) if entries is None else list(entries)
    printer, sensor = Printer(dpi=dpi), ImageSensor()
    tell = progress or (lambda done, total, what: None)
    total = len(chosen) + 1
    with disk_errors(out, "made"):
        inside = Path.cwd().is_relative_to(out.absolute())
        if out.exists() and (inside or not out.is_dir() or any(out.iterdir())):
            raise InputError(f"{out}: is there already; name a new folder")
        out.parent.mkdir(parents=True, exist_ok=True)
    with disk_errors(out), whole_file(out.absolute()) as folder:
        folder.mkdir()
        _write_recipes(folder / RECIPES, chosen)
        tell(0, total, SHEET)
        # First, for it refuses an unusable paper, dpi or transfer before the long part.
        job = sheet.write_sheet(
            [e.recipe for e in chosen], folder / SHEET, paper=paper, dpi=dpi, transfer=transfer
        )
        (folder / SERIES_VIEWS).mkdir()
        rows = []
        for k, entry in enumerate(chosen, 1):
            tell(k, total, entry.name)
            # Dots are the same on every pattern; on coarse levels their contrast would hide its own
            bare = entry.recipe.model_copy(update={"dots": None})
            figures = asdict(measure_quality(bare, printer, sensor, MM_PER_PX, seed))
            rows.append(_row(entry, job, _rounded(figures)))
            view = _view(entry.recipe, printer, sensor, seed)
            (folder / SERIES_VIEWS / f"{entry.name}.png").write_bytes(view)
        data = {
            "format": SERIES_FORMAT,
            "version": PACKAGE_VERSION,
            "seed": seed,
            "dpi": dpi,
            "paper": paper,
            "transfer": transfer,
            "pages": job.pages,
            "mm_per_px": MM_PER_PX,
            "printer": asdict(printer),
            "sensor": asdict(sensor),
            "patterns": rows,
        }
        text = json.dumps(data, indent=1, allow_nan=False) + "\n"
        (folder / SERIES_FIGURES).write_bytes(text.encode())
        (folder / TABLE).write_bytes(_csv(rows))
        if page is not None:
            page(folder)
        written = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    tell(total, total, "done")
    return SeriesReport(out, tuple(out / name for name in written), job.pages, data)


def _view(recipe: PatternRecipe, printer: Printer, sensor: ImageSensor, seed: int) -> bytes:
    """The middle of the camera's image of a sticker at rest, simulated, as PNG.

    VIEW_MM wide, or what the sticker has of it. seed: of halftone, misregistration and noise.
    """
    from PIL import Image

    from deltact_fab.physics import print_colours

    side_px = 2 * round(min(VIEW_MM, recipe.printed_mm) / MM_PER_PX / 2)
    rng = np.random.default_rng([seed, 1])
    values = sent(recipe, printer.dpi, (side_px * MM_PER_PX,) * 2)
    printed = print_colours(printer, values.astype(np.float32) / np.float32(255), rng)
    seen = photograph(printed, printer.mm_per_dot, sensor, MM_PER_PX, (side_px, side_px), rng)
    file = io.BytesIO()
    Image.fromarray(seen).save(file, "PNG")
    return file.getvalue()


def _rounded(value: Any) -> Any:
    """Nine digits of every float: the last ones change with the number of threads."""
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(inner) for inner in value]
    return float(f"{value:.9g}") if isinstance(value, float) else value


def _row(entry: SeriesEntry, job: sheet.SheetReport, figures: dict[str, Any]) -> dict[str, Any]:
    """All that is known of a pattern, as quality.json holds it."""
    recipe = entry.recipe
    code = encode(recipe)
    sticker = next(s for s in job.stickers if s.code == code)
    return {
        "name": entry.name,
        "d_mm": recipe.patch_mm,
        "r": recipe.r,
        "rounds": list(entry.rounds),
        "paper_error_mm": entry.paper_error_mm,
        "paper_about": entry.paper_about,
        "n": recipe.n,
        "printed_mm": recipe.printed_mm,
        "page": sticker.page,
        "print_error_mm": _rounded(sticker.print_error_mm),
        "code": code,
        "quality": figures,
    }


def _write_recipes(folder: Path, entries: Sequence[SeriesEntry]) -> None:
    folder.mkdir()
    for entry in entries:
        rounds = " and ".join(str(k) for k in entry.rounds)
        many = "s" if len(entry.rounds) > 1 else ""
        about = [f"Pattern Selection of the paper, round{many} {rounds}."]
        if entry.paper_says:
            about.append(f"Tracking error there, on a real sensor: {entry.paper_says}.")
        path = folder / f"{entry.name}.toml"
        # Every key that has a value, so that a later default cannot change the pattern.
        data = entry.recipe.model_dump(mode="json", exclude_none=True)
        path.write_bytes(toml_text(data, about).encode())


def _csv(rows: Sequence[dict[str, Any]]) -> bytes:
    """One row a pattern; a figure's column is its path inside `quality`, joined by dots."""
    import pandas as pd

    table = pd.json_normalize(
        [{**row, "rounds": " ".join(map(str, row["rounds"]))} for row in rows]
    ).rename(columns=lambda name: name.removeprefix("quality."))
    for key in [key for key in table if isinstance(table[key][0], list)]:
        table = table.join(pd.DataFrame(table.pop(str(key)).tolist()).add_prefix(f"{key}."))
    return bytes(table.to_csv(index=False, lineterminator="\n").encode())
