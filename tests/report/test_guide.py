"""The fabrication guide is one file, is right for its design, and says what it lacks."""

from __future__ import annotations

import base64
import io
import json
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deltact_fab.cad import kernel
from deltact_fab.cad.design import load_design
from deltact_fab.cad.export.formats.glb import GlbPart, glb_bytes
from deltact_fab.cad.parts.mold import RELEASE_AGENT
from deltact_fab.cad.registry import find, listed
from deltact_fab.errors import InputError, MissingLibrary
from deltact_fab.patterns.recipe import recipe_from
from deltact_fab.report import guide
from deltact_fab.report.guide import Pictures, write

SVG = "data:image/svg+xml;base64,PHN2Zy8+"
DRAWN = Pictures(
    SVG,
    SVG,
    {part.name: SVG for part in listed()},
    '<p>turn "it"</p></iframe>',
    dict.fromkeys(guide.STEPS, SVG),
    {"cover": "26.1 mm2 from 1.6 mm up, unsupported"},
)


class Seen(HTMLParser):
    """Ids, anchors, everything a browser would fetch, and the text outside scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.fetched: list[str] = []
        self.tags: list[str] = []
        self.text = ""
        self.feed(page)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("src", "href", "srcset") and value:
                self.fetched.append(value)

    def handle_data(self, data: str) -> None:
        if self.tags[-1:] not in (["script"], ["style"]):
            self.text += data


def page(out: Path, *changes: str, design: str = "deltact", sensors: int = 1) -> Seen:
    return Seen(write(load_design(design, changes), out, sensors, pictures=DRAWN).read_text())


@pytest.fixture(scope="module")
def default(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    return page(tmp_path_factory.mktemp("guide") / "guide.html")


def test_it_fetches_nothing_and_its_anchors_lead_somewhere(default: Seen) -> None:
    assert all(link.startswith(("data:", "#")) for link in default.fetched)
    anchors = {link[1:] for link in default.fetched if link.startswith("#")}
    assert anchors <= set(default.ids)
    assert len(default.ids) == len(set(default.ids))
    # The exploded view, the bench, the wiring, and the pattern with good and spoiled ones.
    assert default.tags.count("img") == 8 + len(listed()) + len(guide.STEPS)
    assert default.tags.count("iframe") == 1


def test_it_tells_the_steps_in_their_order(default: Seen) -> None:
    at = [
        default.text.index(words)
        for words in (
            "A. Print, wash", "B. Coupon test", "Primer.", "Mix.", "Degas", "Pour", "Acrylic. Peel",
            "Cure level", "Demold.", "E. Pattern by water transfer", "first white", "then black",
            "G. Light", "Camera to holder.", "Cover to holder.", "Into the shell.", "Skin on.",
            "Four screws", "Close the notch.", "Light leak.",
        )
    ]  # fmt: skip
    assert at == sorted(at)


@pytest.mark.parametrize(
    "figure",
    ["31.1", "14.14 cm³", "16 h", "8–10 h", "65 °C", "2.73", "110 Ω", "9.1 Ω", "8.3 mW",
     "5 mm long", "0.5 mm behind the joint", "56 × 54 mm", "35.8 × 36.8",
     "M1.6 × 16", "4.6 mm", "102.5 Ω", "0.68 g", "0.15 mm", "15 mm above", "83 %"],
)  # fmt: skip
def test_it_names_the_figures(default: Seen, figure: str) -> None:
    assert figure in default.text


def test_it_is_the_guide_of_its_design(default: Seen, tmp_path: Path) -> None:
    assert "not stocked" not in default.text
    other = page(tmp_path / "a.html", design="screws-19mm", sensors=4)
    assert "not stocked" in other.text
    assert "M1.6 × 19" in other.text
    assert "how to make 4" in other.text
    assert "5 skins (the transparent base included), in 2 fillings" in other.text
    wide = page(tmp_path / "b.html", design="skin-44x40")
    assert "64 × 60 mm" in wide.text
    assert "56 × 54 mm" not in wide.text


@pytest.mark.parametrize(
    "changes",
    [
        ("light.resistor_ohm=20",),
        ("mount.kind=plate",),
        ("light.supply_v=5.5",),
        ("mold.columns=1",),
        ("camera.hole_mm=0", "holder.screw=none"),
    ],
)
def test_unusual_designs_have_a_guide(tmp_path: Path, changes: tuple[str, ...]) -> None:
    assert "H. Assembly" in page(tmp_path / "guide.html", *changes).text


def measured(section: str, keys: list[str]) -> str:
    """The change that marks all of a section's keys as measured."""
    names = [key.partition(".")[2] for key in keys if key.startswith(f"{section}.")]
    return f"{section}.measured={json.dumps(names)}"


def sections(keys: list[str]) -> list[str]:
    return list(dict.fromkeys(key.partition(".")[0] for key in keys))


def test_what_is_measured_is_no_longer_unverified(default: Seen, tmp_path: Path) -> None:
    keys = load_design().unverified()
    assert {"camera.lens_diameter_mm", "camera.lens_height_mm"} < set(keys)
    assert f"{len(keys)} dimensions unverified" in default.text
    assert all(f"{key} = " in default.text for key in keys)
    told = " or ".join(f"{section}.measured" for section in sections(keys))
    assert f"without its section, in {told}:" in default.text
    done = page(tmp_path / "guide.html", *(measured(s, keys) for s in sections(keys)))
    assert "dimensions unverified" not in done.text
    assert "camera.measured" not in done.text
    assert "Every dimension is marked as measured." in done.text


