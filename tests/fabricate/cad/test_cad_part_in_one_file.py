"""A part is one file: a file put among parts/ is found wherever a part is asked for."""

import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab.app.cli.main import main
from deltact_fab.fabricate import guide
from deltact_fab.fabricate.cad import parts
from deltact_fab.fabricate.cad.check import check_design
from deltact_fab.fabricate.cad.check.verdict import DesignVerdict
from deltact_fab.fabricate.cad.design import IndenterList, load_design
from deltact_fab.fabricate.cad.export import export_parts
from deltact_fab.fabricate.cad.fabrication import bom
from deltact_fab.fabricate.cad.registry import design_parts, find_part
from deltact_fab.present.report.first_light import render_examples as pairs

SHIM = (
    Path(__file__).parents[3] / "examples/extend/deltact_fab/fabricate/cad/parts/shim.py"
).read_text()


@pytest.fixture
def shim(tmp_path, monkeypatch):
    (tmp_path / "shim.py").write_text(SHIM)
    monkeypatch.setattr(parts, "__path__", [*parts.__path__, str(tmp_path)])
    yield find_part("shim")
    sys.modules.pop("deltact_fab.fabricate.cad.parts.shim", None)
    vars(parts).pop("shim", None)


def test_new_part_appears_everywhere(shim, tmp_path):
    listed = CliRunner().invoke(main, ["cad", "list", "--json"])
    assert "shim" in [row["part"] for row in json.loads(listed.output)]
    told = CliRunner().invoke(main, ["cad", "show", "shim"])
    assert "shell.wall_mm" in told.output
    design = load_design()
    (line,) = [line for line in bom.bom_lines(design) if line.part == "shim"]
    assert line.group == "bench"
    assert line.note == "1.5 mm thick"
    files = export_parts(
        design, [shim], ("step", "stl", "3mf", "svg"), 0.05, tmp_path / "out", cached=False
    )
    assert {f.file for f in files} == {
        f"print/shim.{kind}" for kind in ("step", "stl", "3mf", "svg")
    }
    assert "Flat." in (tmp_path / "out" / "print" / "shim.svg").read_text()
    file = tmp_path / "guide.html"
    page = guide.write_guide(
        design, file, examples=pairs, pictures=guide.Pictures(), verdict=DesignVerdict("mine", ())
    ).read_text()
    assert "flat on the platform" in page
    assert "no warp" in page


@pytest.mark.slow
def test_part_has_its_own_limits(shim):
    rows = check_design(load_design(), indenters=IndenterList())
    own = {row.name: row for row in rows if row.subject == "shim"}
    assert own["wall thickness"].value.startswith("1.500 mm")
    assert not own["wall thickness"].failed
    assert "1/1 constraints met" in own["inequalities"].value
    thin = check_design(load_design(changes=["shell.wall_mm=0.8"]), indenters=IndenterList())
    assert "1 <= 0.8" in {r.subject: r.value for r in thin if r.name == "inequalities"}["shim"]


def test_duplicate_part_name_is_refused(shim, tmp_path):
    (tmp_path / "shim2.py").write_text(SHIM)
    with pytest.raises(RuntimeError, match="two entries of PARTS are called 'shim'"):
        design_parts()
    sys.modules.pop("deltact_fab.fabricate.cad.parts.shim2", None)
    vars(parts).pop("shim2", None)
