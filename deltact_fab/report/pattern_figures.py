"""Charts of a pattern series: what there is to track, against d, a line a value of r."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from . import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = "osD^vP*"
COARSE_LEVELS = (3, 4)

Pick = Callable[[dict[str, Any]], float]


def gradient_by_patch(rows: Sequence[dict[str, Any]]) -> Figure:
    """Mean intensity gradient as designed and as photographed; each panel has its own scale."""
    return _panels(
        rows,
        (
            ("as designed", lambda q: float(q["designed"]["mean_gradient"])),
            ("as the camera sees it", lambda q: float(q["photographed"]["mean_gradient"])),
        ),
        "mean gradient, grey levels/px",
        share_y=False,
    )


def coarse_contrast_by_patch(rows: Sequence[dict[str, Any]]) -> Figure:
    """Contrast at pyramid levels 3 and 4 as photographed."""

    def at(level: int) -> Pick:
        return lambda q: float(q["photographed"]["contrast"][level])

    return _panels(
        rows,
        [(f"level {level}, as the camera sees it", at(level)) for level in COARSE_LEVELS],
        "contrast, grey levels",
        share_y=True,
    )


def _panels(
    rows: Sequence[dict[str, Any]],
    panels: Sequence[tuple[str, Pick]],
    y_label: str,
    share_y: bool,
) -> Figure:
    """rows: `patterns` of a series' quality.json; pick: the figure to draw, from `quality`."""
    figure, axes = figures.blank(6.8, 3.5, len(panels), share_y)
    factors = sorted({row["r"] for row in rows})
    sizes_mm = sorted({row["d_mm"] for row in rows})
    for axis, (title, pick) in zip(axes, panels, strict=True):
        for k, r in enumerate(factors):
            part = sorted((row for row in rows if row["r"] == r), key=lambda row: row["d_mm"])
            axis.plot(
                [row["d_mm"] for row in part],
                [pick(row["quality"]) for row in part],
                color=figures.COLOURS[k % len(figures.COLOURS)],
                marker=MARKERS[k % len(MARKERS)],
                ms=5,
                lw=1.4,
                label=f"r = {r:g}",
            )
        axis.set_title(title, loc="left", fontweight="bold", fontsize=9.5)
        axis.set_xticks(sizes_mm, [f"{d_mm:g}" for d_mm in sizes_mm], fontsize=8)
        axis.set_xlabel("patch size d, mm")
        axis.set_ylim(bottom=0)
    axes[0].set_ylabel(y_label)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=7, fontsize=8.5
    )
    return figure
