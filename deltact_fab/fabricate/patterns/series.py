"""The paper's pattern series in one folder: recipes, print job, contact sheet, figures.

DIR/
  recipes/d0p075-r0p6.toml ...   a RECIPE for every command
  series.pdf                     one sticker per pattern
  views/d0p075-r0p6.png ...      the middle of each in the camera's pixels, simulated
  quality.csv  quality.json      every figure, as designed and as photographed
  patterns.html                  optional page
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
from .quality.measure import STANDARD_MM_PER_PX, driver_image, measure_quality, photograph
from .recipe import DEFAULT_SEED, PatternRecipe
from .sheet import job as sheet

SERIES_GRIDS = (((0.1, 0.15, 0.2), (0.1, 0.3, 0.5)), ((0.05, 0.075, 0.1), (0.4, 0.5, 0.6)))
"""(d in mm, r) of the two rounds of the paper's Pattern Selection.

The second is printed as d in {0.5, 0.75, 0.1}, read as 0.05 and 0.075: the text that follows names
d = 0.075 as the best of that round and d = 0.05 as too small, both "near" the first round's 0.1.
"""

PAPER_ERROR_MM = {(0.1, 0.5): 0.11, (0.075, 0.6): 0.08}
"""Mean tracking error at the dots by (d, r), best of each round, real sensor (paper)."""
PAPER_ABOUT_MM = {0.05: 0.5}
"""By d, for any r: "around 0.5 mm" (paper). The others are only in a chart there."""

SERIES_VIEW_MM = 6.0  # by hand: patches are visible, files stay small
SERIES_FORMAT = "deltact-fab pattern series 3"
SERIES_RECIPES = "recipes"
SERIES_PDF = "series.pdf"
SERIES_VIEWS = "views"
SERIES_FIGURES = "quality.json"
SERIES_TABLE = "quality.csv"
SERIES_PAGE = "patterns.html"


@dataclass(frozen=True)
class SeriesEntry:
    """One pattern. rounds: rounds of the paper that contain it (1, 2).

    paper_error_mm: error in the paper on a real sensor, None if not given; paper_about: given as
    "around" for all patterns of this d.
    """

    name: str
    recipe: PatternRecipe
    rounds: tuple[int, ...] = ()
    paper_error_mm: float | None = None
    paper_about: bool = False

    @property
    def label(self) -> str:
        """Short text, `d 0.075 r 0.6`; the name for other laws than Algorithm 1."""
        recipe = self.recipe
        return f"d {recipe.patch_mm:g} r {recipe.r:g}" if recipe.law == "algorithm1" else self.name

    @property
    def paper_text(self) -> str:
        """The paper's error as text, empty if not given."""
        error_mm = self.paper_error_mm
        return "" if error_mm is None else f"{'about ' * self.paper_about}{error_mm:g} mm"


