"""Values show themselves in a notebook, and the notebook that shows them runs."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

from deltact_fab import record
from deltact_fab.cad import in_notebook
from deltact_fab.cad.registry import find
from deltact_fab.elasticity import GelMaterial
from deltact_fab.errors import MissingLibrary
from deltact_fab.gel.press import press
from deltact_fab.notebook import card, plot
from deltact_fab.patterns import PatternRecipe
from deltact_fab.protocols.plan import load
from deltact_fab.shapes import SkinDimensions
from deltact_fab.shapes.indenter import parse

TOUR = Path(__file__).parents[2] / "examples" / "tour.ipynb"


def rows(html: str) -> dict[str, str]:
    """The table of a card, which is well formed."""
    tree = ET.fromstring(html)
    return {"".join(tr[0].itertext()): "".join(tr[1].itertext()) for tr in tree.iter("tr")}


def test_a_part_shows_its_size_and_lacks_a_picture_without_the_kernel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def absent(*_: object) -> str:
        raise MissingLibrary("no libGL")

    monkeypatch.setattr("deltact_fab.cad.drafting.picture.part_svg", absent)
    shown = find("skin")._repr_html_()
    assert rows(shown)["box"] == "36 x 34 x 12 mm"
    assert float(rows(shown)["volume"].split()[0]) == pytest.approx(14.0, abs=0.5)
    assert "no picture: no libGL" in shown
    assert in_notebook.html(find("skin")) == shown


def test_a_pattern_shows_its_patches_and_dots() -> None:
    recipe = PatternRecipe(law="iid", seed=1, patch_mm=0.5, dots={"columns": 3, "rows": 2})
    shown = recipe._repr_html_()
    assert rows(shown)["patches"] == "70 x 70 of 0.5 mm"
    png = base64.b64decode(re.search("base64,([^']+)", shown)[1])
    white = (cv2.imdecode(np.frombuffer(png, np.uint8), 0) == 255).astype(np.uint8)
    _, _, _, middles = cv2.connectedComponentsWithStats(white)
    mm = (middles[1:] + 0.5) * 35 / 440 - 17.5
    assert np.sort(mm[:, 0]) == pytest.approx([-2.2, -2.2, 0, 0, 2.2, 2.2], abs=0.1)
    assert np.sort(mm[:, 1]) == pytest.approx([-0.8] * 3 + [0.8] * 3, abs=0.1)


def test_a_protocol_shows_what_it_does() -> None:
    told = rows(load("smoke")[0]._repr_html_())
    assert told["channels"] == "dots, force, image, shear"
    assert re.fullmatch(r"about [\d.]+ min at full feed", told["motion"])


def test_a_press_shows_its_force_and_a_refused_one_why() -> None:
    at = SkinDimensions(), GelMaterial(), parse("sphere:10"), (0.0, 0.0)
    shown = press(*at, 0.6, model="linear")._repr_html_()
    assert rows(shown)["normal force"].startswith("1.19 N ±")
    assert "shear force" not in rows(shown)
    refused = press(*at, 5.0, model="linear")._repr_html_()
    assert "level hyperelastic can" in refused


def test_a_run_shows_its_peak_and_its_deepest_image(mini_run: Path) -> None:
    run = record.open(mini_run)
    shown = run._repr_html_()
    told = rows(shown)
    assert told["rig"] == "virtual, simulated"
    assert (told["presses"], told["deepest"]) == ("2", "1.00 mm")
    assert told["peak force"] == f"{-run.frames()['fz_n'].min():.2f} N"
    assert "data:image/png" in shown


def test_what_is_shown_is_escaped_and_takes_the_theme_s_colour() -> None:
    shown = card("<b>", {"a": "<script>", "none": None}, note="x < y")
    assert "<script>" not in shown
    assert rows(shown) == {"a": "<script>"}
    line = plot([0, 1, float("nan")], [0, 2, 1], "d (mm)", "F (N)")
    assert "currentColor" in line
    assert "nan" not in line
    assert plot([1], [1], "x", "y") == ""


@pytest.mark.slow
def test_the_tour_runs_in_a_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cell, by a kernel of its own; five of them show a card."""
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("PYTHONPATH", str(TOUR.parents[1]))
    notebook = nbformat.read(TOUR, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    cards = [out["data"]["text/html"] for out in outputs if "text/html" in out.get("data", {})]
    assert [re.search(r"<b>([^<]*)</b>", html)[1].split()[0] for html in cards] == [
        "Pattern", "skin-frame", "Press", "Protocol", "Run",
    ]  # fmt: skip
    said = "".join(out.get("text", "") for out in outputs)
    told = re.search(r"measured ([\d.]+) N, predicted ([\d.]+) N", said)
    assert told is not None
    measured_n, predicted_n = map(float, told.groups())
    assert measured_n == pytest.approx(predicted_n, rel=0.05)
    live = re.findall(r"([\d.]+) N, ([\d.]+) mm, \d+ ms", said)
    normal_n, depth_mm = (max(map(float, column)) for column in zip(*live, strict=True))
    assert normal_n == pytest.approx(measured_n, abs=0.3)
    # The highest of all images: .56 mm for the press itself, .79 where the shear goes outwards.
    assert depth_mm == pytest.approx(0.6, abs=0.25)
