"""Figures of studies: letters that are read, names that meet nothing, the same bytes each time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from made_up_study import study
from matplotlib.text import Text

from deltact_fab.report import figures


@pytest.mark.slow
def test_a_figure_s_files_have_letters_as_text_and_the_same_bytes_each_time(tmp_path: Path) -> None:
    two = replace(study(), figures=study().figures[:2])
    files = figures.save(two, tmp_path / "a")
    assert [path.name for path in files] == ["bars.svg", "bars.pdf", "picture.svg", "picture.pdf"]
    again = figures.save(two, tmp_path / "b")
    assert [p.read_bytes() for p in files] == [p.read_bytes() for p in again]
    svg, pdf, picture, _ = (path.read_bytes() for path in files)
    assert b"<text" in svg
    assert b"mean error, mm" in svg
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf
    assert b"CreationDate" not in pdf
    assert b"<image" in picture


def test_names_stay_off_each_other_and_inside() -> None:
    figure, (axis,) = figures.blank(6, 3)
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
