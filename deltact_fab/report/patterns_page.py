"""One offline HTML page of a pattern series: what each looks like, its figures, the paper's."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import reading
from ..errors import InputError
from ..patterns.series import job as series
from . import figures
from .templating import environment, render, require_pages, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def ready() -> Callable[[Path], Path]:
    """`write`, once it is known that its libraries are there: before a series is made, not after.

    Raises MissingLibrary without the extra `report`.
    """
    require_pages()
    return write


def write(folder: Path) -> Path:
    """Write patterns.html into the folder of a series, from its quality.json and contact sheet.

    Raises InputError for a folder that holds no series, MissingLibrary without the extra `report`,
    RunFailed when the disk refuses.
    """

    pages = environment(num=_number)
    data, picture = _read(folder)
    rows = data["patterns"]
    seen = [row for row in rows if row["quality"]["seen"]]
    charts = [figures.to_svg(draw(rows)) for draw in (gradient_by_patch, coarse_contrast_by_patch)]
    width_px, height_px = _size_px(picture)
    page = render(
        pages,
        "patterns.html",
        s=data,
        rows=rows,
        charts=charts,
        contact="data:image/png;base64," + base64.b64encode(picture).decode(),
        # Half size: a camera pixel is two of the sheet's, and one of the screen's
        contact_px=(width_px // 2, height_px // 2),
        rounds=series.GRIDS,
        field_mm=rows[0]["quality"]["field_mm"],
        seen=seen,
        # What the camera does not see has the gradient of halftone and noise, not its own.
        most_gradient=max(seen or rows, key=lambda row: _seen(row)["mean_gradient"]),
        most_coarse=max(seen or rows, key=lambda row: sum(_coarse(row))),
        chosen=min(
            (row for row in rows if row["paper_error_mm"] is not None),
            key=lambda row: row["paper_error_mm"],
            default=None,
        ),
        coarse=_coarse,
    )
    return save(page, folder / series.PAGE)


def _read(folder: Path) -> tuple[dict[str, Any], bytes]:
    """Figures and contact sheet of a series."""
    try:
        (folder / series.FIGURES).stat()
        picture = (folder / series.CONTACT).read_bytes()
    except FileNotFoundError as why:
        raise InputError(
            f"{folder}: no series: {Path(why.filename).name} is missing; name a folder that "
            "`pattern series` wrote"
        ) from why
    except OSError as why:
        raise InputError(f"{why.filename}: cannot be read: {why.strerror}") from why
    data = reading.json_object(folder / series.FIGURES)
    found = data.get("format")
    if found != series.FORMAT:
        raise InputError(
            f"{folder / series.FIGURES}: format {found!r}; this version reads {series.FORMAT!r}"
        )
    return data, picture


def _size_px(picture: bytes) -> tuple[int, int]:
    """Width and height of a PNG, from its first chunk (ISO/IEC 15948, 11.2.2)."""
    return int.from_bytes(picture[16:20], "big"), int.from_bytes(picture[20:24], "big")


def _seen(row: dict[str, Any]) -> dict[str, Any]:
    return dict(row["quality"]["photographed"])


def _coarse(row: dict[str, Any]) -> tuple[float, float]:
    """Contrast at pyramid levels 3 and 4 as photographed."""
    levels = _seen(row)["contrast"]
    return levels[3], levels[4]


def _number(value: Any, digits: int = 1, factor: float = 1.0) -> str:
    """Fixed digits; a dash where there is none; three channels as their mean."""
    if value is None:
        return "–"
    if isinstance(value, list):
        value = sum(value) / len(value)
    return f"{value * factor:.{digits}f}"


MARKERS = "osD^vP*"
COARSE_LEVELS = (3, 4)


def gradient_by_patch(rows: Sequence[dict[str, Any]]) -> Figure:
    """Mean intensity gradient as designed and as photographed; each panel has its own scale."""
    panels = {
        "as designed": [row["quality"]["designed"]["mean_gradient"] for row in rows],
        "as the camera sees it": [_seen(row)["mean_gradient"] for row in rows],
    }
    return _panels(rows, panels, "mean gradient, grey levels/px", share_y=False)


def coarse_contrast_by_patch(rows: Sequence[dict[str, Any]]) -> Figure:
    """Contrast at pyramid levels 3 and 4 as photographed."""
    panels = {
        f"level {level}, as the camera sees it": [_seen(row)["contrast"][level] for row in rows]
        for level in COARSE_LEVELS
    }
    return _panels(rows, panels, "contrast, grey levels", share_y=True)


def _panels(
    rows: Sequence[dict[str, Any]], panels: dict[str, list[float]], y_label: str, share_y: bool
) -> Figure:
    """Panels of a figure a row, by their titles, against the patch size."""
    figure, axes = figures.blank(6.8, 3.5, len(panels), share_y)
    factors = sorted({row["r"] for row in rows})
    sizes_mm = sorted({row["d_mm"] for row in rows})
    for axis, (title, values) in zip(axes, panels.items(), strict=True):
        for k, r in enumerate(factors):
            part = [(row["d_mm"], v) for row, v in zip(rows, values, strict=True) if row["r"] == r]
            axis.plot(
                *zip(*sorted(part), strict=True), color=figures.COLOURS[k % len(figures.COLOURS)],
                marker=MARKERS[k % len(MARKERS)], ms=5, lw=1.4, label=f"r = {r:g}",
            )  # fmt: skip
        axis.set_title(title, loc="left", fontweight="bold", fontsize=9.5)
        axis.set_xticks(sizes_mm, [f"{d_mm:g}" for d_mm in sizes_mm], fontsize=8)
        axis.set_xlabel("patch size d, mm")
        axis.set_ylim(bottom=0)
    axes[0].set_ylabel(y_label)
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower left", ncols=7, fontsize=8.5)
    return figure
