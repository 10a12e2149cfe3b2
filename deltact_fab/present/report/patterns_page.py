"""Offline HTML page of a pattern series: views, figures, and the paper's errors."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from deltact_fab.common import Check, graded, html_table, write_page
from deltact_fab.fabricate import PatternSeries

from . import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_patterns_page(folder: Path) -> Path:
    """Write patterns.html into the folder of a series, from its quality.json and views.

    Raises InputError for a folder without a series, MissingLibrary without the extra `report`,
    RunFailed if the disk refuses.
    """
    series = PatternSeries.load(folder)
    data = series.figures
    rows = data["patterns"]
    visible = [row for row in rows if row["quality"]["seen"]]
    models = (("printer", data["printer"]), ("camera", data["sensor"]))
    settings = [
        (f"{part} {key}", str(value)) for part, values in models for key, value in values.items()
    ]
    return write_page(
        series.page,
        "patterns.html",
        [_best_check(rows, visible)],
        s=data,
        rows=rows,
        chart=figures.to_svg(plot_predictors(rows)),
        sizes_mm=sorted({row["d_mm"] for row in rows}),
        factors=sorted({row["r"] for row in rows}),
        views={(row["d_mm"], row["r"]): _view(series, row["name"]) for row in rows},
        rounds=series.grids,
        chosen=min(
            (row for row in rows if row["paper_error_mm"] is not None),
            key=lambda row: row["paper_error_mm"],
            default=None,
        ),
        figures=html_table(pd.DataFrame([_row(row) for row in rows])),
        settings=html_table(pd.DataFrame(settings, columns=["assumed", "value"]), keys="assumed"),
    )


def _best_check(rows: list[dict[str, Any]], visible: list[dict[str, Any]]) -> Check:
    """Verdict: patterns with most texture; unseen ones have only halftone and noise."""
    if not visible:
        text = f"The camera resolves 0 of {len(rows)} patterns: none can be tracked."
        return Check("patterns", value=text, status="fail")
    small = max(visible, key=lambda row: _photographed(row)["mean_gradient"])
    large = max(visible, key=lambda row: sum(_photographed(row)["contrast"][3:5]))
    return Check(
        "patterns",
        value=f"The camera resolves {len(visible)} of {len(rows)} patterns; most texture for small "
        f"motion: d {small['d_mm']}, r {small['r']}; for large motion: d {large['d_mm']}, "
        f"r {large['r']}.",
        status=graded(True, warns=len(visible) < len(rows)),
    )


def _view(series: PatternSeries, name: str) -> str:
    """View of a pattern, as a data URL."""
    return "data:image/png;base64," + base64.b64encode(series.view(name)).decode()


def _photographed(row: dict[str, Any]) -> dict[str, Any]:
    return dict(row["quality"]["photographed"])


def _row(row: dict[str, Any]) -> dict[str, Any]:
    """Row of figures that predict tracking, as photographed; quality.csv has all."""
    figures_seen, quality = _photographed(row), row["quality"]
    paper = row["paper_error_mm"]
    return {
        "d_mm": row["d_mm"],
        "r": row["r"],
        "the paper's error, mm": f"{'≈ ' * row['paper_about']}{paper or ''}",
        "gradient, levels/px": round(figures_seen["mean_gradient"], 1),
        "contrast at level 3": round(figures_seen["contrast"][3], 1),
        "contrast at level 4": round(figures_seen["contrast"][4], 1),
        "second peak": round(figures_seen["peak"], 2),
        "at, mm": figures_seen["peak_mm"] and round(figures_seen["peak_mm"], 2),
        "camera px per patch": round(quality["px_a_patch"], 2),
        "contrast left on the print, %": round(100 * quality["print_contrast"]),
        "contrast left in the camera, %": round(100 * quality["camera_contrast"]),
        "lost": "" if quality["seen"] else "not seen",
    }


def plot_predictors(rows: Sequence[dict[str, Any]]) -> Figure:
    """Plot mean gradient and contrast at pyramid levels 3 and 4, as photographed, by patch."""
    panels = {
        "mean gradient, grey levels/px": [_photographed(row)["mean_gradient"] for row in rows],
        "contrast at level 3, grey levels": [_photographed(row)["contrast"][3] for row in rows],
        "contrast at level 4, grey levels": [_photographed(row)["contrast"][4] for row in rows],
    }
    figure, axes = figures.create_figure(9.6, 3.5, len(panels), share_y=False)
    sizes_mm = sorted({row["d_mm"] for row in rows})
    for axis, (title, values) in zip(axes, panels.items(), strict=True):
        for k, r in enumerate(sorted({row["r"] for row in rows})):
            part = [(row["d_mm"], v) for row, v in zip(rows, values, strict=True) if row["r"] == r]
            axis.plot(
                *zip(*sorted(part), strict=True),
                color=figures.SERIES_COLOURS[k % len(figures.SERIES_COLOURS)],
                marker=figures.SERIES_MARKERS[k % len(figures.SERIES_MARKERS)],
                ms=5, lw=1.4, label=f"r = {r:g}",
            )  # fmt: skip
        axis.set_title(title, loc="left", fontweight="bold", fontsize=9.5)
        axis.set_xticks(sizes_mm, [f"{d_mm:g}" for d_mm in sizes_mm], rotation=90)
        axis.set_xlabel("patch size d, mm")
        axis.set_ylim(bottom=0)
    figures.draw_legend(figure, axes[0])
    return figure
