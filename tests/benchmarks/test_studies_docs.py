"""The figures that the docs show of studies are those that the studies gave."""

from __future__ import annotations

from benchmarks import studies


def test_pages_match_stored_results() -> None:
    assert studies.PAGE.read_text() == studies.page(studies.kept())
    text = studies.HOW_TO.read_text()
    assert text == studies.with_block(text, studies.kept())


def test_no_study_is_undecided_without_price() -> None:
    heads = [head for study in studies.kept() for head in study["headlines"]]
    assert all(head["price"] for head in heads if head["state"] == "undecided")


def test_every_study_has_stored_results() -> None:
    from deltact_fab.studies.study.registry import STUDIES

    assert {study["study"] for study in studies.kept()} == set(STUDIES)
    assert set(studies.ORDER) == set(STUDIES)
