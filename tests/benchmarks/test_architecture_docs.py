"""The diagram and the table of packages are what the code says."""

from __future__ import annotations

import re

import pytest

from benchmarks import architecture


@pytest.fixture(scope="module")
def graph() -> architecture.Graph:
    return architecture.imports()


def test_pages_match_the_code() -> None:
    stale = [file.name for file, text in architecture.pages().items() if file.read_text() != text]
    assert not stale, "python -m benchmarks.reference writes them anew"


def test_every_package_has_a_purpose() -> None:
    rows = architecture.packages().splitlines()[2:]
    assert len(rows) > 25
    shape = r"\| (\*\*`\w+`\*\* \| |\| `\w+` )\|( \d+)? \| [A-Z].*\. \|"
    assert [row for row in rows if not re.fullmatch(shape, row)] == []


def test_omitted_arrows_are_implied(graph: architecture.Graph) -> None:
    drawn = architecture.reduced(graph)
    assert sum(map(len, drawn.values())) < sum(map(len, graph.values())) / 2
    for name in graph:
        assert architecture.reachable(drawn, name) == architecture.reachable(graph, name)


def test_estimators_do_not_import_truth(graph: architecture.Graph) -> None:
    estimators, truth = architecture.sides()
    assert estimators
    assert truth
    for name in estimators:
        assert not architecture.reachable(graph, name) & truth


def test_every_named_file_exists() -> None:
    """Paths from the package or the checkout, and names of a wing as `bench.open_run`."""
    page = architecture.PAGE.read_text()
    tops = (architecture.ROOT / architecture.PACKAGE, architecture.ROOT)
    paths = set(re.findall(r"`((?:\w+/)+[\w.]*)`", page)) - {"images/", "truth/", "RUN/truth"}
    assert len(paths) > 40
    assert [p for p in sorted(paths) if not any((top / p).exists() for top in tops)] == []
    wings = "|".join(path.parent.name for path in tops[0].glob("*/__init__.py"))
    names = re.findall(rf"`({wings})\.(\w+)`", page)
    assert [(wing, name) for wing, name in names if name not in architecture.door(wing)] == []
