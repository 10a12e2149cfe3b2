"""Values show themselves in a notebook, and the notebook that shows them runs."""

from __future__ import annotations

import base64
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

from deltact_fab.cad import in_notebook
from deltact_fab.cad.registry import find
from deltact_fab.errors import MissingLibrary
from deltact_fab.patterns import PatternRecipe

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