def test_each_section_says_where_its_measured_keys_go(tmp_path: Path) -> None:
    franka = load_design("franka").unverified()
    both = page(tmp_path / "a.html", design="franka").text
    assert f"{len(franka)} dimensions unverified" in both
    assert set(re.findall(r"(\w+)\.measured", both)) == set(sections(franka)) > {"mount", "camera"}
    changes = [measured(s, franka) for s in sections(franka) if s != "mount"]
    mount = page(tmp_path / "b.html", *changes, design="franka").text
    assert "in mount.measured:" in mount
    assert "camera.measured" not in mount


def test_the_notch_for_the_cable_is_closed_against_light(default: Seen, tmp_path: Path) -> None:
    assert "the 17 × 2 mm notch is a window onto lens and ring" in default.text
    assert "At the notch: more foam" in default.text
    other = page(tmp_path / "guide.html", "shell.cable_width_mm=16.5")
    assert "the 16.5 × 2 mm notch is a window" in other.text


def test_a_screw_nobody_sells_is_made_and_a_stripped_one_replaced(
    default: Seen, tmp_path: Path
) -> None:
    paper = page(tmp_path / "paper.html", design="screws-19mm").text
    assert "M1.6 threaded rod with a nut as head" in paper
    assert "no longer one that would fit is sold" in paper
    shorter = page(tmp_path / "guide.html", "screw.length_mm=15").text
    assert "cut one of 16 mm down" in shorter
    assert "use one of 16 mm, a new frame" in shorter
    assert "threaded rod" not in shorter


def test_notches_and_post_faces_are_named_where_they_exist(default: Seen, tmp_path: Path) -> None:
    held = page(tmp_path / "guide.html", "frame.wall_x_mm=6.6", "shell.ledge_x_mm=0").text
    for words in (
        "with notched corners",
        "tip the mold by about 10°",
        "(5.05 × 3.55 mm) look down",
    ):
        assert words in default.text
        assert words not in held
    assert "four post faces" not in held
    assert "from low above. Fill until the liquid" in held


def test_it_says_how_each_printed_part_lies(default: Seen) -> None:
    for part in listed():
        if part.printed:
            assert part.lies.words in default.text
    assert "ceilings: 26.1 mm² from 1.6 mm up, unsupported" in default.text


def test_every_step_brings_together_parts_of_the_sensor_that_stay_together() -> None:
    """What a step has brought together, a later one moves as one."""
    sensor = {part.name for part in listed() if part.group == "sensor"}
    joined = [{"skin", "acrylic", "skin-frame"}]  # by the casting
    for layers in guide.STEPS.values():
        for layer in layers:
            for group in joined:
                assert group <= set(layer) or not group & set(layer)
        named = {name for layer in layers for name in layer}
        assert len(named) == sum(len(layer) for layer in layers)
        joined = [named, *(group for group in joined if not group & named)]
    assert joined == [sensor]


def test_the_frame_s_front_carries_no_supports() -> None:
    how = find("skin-frame").making
    assert "supports on the rim of the back only, none on the front" in how


@pytest.mark.parametrize(
    "words",
    ["nitrile gloves and goggles", "PR-1200, lacquer, isopropanol", "running extraction",
     "Keep alcohol and primer off the fresh edges", RELEASE_AGENT],
)  # fmt: skip
def test_it_warns(default: Seen, words: str) -> None:
    assert words in default.text


def test_without_the_kernel_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise MissingLibrary("the CAD kernel cannot load: libGL.so.1; apt-get install libgl1")

    monkeypatch.setattr(kernel, "require", missing)
    seen = Seen(write(load_design(), tmp_path / "guide.html").read_text())
    assert "No pictures and no 3D view: the CAD kernel cannot load: libGL.so.1" in seen.text
    # The wiring drawing and the pattern need no kernel.
    assert seen.tags.count("img") == 6
    assert "iframe" not in seen.tags
    assert "H. Assembly" in seen.text


def test_the_view_is_the_model_and_fetches_nothing() -> None:
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]], np.float32)
    triangle = GlbPart("lid", corners, np.eye(3, dtype=np.float32)[[2, 2, 2]],
                       np.arange(3, dtype=np.uint32)[None], (0.2, 0.5, 0.2, 1.0))  # fmt: skip
    glb = glb_bytes([triangle])
    page = guide.turntable(glb)
    assert page == guide.turntable(glb)
    assert Seen(page).fetched == []
    shown = re.search(r'base64_data="([^"]+)"', page)
    assert shown is not None
    assert b'"lid"' in base64.b64decode(shown[1])


def test_the_same_design_gives_the_same_bytes(tmp_path: Path) -> None:
    a, b = (write(load_design(), tmp_path / n, pictures=DRAWN) for n in ("a.html", "b.html"))
    assert a.read_bytes() == b.read_bytes()


def test_where_it_cannot_be_written_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: cannot be made"):
        write(load_design(), tmp_path / "file" / "guide.html", pictures=DRAWN)
    with pytest.raises(InputError, match="sensors 0"):
        write(load_design(), tmp_path / "guide.html", 0, pictures=DRAWN)


def test_the_sticker_is_the_design_s_own() -> None:
    shipped = guide.sticker(load_design())
    assert (shipped.file, shipped.unseen) == ("", "")
    wide = load_design("large-60x50")
    own = guide.sticker(wide)
    recipe = recipe_from(tomllib.loads(own.file), "recommended-large.toml")
    assert wide.optics.beyond(recipe.printed_mm) is None
    assert own.size_mm == recipe.size_mm == 56.4
    seen = Image.open(io.BytesIO(base64.b64decode(own.image.partition(",")[2])))
    assert [side * recipe.patch_mm for side in seen.size] == pytest.approx(
        wide.optics.view_mm, abs=recipe.patch_mm
    )
