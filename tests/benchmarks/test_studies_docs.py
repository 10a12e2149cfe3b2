"""The figures that the docs show of studies are those that the studies gave."""

from __future__ import annotations

import pytest

from benchmarks import studies


def test_the_page_is_what_is_kept() -> None:
    assert studies.PAGE.read_text() == studies.page(studies.kept())


def test_the_how_to_is_what_is_kept() -> None:
    text = studies.HOW_TO.read_text()
    assert text == studies.with_block(text, studies.kept())


def test_every_study_is_kept() -> None:
    from deltact_fab.study.registry import STUDIES

    assert {study["study"] for study in studies.kept()} == set(STUDIES)
    assert set(studies.ORDER) == set(STUDIES)


def test_a_typed_figure_is_seen() -> None:
    text = studies.HOW_TO.read_text().replace(studies.END, f"and 3 N more\n{studies.END}")
    assert text != studies.with_block(text, studies.kept())


def test_a_page_without_the_block_is_refused() -> None:
    with pytest.raises(ValueError, match=r"studies.md: the lines"):
        studies.with_block("# no block here\n", studies.kept())
