"""A study's figures as files for a paper: SVG and PDF, as wide as its columns, in 8 point."""

from __future__ import annotations

import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from ..files import write_whole
from . import figures
from .result import ReportFigure, StudyResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMN_IN, BOTH_COLUMNS_IN = 3.5, 7.16  # of IEEE's two-column page
SMALLEST_PT = 6.0
SLACK_IN = 0.02
MARGIN_IN = 0.03
FORMATS = ("svg", "pdf")
_NO_DATE = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save(result: StudyResult, folder: Path) -> list[Path]:
    """Write NAME.svg and NAME.pdf of every figure into a folder; the files, in their order.

    Letters are text with their font beside (SVG) or in the file (PDF), of 6 to 8 points. The same
    figure gives the same bytes each time. All are drawn before the first is written. Raises
    MissingLibrary without the extra `report`, InputError for a folder that cannot be, RunFailed
    when the disk refuses.
    """
    from .study_folder import make

    drawn = {
        f"{one.name}.{kind}": as_bytes(figure, kind)
        for one in result.figures
        for figure in (draw(one),)
        for kind in FORMATS
    }
    make(folder)
    for name, data in drawn.items():
        write_whole(folder / name, data)
    return [folder / name for name in drawn]


def draw(one: ReportFigure) -> Figure:
    """A figure at the size of a paper, its titles broken where they would run over."""
    with figures.on_paper(COLUMN_IN if one.column else BOTH_COLUMNS_IN):
        figure = one.draw()
    figures.letters(figure, SMALLEST_PT, figures.PAPER_PT)
    _break_titles(figure)
    return figure


def as_bytes(figure: Figure, kind: str) -> bytes:
    """The file of a figure, `svg` or `pdf`.

    What still runs over the edge makes the figure larger, for a clipped label is lost.
    """
    from matplotlib.transforms import Bbox

    out = io.BytesIO()
    box = None
    if runs_over(figure):
        width, height = figure.get_size_inches()
        canvas = Bbox([[0.0, 0.0], [float(width), float(height)]])
        box = Bbox.union([canvas, _tight(figure).padded(MARGIN_IN)])
    figure.savefig(out, format=kind, metadata=_NO_DATE[kind], bbox_inches=box)
    return out.getvalue()


def runs_over(figure: Figure) -> bool:
    """Whether anything of the figure lies outside its edges."""
    box = _tight(figure)
    width, height = figure.get_size_inches()
    return bool(
        min(box.x0, box.y0) < -SLACK_IN or box.x1 > width + SLACK_IN or box.y1 > height + SLACK_IN
    )


def _tight(figure: Figure):  # type: ignore[no-untyped-def]  # a matplotlib Bbox, in inches
    figure.draw_without_rendering()  # lays it out
    return figure.get_tightbbox()


def _break_titles(figure: Figure) -> None:
    """Titles that are wider than what they stand above go on in the next line."""
    figure.draw_without_rendering()
    for axis in figure.axes:
        width = axis.get_window_extent().width
        for text in (axis.title, axis._left_title, axis._right_title):  # type: ignore[attr-defined]
            words, wide = text.get_text(), text.get_window_extent().width
            if words and wide > width and "$" not in words:
                letters = max(8, int(len(words) * width / wide))
                text.set_text("\n".join(textwrap.wrap(words, letters)))
