"""The list of faults put in by hand fits the code."""

import tomllib

from deltact_fab.paths import PACKAGE_DIR


def test_each_mutant_matches_once() -> None:
    root = PACKAGE_DIR.parent
    faults = tomllib.loads((root / "benchmarks/mutants.toml").read_text())["fault"]
    assert len(faults) == 20
    assert [f for f in faults if (root / f["file"]).read_text().count(f["old"]) != 1] == []
