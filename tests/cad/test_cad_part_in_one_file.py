"""A part is one file: a file put among parts/ is found wherever a part is asked for."""

import json
import sys

import pytest
from click.testing import CliRunner

from deltact_fab.cad import parts
from deltact_fab.cad.check import run
from deltact_fab.cad.design import IndenterList, load_design
from deltact_fab.cad.export import export_parts
from deltact_fab.cad.fabrication import bom
from deltact_fab.cad.registry import find, of_design
from deltact_fab.cli.main import main
from deltact_fab.report import guide

SHIM = '''
"""A shim for the bench."""

from deltact_fab.cad.solid_gate import Expected
from deltact_fab.cad.drafting.items import Callouts, x_of, y_of, z_of
from deltact_fab.cad.kernel import require
from deltact_fab.cad.part import PRINT, RESIN, Part
from deltact_fab.cad.rule import Rule


def size(d):
    return 20.0, 30.0, d.shell.wall_mm


def expect(d):
    x, y, z = size(d)
    return Expected((x * y * z,) * 2, ((0.0, 0.0, 0.0), (x, y, z)), {"wall_mm": z})


def build(d):
    return require().Solid.makeBox(*size(d))


def rules(d):
    yield Rule("shim", ("1", 1.0), "<=", ("shell.wall_mm", d.shell.wall_mm))


def callouts(d):
    x, y, z = size(d)
    items = (x_of("top", 0, x, "bottom"), y_of("top", 0, y, "left"), z_of("front", 0, z, "left"))
    return Callouts(items, ("Flat.",))


def wall_mm(d):
    return d.shell.wall_mm


def note(d):
    return f"{d.shell.wall_mm:g} mm thick"


PARTS = (
    Part(
        "shim", RESIN, PRINT, build, expect, group="bench", sections=("shell",),
        derived=("z_joint_mm",), rules=rules, wall_mm=wall_mm, callouts=callouts, note=note,
        how="flat on the platform", look_for="no warp",
    ),
)
'''


@pytest.fixture
def shim(tmp_path, monkeypatch):
    (tmp_path / "shim.py").write_text(SHIM)
    monkeypatch.setattr(parts, "__path__", [*parts.__path__, str(tmp_path)])
    yield find("shim")
    sys.modules.pop("deltact_fab.cad.parts.shim", None)
    vars(parts).pop("shim", None)


def test_it_is_in_the_list_shown_bought_drawn_guided_and_exported(shim, tmp_path):
    listed = CliRunner().invoke(main, ["cad", "list", "--json"])
    assert "shim" in [row["part"] for row in json.loads(listed.output)]
    told = CliRunner().invoke(main, ["cad", "show", "shim"])
    assert "shell.wall_mm" in told.output
    assert "1 <= shell.wall_mm" in told.output
    design = load_design()
    (line,) = [line for line in bom.lines(design) if line.part == "shim"]
    assert line.group == "bench"
    assert line.note == "1.5 mm thick"
    files = export_parts(
        design, [shim], ("step", "stl", "3mf", "svg"), 0.05, tmp_path / "out", cached=False
    )
    assert {f.file for f in files} == {"shim.step", "shim.stl", "shim.3mf", "shim.svg"}
    assert "Flat." in (tmp_path / "out" / "shim.svg").read_text()
    page = guide.write(design, tmp_path / "guide.html", pictures=guide.Pictures()).read_text()
    assert "flat on the platform" in page
    assert "no warp" in page


def test_it_is_checked_by_its_own_limits(shim):
    rows = run(load_design(), indenters=IndenterList())
    own = {row.check: row for row in rows if row.part == "shim"}
    assert own["wall thickness"].found.startswith("1.500 mm")
    assert own["wall thickness"].passed
    assert "1 of 1 hold" in own["inequalities"].found
    thin = run(load_design(changes=["shell.wall_mm=0.8"]), indenters=IndenterList())
    assert "1 <= 0.8" in {r.part: r.found for r in thin if r.check == "inequalities"}["shim"]


def test_two_files_cannot_claim_one_name(shim, tmp_path):
    (tmp_path / "shim2.py").write_text(SHIM)
    with pytest.raises(RuntimeError, match="two parts are called 'shim'"):
        of_design()
    sys.modules.pop("deltact_fab.cad.parts.shim2", None)
    vars(parts).pop("shim2", None)
