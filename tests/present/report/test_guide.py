"""The fabrication guide is one file, is right for its design, and says what it lacks."""

from __future__ import annotations

import base64
import io
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from seen_page import SeenPage, offline

from deltact_fab.common import Check, cache, validate
from deltact_fab.common.errors import InputError, MissingLibrary, RunFailed
from deltact_fab.fabricate import guide
from deltact_fab.fabricate.cad import kernel
from deltact_fab.fabricate.cad.check.verdict import DesignVerdict, judge_design
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.dimensions import Design
from deltact_fab.fabricate.cad.export.meshes import AT_ORIGIN, glb_bytes, shaded_mesh
from deltact_fab.fabricate.cad.mesh import Mesh
from deltact_fab.fabricate.cad.parts.mold import RELEASE_AGENT
from deltact_fab.fabricate.cad.registry import list_parts
from deltact_fab.fabricate.guide import PatternToPrint, Pictures, write_guide
from deltact_fab.fabricate.patterns.recipe import PatternRecipe
from deltact_fab.present.report.first_light import render_examples as pairs

STICKER, STICKERS = guide.sticker, {}  # type: ignore[var-annotated]
SVG = "data:image/svg+xml;base64,PHN2Zy8+"
DRAWN = Pictures(
    SVG,
    SVG,
    {part.name: SVG for part in list_parts()},
    '<p>turn "it"</p></iframe>',
    dict.fromkeys(guide.ASSEMBLY_STEPS, SVG),
    {"cover": "26.1 mm2 from 1.6 mm up, unsupported"},
)


MADE: dict[str, Any] = {
    "examples": pairs, "pictures": DRAWN, "verdict": DesignVerdict("mine", (Check("all"),))
}  # fmt: skip


