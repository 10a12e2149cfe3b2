"""One offline HTML page of the engines: error against CPU time, stability, cost of layers."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import figures
from .templating import environment, render, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = "osD^vP*"


def write(data: dict[str, Any], out: Path) -> Path:
    """Write the page of `Numerics.as_dict()` to one self-contained file.

    Raises MissingLibrary without the extra `report`, RunFailed when the disk refuses.
    """
    pages = environment(num=_number)
    drawn = []
    for engine in data["engines"]:
        rows = [r for r in data["curves"] if r["engine"] == engine["name"]]
        panels = [
            figures.to_svg(error_against_time([r for r in rows if r["case"] == case]))
            for case in dict.fromkeys(r["case"] for r in rows)
        ]
        cases = [r for r in data["stability"] if r["engine"] == engine["name"]]
        drawn.append(
            {
                **engine,
                "panels": panels,
                "curves": rows,
                "stability": cases,
                "counts": {
                    name: sum(r["outcome"] == name for r in cases)
                    for name in ("right", "refused", "wrong")
                },
            }
        )
    page = render(
        pages,
        "numerics.html",
        engines=drawn,
        scenes=[row for row in data["scenes"] if row["seconds"] is not None],
        meta=data["meta"],
        cases=len(data["stability"]),
        wrong=[r["case"] for r in data["stability"] if r["outcome"] == "wrong"],
    )
    return save(page, out)


def error_against_time(rows: Sequence[dict[str, Any]]) -> Figure:
    """One case: error against CPU time, both logarithmic, a line a series, the front ringed.

    A mark is at the best time, its bar ends at the slowest.
    """
    figure, (axis,) = figures.blank(5.0, 4.4)
    known = [r for r in rows if r["error"] is not None and r["error"] > 0]
    series = list(dict.fromkeys(r["series"] for r in rows))
    for i, name in enumerate(series):
        part = sorted((r for r in known if r["series"] == name), key=lambda r: r["cpu_s"])
        axis.plot(
            [r["cpu_s"] * 1e3 for r in part],
            [r["error"] for r in part],
            marker=MARKERS[i % len(MARKERS)],
            color=figures.COLOURS[i % len(figures.COLOURS)],
            ms=6,
            lw=1.0,
            ls="-" if _is_ladder(part) else "none",
            label=name,
        )
        axis.hlines(
            [r["error"] for r in part],
            [r["cpu_s"] * 1e3 for r in part],
            [r["cpu_most_s"] * 1e3 for r in part],
            color=figures.COLOURS[i % len(figures.COLOURS)],
            lw=2.5,
            alpha=0.45,
        )
    front = sorted((r for r in known if r["pareto"]), key=lambda r: r["cpu_s"])
    axis.plot(
        [r["cpu_s"] * 1e3 for r in front],
        [r["error"] for r in front],
        color=figures.SOFT,
        lw=0.9,
        ls=":",
        marker="o",
        ms=12,
        mfc="none",
        mew=1.1,
        label="Pareto front",
        zorder=1,
    )
    figures.log_ticks(axis, "xy")
    _widen(
        axis,
        [r[k] * 1e3 for r in known for k in ("cpu_s", "cpu_most_s")],
        [r["error"] for r in known],
    )
    _label(axis, known, series)
    axis.set_xlabel("CPU time, milliseconds: best of the runs, bar to the slowest")
    axis.set_ylabel(f"error, {rows[0]['unit']}")
    title = textwrap.fill(rows[0]["case"], 52)
    axis.set_title(title, loc="left", fontweight="bold", fontsize=9.5)
    figure.legend(loc="outside lower left", fontsize="small", ncols=2)
    return figure


def _is_ladder(part: Sequence[dict[str, Any]]) -> bool:
    """Names with a number in them are steps of one knob and are joined; methods are not."""
    return all(any(c.isdigit() for c in r["setting"]) for r in part)


def _label(axis: Axes, rows: Sequence[dict[str, Any]], series: Sequence[str]) -> None:
    """Name the points where there is room: a name that would cover another is left to the table."""
    width, height = 310.0, 225.0  # of the axes in points, about
    (x0, x1), (y0, y1) = axis.get_xlim(), axis.get_ylim()
    taken: list[tuple[float, float, float, float]] = []

    def place(seconds: float, error: float) -> tuple[float, float]:
        x = width * math.log(seconds * 1e3 / x0) / math.log(x1 / x0)
        return x, height * math.log(error / y0) / math.log(y1 / y0)

    marks = [place(r["cpu_s"], r["error"]) for r in rows]
    taken += [(x - 4, y - 4, x + 4, y + 4) for x, y in marks]
    for r, (x, y) in zip(rows, marks, strict=True):
        taken.append((x, y - 1.5, place(r["cpu_most_s"], r["error"])[0], y + 1.5))
    for name in series:
        part = sorted((r for r in rows if r["series"] == name), key=lambda r: r["cpu_s"])
        along = [place(r["cpu_s"], r["error"]) for r in part] if _is_ladder(part) else []
        for (xa, ya), (xb, yb) in itertools.pairwise(along):
            shares = [i / 24 for i in range(1, 24)]
            line = [(xa + s * (xb - xa), ya + s * (yb - ya)) for s in shares]
            taken += [(x - 0.5, y - 0.5, x + 0.5, y + 0.5) for x, y in line]
    for r, (x, y) in zip(rows, marks, strict=True):
        long = 5.0 * len(r["setting"])
        for dx, dy in ((7, 3), (7, -10), (-7 - long, 3), (-7 - long, -10), (-long / 2, 9)):
            box = (x + dx, y + dy, x + dx + long, y + dy + 9.5)
            if box[0] < 0 or any(
                box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken
            ):
                continue
            taken.append(box)
            axis.annotate(
                r["setting"],
                (r["cpu_s"] * 1e3, r["error"]),
                xytext=(dx, dy),
                textcoords="offset points",
                fontsize=figures.MIN_PAGE_PT,
            )
            break


def _widen(axis: Axes, times: Sequence[float], errors: Sequence[float]) -> None:
    """Room for the labels, and at least one tick on each axis."""
    if not times:
        return
    axis.set_xlim(min(times) / 1.6, max(times) * 2.8)
    axis.set_ylim(min(errors) / 1.8, max(errors) * 2.2)


def _number(value: Any) -> str:
    """Four digits at most; nothing where nothing was measured."""
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if isinstance(value, int) or 1e3 <= abs(value) < 1e6:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.3g}" if value == 0 or 1e-3 <= abs(value) < 1e3 else f"{value:.1e}"
