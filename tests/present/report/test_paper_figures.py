"""Figures for a paper: as wide as its columns, letters that are read, the same bytes each time."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from made_up_study import bars
from matplotlib.text import Text

from deltact_fab.present.report import figures
from deltact_fab.present.report.result import ReportFigure


def width_pt(svg: bytes) -> float:
    found = re.search(rb'<svg [^>]*?width="([\d.]+)pt"', svg, re.DOTALL)
    assert found is not None
    return float(found.group(1))


@pytest.mark.slow
@pytest.mark.parametrize(("column", "width_in"), [(True, 3.5), (False, 7.16)])
def test_width_letters_and_fonts(tmp_path: Path, column: bool, width_in: float) -> None:
    figure = figures.draw_for_paper(ReportFigure("bars", "", bars, column))
    assert figure.get_size_inches()[0] == pytest.approx(width_in)
    assert figure.get_size_inches()[1] <= 0.7 * width_in
    sizes = {t.get_fontsize() for t in figure.findobj(Text) if t.get_text()}
    assert min(sizes) >= figures.SMALLEST_PT
    assert max(sizes) == figures.PAPER_PT
    svg, pdf = (figures.figure_bytes(figure, kind) for kind in ("svg", "pdf"))
    assert width_pt(svg) == pytest.approx(72 * width_in, abs=0.1)
    assert b"<text" in svg
    assert b"mean error, mm" in svg
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf
    assert b"CreationDate" not in pdf


def test_wide_title_is_wrapped() -> None:
    figure = figures.draw_for_paper(ReportFigure("bars", "", bars, True))
    title = figure.axes[0].get_title(loc="left")
    assert "\n" in title
    assert title.replace("\n", " ") == bars().axes[0].get_title(loc="left")


def test_page_size_is_restored() -> None:
    with figures.on_paper(3.5):
        assert bars().get_size_inches()[0] == 3.5
    assert bars().get_size_inches()[0] == pytest.approx(9.6)
    label = next(t for t in bars().findobj(Text) if t.get_text() == "mean error, mm")
    assert label.get_fontsize() == figures.PAGE_PT


def test_names_do_not_overlap() -> None:
    figure, (axis,) = figures.create_figure(6, 3)
    marks = [(1 + 0.01 * i, 1 + 0.01 * (i % 3), f"a long name {i}", "#000000") for i in range(7)]
    axis.plot([m[0] for m in marks], [m[1] for m in marks], "o")
    axis.set_xlim(0, 2)
    axis.set_ylim(0, 2)
    figures.name_marks(figure, axis, marks, "a long name 3")
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in axis.texts]  # without their lines
    assert len(boxes) == 7
    for i, one in enumerate(boxes):
        assert axis.get_window_extent().x0 <= one.x0
        assert one.x1 <= axis.get_window_extent().x1
        assert not any(one.overlaps(other) for other in boxes[:i])
    assert [t.get_text() for t in axis.texts if t.get_fontweight() == "bold"] == ["a long name 3"]
