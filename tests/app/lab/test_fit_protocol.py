"""Protocols fitted to another design: every contact is on its face."""

from __future__ import annotations

from pathlib import Path

import pytest
from called import called

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.limits import check_limits
from deltact_fab.bench.rig.config import load_rig
from deltact_fab.common import catalog
from deltact_fab.fabricate.cad.design import load_design

STAGED = sorted(set(catalog.catalogue_names("protocols")) - {"dead-weights"})
LISTED = """
name = "listed"
channels = ["force", "shear"]
[[press]]
indenter = "sphere:22"
x_mm = 9.0
depth_mm = 3.0
[[press]]
indenter = "sphere:18"
y_mm = -8.0
depth_mm = 2.0
shear_x_mm = 1.0
[reference]
every = 1
at_mm = [-9.0, 2.0]
depth_mm = 1.0
[capture]
settle_s = 1.0
"""


@pytest.fixture
def designs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.chdir(tmp_path)
    Path("listed.toml").write_text(LISTED)
    Path("small.toml").write_text("[skin]\nwidth_mm = 24.0\nlength_mm = 22.0\n")
    Path("thin.toml").write_text("[skin]\nthickness_mm = 5.0\nprotrusion_mm = 4.0\n")
    return ["small", "thin", "skin-44x40"]


def failed(protocol: str, design: str) -> dict[str, str]:
    """Reasons of the checks of reach and depth that fail."""
    stage = load_rig("virtual")[0].stage
    loaded, _ = plan.load_protocol(protocol)
    rows = check_limits(loaded, load_design(design), stage)
    return {r.id: r.reason for r in rows if r.failed}


@pytest.mark.parametrize("source", [*STAGED, "listed"])
def test_fitted_protocol_stays_on_the_face(source: str, designs: list[str]) -> None:
    for design in designs:
        name = f"{source}-{design}"
        process = called("protocol", "new", name, "--from", source, "--design", design)
        assert process.returncode == 0, process.stderr
        assert failed(name, design) == {}
        fitted, usual = (plan.load_protocol(n)[0] for n in (name, source))
        assert fitted.specimen.design == design
        assert len(fitted.tips) == len(usual.tips)
        assert [p.number for p in fitted.list_presses()] == [p.number for p in usual.list_presses()]


def test_failed_reach_names_places(designs: list[str]) -> None:
    text = LISTED.replace("sphere:22", "sphere:16").replace("y_mm = -8.0", "")
    text = text.replace("sphere:18", "sphere:16").replace("[-9.0, 2.0]", "[0, 0]")
    Path("at.toml").write_text(text)
    reason = failed("at", "small")["footprint.x"]
    assert "places within +-4 mm for sphere:16" in reason
    for x_mm, ids in ((4.0, []), (4.02, ["footprint.x"])):  # the limit is as told
        Path("at.toml").write_text(text.replace("x_mm = 9.0", f"x_mm = {x_mm}"))
        assert list(failed("at", "small")) == ids
    Path("at.toml").write_text(text.replace("sphere:16", "sphere:26"))
    assert "no place on this face for sphere:26" in failed("at", "small")["footprint.x"]


def test_impossible_fit_is_refused(designs: list[str]) -> None:
    Path("tiny.toml").write_text("[skin]\nwidth_mm = 6.0\nlength_mm = 6.0\n")
    process = called("protocol", "new", "t", "--from", "shapes", "--design", "tiny")
    assert process.returncode == 2
    assert "no size of it suits a face of 6 x 6 mm" in process.stderr
    assert not Path("t.toml").exists()