@pytest.fixture(autouse=True)
def _one_sticker_a_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pattern's pictures take most of a page's time, and follow from what the camera sees."""
    monkeypatch.setattr(
        guide, "sticker", lambda design, examples: STICKERS.get(design.optics) or _drawn(design)
    )


def _drawn(design: Design) -> PatternToPrint:
    STICKERS[design.optics] = made = STICKER(design, pairs)
    return made


def page(out: Path, *changes: str, design: str = "deltact", sensors: int = 1) -> SeenPage:
    return SeenPage(write_guide(load_design(design, changes), out, sensors, **MADE).read_text())


def test_guide_is_offline_and_anchors_resolve(tmp_path: Path) -> None:
    file = write_guide(load_design(), tmp_path / "guide.html", **MADE)
    seen, beside = offline(file.read_text())
    assert beside == set()
    assert {link[1:] for link in seen.links if link.startswith("#")} <= set(seen.ids)
    # The exploded view, the bench, the wiring, and the pattern with good and spoiled ones.
    assert seen.tags.count("img") == 8 + len(list_parts()) + len(guide.ASSEMBLY_STEPS)
    assert seen.tags.count("iframe") == 1
    again = write_guide(load_design(), tmp_path / "again.html", **MADE)
    assert again.read_bytes() == file.read_bytes()


def test_guide_of_failing_design_says_so(tmp_path: Path) -> None:
    tight = load_design(changes=["plate.fit_mm=0.02"])
    made = {**MADE, "verdict": judge_design(tight, "tight", parts=())}
    with pytest.raises(
        RunFailed, match=r"tight: 4/.* checks failed; --force .* plate in its pocket"
    ):
        write_guide(tight, tmp_path / "guide.html", **made)
    assert not (tmp_path / "guide.html").exists()
    text = write_guide(tight, tmp_path / "guide.html", **made, force=True).read_text()
    head = text[text.index('<div class="verdict') : text.index("Work from top to bottom")]
    assert 'class="verdict fail"' in head
    assert head.index("NOT TO BE BUILT: tight: 4/") < head.index("plate in its pocket, x: -0.160")
    assert "plate.fit_mm: 0.1 or more" in head


def test_steps_are_in_order(tmp_path: Path) -> None:
    text = page(tmp_path / "guide.html").text
    at = [
        text.index(words)
        for words in (
            "A. Print, wash", "B. Coupon test", "Primer.", "Mix.", "Degas", "Pour", "Acrylic. Peel",
            "Cure level", "Demold.", "E. Pattern by water transfer", "first white", "then black",
            "G. Light", "Camera to holder.", "Cover to holder.", "Into the shell.", "Skin on.",
            "Four screws", "Close the notch.", "Light leak.",
        )
    ]  # fmt: skip
    assert at == sorted(at)


DEFAULT = (
    # Skin, light, pattern, joints, screws and ceilings by their figures.
    "14.14 cm³", "16 h", "8–10 h", "65 °C", "82 Ω", "20.7 mW", "0.5 mm behind the joint",
    "56 × 54 mm", "M1.6 × 16", "0.68 g", "the 17 × 2 mm notch is a window onto lens and ring",
    "with notched corners", "tip the mold by about 10°", "26.1 mm² from 1.6 mm up, unsupported",
    # What may hurt the maker or the skin.
    "nitrile gloves and goggles", "PR-1200, lacquer, isopropanol", "running extraction",
    "Keep alcohol and primer off the fresh edges", RELEASE_AGENT,
)  # fmt: skip


@pytest.mark.parametrize(
    ("design", "changes", "holds", "lacks"),
    [
        ("deltact", (), DEFAULT, ("not stocked", "threaded rod")),
        ("screws-19mm", (), ("not stocked", "M1.6 × 19", "M1.6 threaded rod with a nut"), ()),
        ("skin-44x40", (), ("64 × 60 mm",), ("56 × 54 mm",)),
        ("deltact", ("shell.cable_width_mm=16.5",), ("the 16.5 × 2 mm notch is a window",), ()),
        ("deltact", ("screw.length_mm=15",), ("cut one of 16 mm down",), ("threaded rod",)),
        ("deltact", ("frame.wall_x_mm=6.6", "shell.ledge_x_mm=0"),
         ("from low above. Fill until the liquid",), ("with notched corners", "four post faces")),
        ("deltact", ("light.resistor_ohm=20",), ("H. Assembly",), ()),
        ("deltact", ("mount.kind=plate",), ("H. Assembly",), ()),
        ("deltact", ("mold.columns=4",), ("H. Assembly",), ("plate-1.3mf",)),
        ("deltact", ("camera.hole_mm=0", "holder.screw=none"), ("H. Assembly",), ()),
    ],
)  # fmt: skip
def test_guide_follows_its_design(
    tmp_path: Path,
    design: str,
    changes: tuple[str, ...],
    holds: tuple[str, ...],
    lacks: tuple[str, ...],
) -> None:
    text = page(tmp_path / "guide.html", *changes, design=design).text
    assert [words for words in holds if words not in text] == []
    assert [words for words in lacks if words in text] == []


def test_guide_has_number_of_sensors(tmp_path: Path) -> None:
    text = page(tmp_path / "guide.html", sensors=4).text
    assert "how to make 4" in text
    assert "5 skins (the transparent base included), in 2 fillings" in text


def test_guide_has_print_orientations(tmp_path: Path) -> None:
    text = page(tmp_path / "guide.html").text
    assert [
        part.name for part in list_parts() if part.printed and part.pose.instructions not in text
    ] == []


@pytest.mark.parametrize("design", ["deltact", "franka"])
def test_measured_values_are_verified(design: str, tmp_path: Path) -> None:
    keys = load_design(design).unverified()
    text = page(tmp_path / "a.html", design=design).text
    assert f"{len(keys)} dimensions unverified" in text
    assert all(f"{key} = " in text for key in keys)
    sections = list(dict.fromkeys(key.partition(".")[0] for key in keys))
    # Each key goes into the list of its own section.
    assert set(re.findall(r"(\w+)\.measured", text)) == set(sections)
    changes = [
        f"{name}.measured={json.dumps([k.partition('.')[2] for k in keys if k.startswith(name)])}"
        for name in sections
    ]
    done = page(tmp_path / "b.html", *changes, design=design).text
    assert "dimensions unverified" not in done
    assert "Every dimension is marked as measured." in done


def test_steps_join_parts_that_stay_joined() -> None:
    """What a step has brought together, a later one moves as one."""
    sensor = {part.name for part in list_parts() if part.group == "sensor"}
    joined = [{"skin", "acrylic", "skin-frame"}]  # by the casting
    for layers in guide.ASSEMBLY_STEPS.values():
        for layer in layers:
            for group in joined:
                assert group <= set(layer) or not group & set(layer)
        named = {name for layer in layers for name in layer}
        assert len(named) == sum(len(layer) for layer in layers)
        joined = [named, *(group for group in joined if not group & named)]
    assert joined == [sensor]


def test_missing_kernel_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise MissingLibrary("the CAD kernel cannot load: libGL.so.1; apt-get install libgl1")

    monkeypatch.setattr(kernel, "require", missing)
    monkeypatch.setenv(cache.FOLDER_VARIABLE, str(tmp_path / "empty"))
    seen = SeenPage(write_guide(load_design(), tmp_path / "guide.html", examples=pairs).read_text())
    assert "12 skipped: the CAD kernel cannot load: libGL.so.1" in seen.text
    assert "No pictures and no 3D view: the CAD kernel cannot load: libGL.so.1" in seen.text
    # The wiring drawing and the pattern need no kernel.
    assert seen.tags.count("img") == 6
    assert "iframe" not in seen.tags
    assert "H. Assembly" in seen.text


def test_view_is_the_offline_model() -> None:
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]], np.float32)
    triangle = Mesh(corners, np.arange(3)[None], np.zeros(1, np.int64), 0.0)
    glb = glb_bytes({"lid": (shaded_mesh(triangle, "lid", (0.2, 0.5, 0.2, 1.0)), AT_ORIGIN)})
    page = guide.turntable(glb)
    assert page == guide.turntable(glb)
    assert offline(page)[1] == set()
    shown = re.search(r'base64_data="([^"]+)"', page)
    assert shown is not None
    assert b'"lid"' in base64.b64decode(shown[1])


def test_unwritable_guide_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: cannot be made"):
        write_guide(load_design(), tmp_path / "file" / "guide.html", **MADE)
    with pytest.raises(InputError, match="sensors 0"):
        write_guide(load_design(), tmp_path / "guide.html", 0, **MADE)


@pytest.mark.slow
def test_sticker_belongs_to_the_design() -> None:
    shipped = STICKER(load_design(), pairs)
    assert (shipped.file, shipped.unseen) == ("", "")
    wide = load_design("large-60x50")
    own = STICKER(wide, pairs)
    recipe = validate(PatternRecipe, tomllib.loads(own.file), "recommended-large.toml")
    assert wide.optics.print_shortfall(recipe.printed_mm) is None
    assert own.size_mm == recipe.size_mm == 56.4
    seen = Image.open(io.BytesIO(base64.b64decode(own.image.partition(",")[2])))
    assert [side * recipe.patch_mm for side in seen.size] == pytest.approx(
        wide.optics.view_mm, abs=recipe.patch_mm
    )
