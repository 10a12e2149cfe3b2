"""Common style of figures: size, fonts, colours; export to self-contained SVG."""

from __future__ import annotations

import html
import io
import math
import re
import textwrap
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np

from deltact_fab.common import require_extra

from .result import ReportFigure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SERIES_COLOURS, INK_COLOUR = ReportFigure.SERIES_COLOURS, ReportFigure.INK_COLOUR
SOFT_COLOUR, GRID_COLOUR, LEG_COLOUR = ReportFigure.PAPER_COLOUR, "#dfe3ea", "#bbbbbb"
"""Secondary content, grid, lines between legs."""
DOUBT_COLOUR = SERIES_COLOURS[4]
SERIES_MARKERS = "osD^vP*"
# Their names in templates/style.css, which redefines them for a dark page.
_CSS_NAMES = {
    INK_COLOUR: "ink", SOFT_COLOUR: "soft", GRID_COLOUR: "line", LEG_COLOUR: "leg",
    SERIES_COLOURS[0].lower(): "blue",
}  # fmt: skip
PAGE_PT, PAPER_PT = 9.5, 8.0  # by hand: text sizes of figures on page and paper
MIN_PAGE_PT = 9.0
"""Definition: 12 px of the screen, the smallest letter of a page's figure."""
MIN_ASPECT = 0.6  # by hand: height by width in a paper's column; less is hard to read
_INK_KEYS = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
_paper_in: ContextVar[float | None] = ContextVar("paper_in", default=None)


@contextmanager
def on_paper(width_in: float) -> Iterator[None]:
    """Context: `create_figure` makes figures of this width, inches, in a paper's font size."""
    token = _paper_in.set(width_in)
    try:
        yield
    finally:
        _paper_in.reset(token)


def create_figure(
    width: float, height: float, panels: int = 1, share_y: bool = True, rows: int = 1
) -> Any:
    """Create a figure and its axes, row by row, without a display; several axes get letters.

    width, height: inches on the page; `on_paper` keeps their ratio down to MIN_ASPECT.
    """
    require_extra("report", "a figure", "matplotlib")
    import matplotlib

    paper_in = _paper_in.get()
    if paper_in is not None:
        width, height = paper_in, max(paper_in * height / width, MIN_ASPECT * min(paper_in, 3.5))
    matplotlib.rcParams.update(
        {
            "svg.hashsalt": "deltact-fab",  # same figure, same bytes
            "svg.fonttype": "none",
            "pdf.fonttype": 42,  # text stays text, with its font
            "font.family": "sans-serif",
            "font.size": PAGE_PT if paper_in is None else PAPER_PT,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.color": GRID_COLOUR,
            **dict.fromkeys(_INK_KEYS, INK_COLOUR if paper_in is None else "#000000"),
            "grid.linewidth": 0.6,
            "axes.axisbelow": True,
            "legend.frameon": False,
        }
    )
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = list(figure.subplots(rows, panels, sharey=share_y, squeeze=False).flat)
    for letter, axis in zip(ascii_lowercase, axes if len(axes) > 1 else (), strict=False):
        axis.annotate(f"({letter})", (0, 1), xytext=(-4, 4), xycoords="axes fraction",
                      textcoords="offset points", ha="right", fontweight="bold")  # fmt: skip
    return figure, axes


PANELS_PER_ROW = 3  # by hand: more are too narrow to read


