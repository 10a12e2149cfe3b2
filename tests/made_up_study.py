"""A small study that nobody ran: what the pages are tried on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from deltact_fab.common.aliases import Note
from deltact_fab.present.report import figures
from deltact_fab.present.report.result import Headline, ReportFigure, ReportTable, StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = 12


def bars() -> Figure:
    """A figure with a title that is wider than a column of a paper."""
    figure, (axis,) = figures.create_figure(9.6, 4.2)
    for i, colour in enumerate(figures.SERIES_COLOURS[:3]):
        axis.bar(np.arange(4) + 0.25 * i, [1 + i, 2, 3, 1], 0.22, color=colour, label=f"tool {i}")
    axis.set_title("A title that goes on and on until no column of any paper holds it any more, "
                   "and then some words", loc="left")  # fmt: skip
    axis.set_xticks(range(4), ["sphere:10", "4dots", "star", "hexprism"])
    axis.set_ylabel("mean error, mm")
    figures.draw_legend(figure, axis)
    return figure


def picture() -> Figure:
    """A raster between axes."""
    figure, (axis,) = figures.create_figure(4.8, 3.6)
    axis.imshow(np.arange(600).reshape(20, 30) % 37, extent=(-15, 15, -10, 10))
    axis.set_xlabel("x, mm")
    axis.set_ylabel("y, mm")
    return figure


def wide() -> pd.DataFrame:
    """Twelve columns of numbers and words, long names."""
    rng = np.random.default_rng(1)
    found: dict[str, object] = {"indenter": ["sphere:10", "4\tdots", "a </textarea> b", "star"]}
    for i in range(COLUMNS - 2):
        found[f"rmse_left_out_position_{i}_n"] = rng.normal(size=4)
    found["solved"] = [True, False, True, True]
    return pd.DataFrame(found)


def study(missing: int = 0) -> StudyResult:
    """All that a page can hold, with some jobs missing."""
    table = wide()
    long = pd.DataFrame({"point": range(2070), "normal_n": np.linspace(0, 9.67, 2070)})
    return StudyResult(
        study="made-up",
        title="A made-up study",
        answer=("The better one is half as far off.", "It holds for <all> seeds."),
        extra={"half": 0.5},
        simulated=True,
        seed=7,
        scale=0.1,
        headlines=(
            Headline("mean error of the default tracker", 0.0123456, "mm", 0.011, 0.014, "5 seeds",
                     paper=0.08, goal=0.03),
            Headline("normal force off by (RMSE), a position left out", 0.31, "N", 0.15, 0.4,
                     "9 positions", paper=0.30, goal=0.2, remark="the edge of the gel is softer",
                     groups=9, noun="position", unit_cpu_s=6.6),
            Headline("adjusted R2", 0.991, "", None, None, "one fit", 0.99, 0.98, better="high"),
        ),
        tables=(
            ReportTable("wide", "Twelve columns", table),
            ReportTable("points", "Every point", long.assign(nothing=np.nan)),
        ),
        figures=(
            ReportFigure("bars", "Bars of three tools.", bars),
            ReportFigure("picture", "A field.", picture, column=True),
            ReportFigure("again", "The same once more.", bars, column=True),
        ),
        settings={"friction": "1.0", "noise": "2 grey values"},
        notes=("The modulus is uncertain by a factor of 2.",),
        left_out=(
            Note("viscosity", "the specimen has no Prony series"),
            Note("solid models", "numbers suffice"),
        ),
        missing=tuple(f"d0.1-r{i}" for i in range(missing)),
        files={"recipe.toml": "seed = 7\n"},
    )  # fmt: skip
