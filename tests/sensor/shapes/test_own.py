"""Indenters of a lab's own file: turned, crossed, tilted; in numbers, as solids, in a record."""

import json
import re

import numpy as np
import pytest

from deltact_fab.common.errors import InputError
from deltact_fab.fabricate.cad.check.built import BuiltDesign
from deltact_fab.fabricate.cad.check.each_part import height_fields
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.fabricate.cad.registry import find_part
from deltact_fab.physics.gel.level import is_mirrored
from deltact_fab.sensor.shapes import indenter
from deltact_fab.sensor.shapes.bounded import ShapeError
from deltact_fab.sensor.shapes.own import OwnShape, OwnTip
from deltact_fab.sensor.shapes.prism import PrismTip
from deltact_fab.sensor.shapes.rigid import PosedTip
from deltact_fab.sensor.shapes.tips import EllipsoidTip, RidgeTip, SphereTip
from deltact_fab.sensor.shapes.turned import TurnedTip

OWN = ("cross", "tilted-edge", "two-axis")


def test_posed_tip_starts_in_the_middle() -> None:
    with pytest.raises(ShapeError, match="x = y = 0"):
        PosedTip(SphereTip(2.5, 0.0, 4.0), 0.0, 0.0, tilt_y_deg=10.0)


def test_turned_ridge_matches_turned_points():
    ridge = RidgeTip(0.0, 0.0, 0.3, 1.5, 6.0)
    turned = PosedTip(ridge, 1.0, -0.5, turn_deg=30.0)
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-4, 4, (2, 500))
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    there = turned.height_mm(1.0 + c * u - s * v, -0.5 + s * u + c * v)
    assert there == pytest.approx(ridge.height_mm(u, v), abs=1e-12)
    assert turned.half_mm[0] < 4.6
    assert turned.equator_mm == ridge.equator_mm


def test_tilted_ball_is_unchanged_below_equator():
    ball = PosedTip(SphereTip(0.0, 0.0, 4.0), 0.0, 0.0, tilt_x_deg=12.0, tilt_y_deg=-20.0)
    x, y = np.random.default_rng(4).uniform(-1, 1, (2, 300))
    # It turns about the ball's lowest point, and so its middle moves aside.
    middle = ball.origin_mm + ball.turn @ (0.0, 0.0, 4.0)
    assert ball.lowest_mm == pytest.approx(middle[:2], abs=1e-6)
    exact = 4.0 - np.sqrt(16.0 - (x - middle[0]) ** 2 - (y - middle[1]) ** 2)
    assert ball.height_mm(x, y) == pytest.approx(exact, abs=1e-9)
    assert ball.equator_mm == pytest.approx(4.0, abs=2e-3)


def test_a_tilted_spheroid_is_its_quadric():
    """Its lowest point and underside by the matrix of the ellipsoid, which the tip never forms."""
    tip = PosedTip(EllipsoidTip(0.0, 0.0, 4.5, 3.0), 0.0, 0.0, 20.0, 10.0, 15.0)
    r = tip.turn
    q = r @ np.diag([4.5**-2, 3.0**-2, 3.0**-2]) @ r.T
    middle = tip.origin_mm + r @ (0.0, 0.0, 3.0)
    low = np.linalg.inv(q)[:, 2] / np.sqrt(np.linalg.inv(q)[2, 2])
    assert middle - low == pytest.approx([*tip.lowest_mm, 0.0], abs=1e-7)
    x, y = np.random.default_rng(5).uniform(-0.8, 0.8, (2, 200)) + np.array(tip.lowest_mm)[:, None]
    dx, dy = x - middle[0], y - middle[1]
    b = q[0, 2] * dx + q[1, 2] * dy
    c = q[0, 0] * dx**2 + 2 * q[0, 1] * dx * dy + q[1, 1] * dy**2 - 1
    exact = middle[2] + (-b - np.sqrt(b**2 - q[2, 2] * c)) / q[2, 2]
    assert tip.height_mm(x, y) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(
    "upright",
    [TurnedTip.cylinder(4.5, 0.3), PrismTip.polygon(6, 4.5), EllipsoidTip(0.0, 0.0, 4.5, 3.0)],
    ids=lambda tip: type(tip).__name__,
)
def test_tilted_tip_contains_its_ball(upright):
    tip = PosedTip(upright, 0.4, -0.2, tilt_x_deg=20.0, tilt_y_deg=10.0)
    x, y = tip.lowest_mm
    d = tip.radius_mm * np.linspace(0, 1 - 1e-9, 40)[:, None]
    angle = np.linspace(0, 2 * np.pi, 49)[None]
    height = tip.height_mm(x + d * np.cos(angle), y + d * np.sin(angle))
    assert np.all(height <= tip.radius_mm - np.sqrt(tip.radius_mm**2 - d**2) + 1e-6)


@pytest.mark.parametrize("name", OWN)
def test_solid_matches_height_field(name):
    built = BuiltDesign(load_design(), (find_part(name),), {})
    assert [row.status for row in height_fields(built)] == ["pass"]


def test_mirrors_are_those_of_the_shape():
    mirrored = {
        name: [is_mirrored(indenter.parse_indenter(name), axis) for axis in (0, 1)] for name in OWN
    }
    assert mirrored == {"cross": [True, True], "tilted-edge": [False, False],
                        "two-axis": [False, False]}  # fmt: skip
    assert [is_mirrored(indenter.parse_indenter("star"), axis) for axis in (0, 1)] == [False, True]
    assert [is_mirrored(indenter.parse_indenter("hexprism"), axis) for axis in (0, 1)] == [
        True,
        True,
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('tips = [{kind = "ridge", radius_mm = 1.0}]', "a ridge takes radius_mm, half_width_mm"),
        ('tips = [{kind = "ball", radius_mm = 1.0, a_mm = 2.0}]', "a ball takes radius_mm: a_mm"),
        ('tips = [{kind = "ball", radius_mm = 2.0, tilt_x_deg = 50}]', "|tilt_x_deg| <= 45: 50"),
        ('tips = [{kind = "ball", radius_mm = 2.0}]\nreach_mm = 4', "equator + 3 <= reach_mm"),
        ('tips = [{kind = "cube"}]', "shape.mine.tips"),
    ],
)
def test_invalid_shape_is_one_line(tmp_path, monkeypatch, text, says):
    (tmp_path / "indenters.toml").write_text(f"[shape.mine]\n{text}\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=re.escape(says)) as told:
        indenter.parse_indenter("mine")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", ["Mine", "a/b", "star", "sphere"])
def test_reserved_or_invalid_names_are_refused(name):
    shape = OwnShape((OwnTip("ball", radius_mm=2.0),))
    with pytest.raises(InputError, match="not a built-in one"):
        shape.indenter(name)


def test_run_keeps_its_own_shapes(tmp_path, monkeypatch):
    (tmp_path / "indenters.toml").write_text(
        '[shape.mine]\ntips = [{kind = "ball", radius_mm = 2.0, x_mm = 1.0}]\n'
    )
    monkeypatch.chdir(tmp_path)
    kept = indenter.describe_indenters(["sphere:10", "star:8", "mine"])
    assert list(kept) == ["mine"]
    (tmp_path / "indenters.toml").unlink()
    with pytest.raises(InputError, match="'mine': unknown"):
        indenter.parse_indenter("mine")
    found = indenter.restore_indenter("mine", json.loads(json.dumps(kept)), "run.json")
    assert found.tips == (SphereTip(1.0, 0.0, 2.0),)
    assert indenter.restore_indenter("sphere:10", {}, "run.json") == indenter.parse_indenter(
        "sphere:10"
    )