def create_panels(count: int, height: float, share_y: bool = True) -> Any:
    """Create a figure of `count` axes, PANELS_PER_ROW per row. height: of a row, inches."""
    columns = min(PANELS_PER_ROW, count)
    rows = -(-count // columns)
    figure, axes = create_figure(9.6, rows * height, columns, share_y, rows)
    for axis in axes[count:]:
        axis.remove()
    return figure, axes[:count]


def to_svg(figure: Figure, words: str = "") -> str:
    """Return the figure as an <svg> element of a page, without prologue and date.

    Transparent, with the colour names of the page's style, so it adapts to a dark page; colour maps
    are unchanged. words: alternative text; by default the labels of the first axes.
    """
    from matplotlib.colors import to_hex

    clamp_letters(figure, MIN_PAGE_PT)
    for patch in (figure.patch, *(axis.patch for axis in figure.axes)):
        if to_hex(patch.get_facecolor()) == "#ffffff":
            patch.set_facecolor("none")
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    svg = text[text.index("<svg") :]
    svg = re.sub("|".join(_CSS_NAMES), lambda m: f"var(--{_CSS_NAMES[m[0]]}, {m[0]})", svg)
    axes = figure.axes[0]
    against = (" ".join(label.split()) for label in (axes.get_ylabel(), axes.get_xlabel()))
    label = html.escape(words or " against ".join(filter(None, against)) or "figure", quote=True)
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    # Several figures share one page: an id must not meet its namesake in another figure.
    salt = f"f{zlib.crc32(svg.encode()):x}"
    svg = re.sub(r'\bid="', f'id="{salt}-', svg)
    svg = re.sub(r"url\(#", f"url(#{salt}-", svg)
    return re.sub(r'href="#', f'href="#{salt}-', svg)


def clamp_letters(figure: Figure, least_pt: float, most_pt: float = math.inf) -> None:
    """Clamp the font sizes of a figure, pt."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_fontsize(min(max(float(text.get_fontsize()), least_pt), most_pt))


def draw_legend(figure: Figure, axis: Axes) -> None:
    """Draw the legend of an axis under all axes of its figure."""
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower left", ncols=3,
                  fontsize="small")  # fmt: skip


WIDE_RANGE = 300.0  # by hand: highest over lowest; above it labels only at powers of ten


def set_log_scale(axis: Axes, directions: str) -> None:
    """Set logarithmic axes, "x", "y" or "xy", labelled 0.01, 0.02, 0.05 instead of powers."""
    from matplotlib.ticker import LogLocator, NullLocator

    for letter in directions:
        (axis.set_xscale if letter == "x" else axis.set_yscale)("log")
        side = axis.xaxis if letter == "x" else axis.yaxis
        low, high = side.get_view_interval()
        subs = (1.0, 2.0, 5.0) if high < WIDE_RANGE * low else (1.0,)
        side.set_major_locator(LogLocator(subs=subs))
        side.set_major_formatter("{x:g}")
        side.set_minor_locator(NullLocator())


MAX_LEGS = 20  # by hand: more labels overlap


def label_frames(axis: Axes, step_ids: pd.Series[str]) -> None:
    """Label an axis by frames from 1, and above it the starts of the path's legs."""
    from matplotlib.ticker import MaxNLocator

    axis.set_xlabel("frame")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    legs = step_ids.str.rsplit("/", n=1).str[-1].str.replace("shear-", "").to_numpy()
    begins = np.flatnonzero(np.append(True, legs[1:] != legs[:-1]))
    if len(begins) > MAX_LEGS:
        return  # illegible
    for start in begins[1:]:
        axis.axvline(start + 0.5, color=LEG_COLOUR, lw=0.7)
    above = axis.secondary_xaxis("top")
    above.set_xticks(begins + 1, legs[begins], rotation=90, fontsize="small", color=SOFT_COLOUR)
    above.tick_params(length=0, pad=1)
    above.spines[:].set_visible(False)


FAR_ABOVE = 3.0  # by hand: times the highest plotted value; more flattens the plot


def draw_paper_line(
    axis: Axes, value: float, highest: float, words: str, across: tuple[float, float] | None = None,
    about: bool = False,
) -> None:  # fmt: skip
    """Draw the paper's value as a line over the axis, or across a column of it.

    A value far above the plotted ones is written above the axis. about: the paper says "around".
    """
    if value > FAR_ABOVE * highest > 0:
        x = 1.0 if across is None else sum(across) / 2
        place = axis.transAxes if across is None else axis.get_xaxis_transform()
        words = f"{'≈' * about}{value:g} ↑"  # no wider than a column
        axis.text(x, 1.0, words if across else f"paper {words}", transform=place, va="bottom",
                  ha="right" if across is None else "center", fontsize="small",
                  color=SOFT_COLOUR)  # fmt: skip
        return
    place = axis.get_yaxis_transform() if across is None else axis.transData
    axis.plot(across or (0, 1), [value] * 2, "--" if about else "-", color=SOFT_COLOUR, lw=1.4,
              label=words, transform=place)  # fmt: skip


# Offset of a name from its mark, right and up, and the alignment of the name.
_LABEL_SIDES = (
    (1.0, 0.0, "left", "center"), (-1.0, 0.0, "right", "center"), (0.0, 1.0, "center", "bottom"),
    (0.0, -1.0, "center", "top"), (0.7, 0.7, "left", "bottom"), (-0.7, 0.7, "right", "bottom"),
    (0.7, -0.7, "left", "top"), (-0.7, -0.7, "right", "top"),
)  # fmt: skip
_LABEL_PLACES = [(pt, *side) for pt in (6.0, 16.0, 28.0, 42.0, 60.0) for side in _LABEL_SIDES]


def name_marks(
    figure: Figure, axis: Axes, marks: Sequence[tuple[float, float, str, str]], bold: str = ""
) -> None:
    """Write names beside their marks (x, y, name, colour) without overlap.

    A line joins a distant name to its mark. bold: the name to emphasise. Set limits and scales of
    the axis before.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    figure.draw_without_rendering()  # lays it out
    inside = axis.get_window_extent()
    spots = axis.transData.transform([mark[:2] for mark in marks])
    occupied = [Bbox([spot - 5, spot + 5]) for spot in spots]
    for x, y, name, colour in marks:
        line = {"arrowstyle": "-", "color": colour, "lw": 0.6, "shrinkA": 0, "shrinkB": 3}
        for off_pt, dx, dy, ha, va in _LABEL_PLACES:
            text = axis.annotate(
                name, (x, y), xytext=(off_pt * dx, off_pt * dy), textcoords="offset points",
                ha=ha, va=va, fontsize=MIN_PAGE_PT, fontweight="bold" if name == bold else None,
                arrowprops=line if off_pt > _LABEL_PLACES[0][0] else None,
            )  # fmt: skip
            text.get_window_extent()  # places it; the line may cross others
            box = Text.get_window_extent(text)
            free = inside.x0 <= box.x0 and box.x1 <= inside.x1 and not box.count_overlaps(occupied)
            if free or (off_pt, dx, dy, ha, va) == _LABEL_PLACES[-1]:
                break
            text.remove()
        occupied.append(box)


COLUMN_IN, BOTH_COLUMNS_IN = 3.5, 7.16  # of IEEE's two-column page
SMALLEST_PT = 6.0  # by hand: smaller is illegible in print
_NO_DATE = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def draw_for_paper(report_figure: ReportFigure) -> Figure:
    """Draw a figure at the size of a paper, with long titles wrapped."""
    with on_paper(COLUMN_IN if report_figure.column else BOTH_COLUMNS_IN):
        figure = report_figure.draw()
    clamp_letters(figure, SMALLEST_PT, PAPER_PT)
    _break_titles(figure)
    return figure


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """Return a figure's file, "svg" or "pdf", enlarged to include labels over the edge."""
    from matplotlib.transforms import Bbox

    out = io.BytesIO()
    figure.draw_without_rendering()  # lays it out
    width, height = map(float, figure.get_size_inches())
    box = Bbox.union([Bbox([[0.0, 0.0], [width, height]]), figure.get_tightbbox()])
    figure.savefig(out, format=kind, metadata=_NO_DATE[kind], bbox_inches=box)
    return out.getvalue()


def _break_titles(figure: Figure) -> None:
    """Wrap titles that are wider than their axes."""
    figure.draw_without_rendering()
    for axis in figure.axes:
        width = axis.get_window_extent().width
        for text in (axis.title, axis._left_title, axis._right_title):  # type: ignore[attr-defined]
            words, text_width = text.get_text(), text.get_window_extent().width
            if words and text_width > width and "$" not in words:
                letters = max(8, int(len(words) * width / text_width))
                text.set_text("\n".join(textwrap.wrap(words, letters)))