@dataclass(frozen=True)
class SeriesReport:
    """Result of `write_series`; figures: contents of quality.json."""

    out: Path
    files: tuple[Path, ...]
    pages: int
    figures: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `pattern series --json` prints it."""
        return {**self.figures, "out": str(self.out), "files": [str(f) for f in self.files]}


@dataclass(frozen=True)
class PatternSeries:
    """A series in its folder; figures: contents of quality.json."""

    folder: Path
    figures: dict[str, Any]
    grids: ClassVar = SERIES_GRIDS

    @classmethod
    def load(cls, folder: Path) -> PatternSeries:
        """Load the series of a folder. Raises InputError if there is none."""
        path = folder / SERIES_FIGURES
        if not isfile(path):
            hint = "give a folder written by `pattern series`"
            raise InputError(f"{folder}: no series: {path.name} is missing; {hint}")
        data = read_json(path)
        if (form := data.get("format")) != SERIES_FORMAT:
            raise InputError(f"{path}: format {form!r}; this version reads {SERIES_FORMAT!r}")
        return cls(folder, data)

    @property
    def page(self) -> Path:
        """Path of its page."""
        return self.folder / SERIES_PAGE

    def view(self, name: str) -> bytes:
        """Read the camera image of a pattern, PNG. Raises InputError if it is missing."""
        file = self.folder / SERIES_VIEWS / f"{name}.png"
        if not isfile(file):
            raise InputError(f"{self.folder}: no series: {SERIES_VIEWS}/{file.name} is missing")
        return file.read_bytes()


def list_series(seed: int = DEFAULT_SEED, with_dots: bool = True) -> list[SeriesEntry]:
    """List the 17 patterns of the paper's Pattern Selection by d, then r.

    with_dots: 13 x 13 white dots as in the paper. Raises InputError for an invalid seed.
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
    """Write the series into the new folder `out`, completely or not at all.

    seed: of patterns, printer and camera. dpi: of print job and printer model. entries: other
    Algorithm 1 patterns than the paper's. page: called with the finished folder to add
    `patterns.html`. Equal arguments and versions give equal bytes.

    Raises InputError for a folder that is not empty, a seed below 0 and what `write_sheet`
    refuses, RunFailed for disk errors, and whatever `page` raises.
    """
    chosen = list_series(seed) if entries is None else list(entries)
    printer, sensor = Printer(dpi=dpi), ImageSensor()
    tell = progress or (lambda *_: None)
    total = len(chosen) + 1
    with disk_errors(out, "made"):
        inside = Path.cwd().is_relative_to(out.absolute())
        if out.exists() and (inside or not out.is_dir() or any(out.iterdir())):
            raise InputError(f"{out}: exists already; name a new folder")
        out.parent.mkdir(parents=True, exist_ok=True)
    with disk_errors(out), whole_file(out.absolute()) as folder:
        folder.mkdir()
        _write_recipes(folder / SERIES_RECIPES, chosen)
        tell(0, total, SERIES_PDF)
        # First, because it checks paper, dpi and transfer before the long part.
        job = sheet.write_sheet(
            [e.recipe for e in chosen], folder / SERIES_PDF, paper=paper, dpi=dpi, transfer=transfer
        )
        (folder / SERIES_VIEWS).mkdir()
        rows = []
        for k, entry in enumerate(chosen, 1):
            tell(k, total, entry.name)
            # Dots are the same on every pattern; their contrast would hide its own on coarse levels
            bare = entry.recipe.model_copy(update={"dots": None})
            figures = asdict(measure_quality(bare, printer, sensor, STANDARD_MM_PER_PX, seed))
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
            "mm_per_px": STANDARD_MM_PER_PX,
            "printer": asdict(printer),
            "sensor": asdict(sensor),
            "patterns": rows,
        }
        text = json.dumps(data, indent=1, allow_nan=False) + "\n"
        (folder / SERIES_FIGURES).write_bytes(text.encode())
        (folder / SERIES_TABLE).write_bytes(_csv(rows))
        if page is not None:
            page(folder)
        paths = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    tell(total, total, "done")
    return SeriesReport(out, tuple(out / name for name in paths), job.pages, data)


def _view(recipe: PatternRecipe, printer: Printer, sensor: ImageSensor, seed: int) -> bytes:
    """Simulate the middle of the camera's image of a sticker at rest, as PNG.

    SERIES_VIEW_MM wide at most. seed: of halftone, misregistration and noise.
    """
    from PIL import Image

    from deltact_fab.physics import print_colours

    side_px = 2 * round(min(SERIES_VIEW_MM, recipe.printed_mm) / STANDARD_MM_PER_PX / 2)
    rng = np.random.default_rng([seed, 1])
    values = driver_image(recipe, printer.dpi, (side_px * STANDARD_MM_PER_PX,) * 2)
    printed = print_colours(printer, values.astype(np.float32) / np.float32(255), rng)
    size_px = (side_px, side_px)
    photo = photograph(printed, printer.mm_per_dot, sensor, STANDARD_MM_PER_PX, size_px, rng)
    file = io.BytesIO()
    Image.fromarray(photo).save(file, "PNG")
    return file.getvalue()


def _rounded(value: Any) -> Any:
    """Round every float to nine digits; the last ones depend on the number of threads."""
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(inner) for inner in value]
    return float(f"{value:.9g}") if isinstance(value, float) else value


def _row(entry: SeriesEntry, job: sheet.SheetReport, figures: dict[str, Any]) -> dict[str, Any]:
    """Row of a pattern in quality.json."""
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
        if entry.paper_text:
            about.append(f"Tracking error there, on a real sensor: {entry.paper_text}.")
        path = folder / f"{entry.name}.toml"
        # Every key with a value, so that a later default cannot change the pattern.
        data = entry.recipe.model_dump(mode="json", exclude_none=True)
        path.write_bytes(toml_text(data, about).encode())


def _csv(rows: Sequence[dict[str, Any]]) -> bytes:
    """One row per pattern; a figure's column is its path inside `quality`, joined by dots."""
    import pandas as pd

    table = pd.json_normalize(
        [{**row, "rounds": " ".join(map(str, row["rounds"]))} for row in rows]
    ).rename(columns=lambda name: name.removeprefix("quality."))
    for key in [key for key in table if isinstance(table[key][0], list)]:
        table = table.join(pd.DataFrame(table.pop(str(key)).tolist()).add_prefix(f"{key}."))
    return bytes(table.to_csv(index=False, lineterminator="\n").encode())
