"""The paper's series: which patterns, the folder that is whole or not there, the views."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from deltact_fab.common import validate
from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.patterns import series
from deltact_fab.fabricate.patterns.code import decode_recipe
from deltact_fab.fabricate.patterns.quality.measure import measure_quality
from deltact_fab.fabricate.patterns.recipe import PatternRecipe, load_recipe
from deltact_fab.sensor.shapes.imaging import Printer

SIDE_MM = 5.0


def small(*keys: tuple[float, float]) -> list[series.SeriesEntry]:
    """Entries of the paper on stickers of a few millimetres, with one marker dot."""
    dots = {"columns": 1, "rows": 1}
    out = []
    for entry in series.list_series(seed=3):
        if (entry.recipe.patch_mm, entry.recipe.r) in keys:
            data = entry.recipe.model_dump(exclude_none=True) | {"size_mm": SIDE_MM, "dots": dots}
            out.append(replace(entry, recipe=validate(PatternRecipe, data, "small")))
    return out


@pytest.fixture(scope="module")
def entries() -> list[series.SeriesEntry]:
    return small((0.1, 0.5), (0.2, 0.1))


@pytest.fixture(scope="module")
def written(
    entries: list[series.SeriesEntry], tmp_path_factory: pytest.TempPathFactory
) -> series.SeriesReport:
    out = tmp_path_factory.mktemp("series") / "new" / "small"
    return series.write_series(out, seed=3, entries=entries)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_the_papers_17_patterns():
    found = {(e.recipe.patch_mm, e.recipe.r): e for e in series.list_series(seed=5)}
    first = {(d, r) for d in (0.1, 0.15, 0.2) for r in (0.1, 0.3, 0.5)}
    second = {(d, r) for d in (0.05, 0.075, 0.1) for r in (0.4, 0.5, 0.6)}
    assert set(found) == first | second
    assert len(series.list_series()) == 17 == len({e.name for e in series.list_series()})
    for key, entry in found.items():
        assert entry.rounds == tuple(k for k, grid in ((1, first), (2, second)) if key in grid)
        assert (entry.recipe.seed, entry.recipe.law, entry.recipe.size_mm) == (5, "algorithm1", 35)
        assert entry.recipe.dots is not None
        assert entry.recipe.dots.columns * entry.recipe.dots.rows == 169
    assert found[0.075, 0.6].name == "d0p075-r0p6"
    said = {e.name: e.paper_text for e in series.list_series(with_dots=False) if e.paper_text}
    about = dict.fromkeys(("d0p05-r0p4", "d0p05-r0p5", "d0p05-r0p6"), "about 0.5 mm")
    assert said == {"d0p1-r0p5": "0.11 mm", "d0p075-r0p6": "0.08 mm"} | about


def test_folder_contents(written, entries):
    found = set(contents(written.out))
    assert found == {
        "recipes/d0p1-r0p5.toml",
        "recipes/d0p2-r0p1.toml",
        "series.pdf",
        "views/d0p1-r0p5.png",
        "views/d0p2-r0p1.png",
        "quality.json",
        "quality.csv",
    }
    assert {str(p.relative_to(written.out)) for p in written.files} == found
    assert [p.name for p in written.out.parent.iterdir()] == ["small"]  # nothing is left beside it
    assert (written.out / "series.pdf").read_bytes().startswith(b"%PDF")
    json.dumps(written.as_dict(), allow_nan=False)
    table = list(csv.DictReader(io.StringIO((written.out / "quality.csv").read_text())))
    for line, row in zip(table, written.figures["patterns"], strict=True):
        assert line["name"] == row["name"]
        assert float(line["designed.sssig"]) == row["quality"]["designed"]["sssig"]
        contrast = row["quality"]["photographed"]["contrast"]
        assert float(line["photographed.contrast.5"]) == contrast[5]
    for entry, row in zip(entries, written.figures["patterns"], strict=True):
        assert decode_recipe(row["code"]) == entry.recipe


def test_figures_are_measured_without_dots(written, entries):
    data = json.loads((written.out / "quality.json").read_bytes())
    assert data == written.figures
    for entry, row in zip(entries, data["patterns"], strict=True):
        bare = entry.recipe.model_copy(update={"dots": None})
        expected = measure_quality(bare, Printer(dpi=1200), seed=3)
        assert (row["quality"]["seed"], row["quality"]["dpi"]) == (3, 1200)
        for side in ("designed", "photographed"):
            for key, value in asdict(getattr(expected, side)).items():
                assert row["quality"][side][key] == pytest.approx(value, rel=1e-8), key


def test_commands_accept_its_recipes(written, entries):
    for entry in entries:
        file = written.out / "recipes" / f"{entry.name}.toml"
        assert load_recipe(str(file)) == entry.recipe
    text = (written.out / "recipes" / "d0p1-r0p5.toml").read_text()
    assert "rounds 1 and 2" in text
    assert "0.11 mm" in text


def test_series_is_reproducible_never_overwritten(written, entries, tmp_path):
    (tmp_path / "again").mkdir()  # empty
    again = series.write_series(tmp_path / "again", seed=3, entries=entries)
    assert contents(again.out) == contents(written.out)
    with pytest.raises(InputError, match="again: exists already; name a new folder"):
        series.write_series(again.out, seed=3, entries=entries)


def test_failing_page_leaves_nothing(entries, tmp_path):
    def broken(folder: Path) -> None:
        assert (folder / "quality.json").is_file()
        raise KeyboardInterrupt("no page")

    with pytest.raises(KeyboardInterrupt, match="no page"):
        series.write_series(tmp_path / "new", seed=3, entries=entries[:1], page=broken)
    assert list(tmp_path.iterdir()) == []


def test_unusable_folder_is_refused_early(entries, tmp_path):
    (tmp_path / "file").write_text("")
    for place, said in (("file", "exists already"), ("file/below", "cannot be made"),
                        ("n" * 300, "cannot be made: File name too long")):  # fmt: skip
        with pytest.raises(InputError, match=said):
            series.write_series(tmp_path / place, entries=entries, progress=pytest.fail)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("change", "said"), [({"paper": "A44"}, "paper"), ({"dpi": 90}, "dpi"), ({"dpi": 200}, "dpi")]
)
def test_unprintable_sheet_is_refused_early(entries, tmp_path, change, said):
    with pytest.raises(InputError, match=said):
        series.write_series(tmp_path / "s", entries=entries, **change)
    assert not (tmp_path / "s").exists()
