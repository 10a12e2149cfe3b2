"""Evidence: what a row depends on, one file of rows that goes on where it stopped, its tables."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import evidence, store, tables
from deltact_fab.common import digest
from deltact_fab.common.errors import InputError

MACHINE = {"machine": {"processor": "", "cores": 1}, "threads": 1, "load": None, "versions": {}}


def test_rows_are_unique_and_stored() -> None:
    names = [r.name for r in evidence.rows()]
    assert len(set(names)) == len(names)
    kinds = {name.partition(":")[0] for name in names}
    assert kinds == {"felupe", "held", "peer"}
    assert set(store.read(evidence.HERE / evidence.ROWS)) == set(names)


def of(row: evidence.EvidenceRow) -> set[str]:
    """Files of the package that a row's digest is of."""
    modules = evidence._spelled(row.call)[1]
    own = {m.partition(".")[2] for m in modules if m.startswith("benchmarks.")}
    known = digest.code_files(*own, package=evidence.HERE)
    known += digest.code_files(
        *(m.partition(".")[2] for m in modules if m.startswith("deltact_fab."))
    )
    here = digest.PACKAGE_DIR
    return {p.relative_to(here).as_posix() for p in known if p.is_relative_to(here)}


def test_row_depends_on_its_level_only() -> None:
    rows = {r.name: r for r in evidence.rows()}
    finite = of(rows["felupe: 2 mm, cells of 2 mm"])
    assert "physics/gel/finite/newton.py" in finite
    assert not finite & {
        "physics/gel/press.py",
        "physics/gel/level_selection.py",
        "physics/gel/linear/contact.py",
        "bench.py",
    }
    picked = of(rows["held: edges to 5 mm"])
    assert "sensor/elasticity/edge_compliance.py" in picked
    assert "physics/gel/press.py" not in picked


@pytest.mark.slow
def test_evidence_resumes_and_marks_stale_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, name = tmp_path / "rows.jsonl", "peer: dis-fast"
    (row,) = (r for r in evidence.rows() if r.name == name)
    monkeypatch.setattr(evidence, "rows", lambda: [row])
    assert evidence.fill(path) == 1
    (entry,) = store.read(path).values()
    assert entry["result"]["method"] == "dis-fast"
    assert evidence.fill(path, only=name) == 0
    assert "1 of 1 rows are there, 0 of them stale." in told(path)
    entry["key"]["source"] = "older"
    store.append(path, entry)
    assert evidence.fill(path) == 0  # not unasked
    text = told(path)
    assert "| dis-fast † |" in text
    assert "1 of them stale (†)" in text
    assert "make evidence" in text
    monkeypatch.setattr(evidence, "run_row", lambda *_: {"failed": "asked"})
    assert evidence.fill(path, only="held") == 0
    assert evidence.fill(path, only="peer") == evidence.fill(path, stale=True) + 1 == 1
    assert "0 of them stale." in told(path)


def told(path: Path) -> str:
    out = path.with_suffix(".md")
    tables.write_up(out, store.read(path), [r.key for r in evidence.rows()])
    return out.read_text()


def test_rows_are_sorted_and_unique(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    entries = [{"key": {"row": name}, "result": i} for i, name in enumerate("bab")]
    for entry in entries:
        store.append(path, entry)
    assert store.read(path) == {"a": entries[1], "b": entries[2]}
    with path.open("a") as out:
        out.write('{"key": {"row": "c"')  # cut off while it was written
    assert list(store.compact(path)) == ["a", "b"]
    assert path.read_text().splitlines() == [json.dumps(e, separators=(",", ":"))
                                             for e in (entries[1], entries[2])]  # fmt: skip
    path.write_text('{"key": {"row": "a"}}\n<<<<<<< ours\n')
    with pytest.raises(InputError, match="line 2: no row of evidence"):
        store.read(path)
