"""The pictures of printing, casting, film and coats show what the steps say, from the solids."""

import re

import pytest
from solids import made

from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.drafting.casting import CastingScenes
from deltact_fab.fabricate.cad.drafting.picture import picture_svg
from deltact_fab.fabricate.cad.registry import list_parts
from deltact_fab.paths import asset

pytestmark = pytest.mark.slow
DESIGN = load_design()
# Outcomes, rests, single parts, a cup, a balance.
NO_PICTURE = {
    "A.1", "A.2", "A.3", "B.4", "C.3", "C.4", "D.1", "D.2", "D.4", "D.5", "E.1", "E.2", "E.3",
    "F.1", "F.2",
}  # fmt: skip


@pytest.fixture(scope="module")
def scenes():
    solids = {p.name: made(p.name) for p in list_parts(design=DESIGN) if p.indenter is None}
    return dict(CastingScenes(DESIGN, solids).steps())


def of(placed, name):
    return [piece.solid for piece in placed if piece.part.name == name]


def test_every_joining_step_has_picture(scenes):
    page = asset("templates/guide.html").read_text()
    steps = set()
    for letter, text in re.findall(r"<h2>([A-F])\. (.*?)</section>", page, re.S):
        steps |= {f"{letter}.{i}" for i in range(1, text.count("<li>") + 1)}
    assert set(re.findall(r'step\("([A-F]\.\d+)"\)', page)) == set(scenes)
    assert steps - set(scenes) == NO_PICTURE


def test_silicone_fills_cavity_and_is_level(scenes):
    (poured,) = of(scenes["D.7"], "silicone")
    assert poured.Volume() == pytest.approx(DESIGN.skin_volume_mm3 / 2, rel=1e-6)
    (tipped,) = of(scenes["D.6"], "silicone")
    top = max(tipped.Faces(), key=lambda face: face.Center().z)
    assert top.normalAt().toTuple() == pytest.approx((0, 0, 1))
    assert tipped.Volume() < poured.Volume()
    for name in ("skin-frame", "mold"):
        for solid in of(scenes["D.6"], name):
            assert solid.intersect(tipped).Volume() == pytest.approx(0, abs=1e-3)
    # Frame, plate and silicone are where they touch and no deeper.
    for name in ("skin-frame", "mold", "acrylic"):
        for solid in of(scenes["D.9"], name):
            assert solid.intersect(poured).Volume() == pytest.approx(0, abs=1e-3)


def test_coats_cover_film_and_face(scenes):
    (film,), (white,) = of(scenes["E.7"], "film"), of(scenes["F.3"], "white coat")
    (skin,) = of(scenes["E.7"], "skin")
    assert skin.intersect(film).Volume() == pytest.approx(0, abs=1e-3)
    assert film.intersect(white).Volume() == pytest.approx(0, abs=1e-3)
    assert film.BoundingBox().zmin == pytest.approx(-DESIGN.skin.edge_fillet_mm)


def test_picture_names_its_pieces(scenes):
    text = picture_svg("step D.9", scenes["D.9"])
    for name in ("silicone", "acrylic", "skin-frame", "mold"):
        assert f">{name}<" in text
