"""Indenters as numbers: names, height fields, footprints, volumes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from closed_forms import tip_mm3

from deltact_fab.common.aliases import Field
from deltact_fab.common.errors import InputError
from deltact_fab.sensor.shapes.bounded import ShapeError
from deltact_fab.sensor.shapes.indenter import DEFAULT_SIZE_MM, parse_indenter
from deltact_fab.sensor.shapes.prism import PrismTip
from deltact_fab.sensor.shapes.rigid import Indenter, Tip
from deltact_fab.sensor.shapes.tips import EllipsoidTip, RidgeTip, SphereTip
from deltact_fab.sensor.shapes.turned import ProfilePiece, TurnedTip

PAPER = ("4dots", "edges", "ellipsoid", "hexprism", "star")
RECONSTRUCTED = ("cylinder", "ring", "hat")
SCALED = (*PAPER, "2dots", *RECONSTRUCTED)


def dimpled() -> TurnedTip:
    """Off the axis: an arc that bulges upwards in the middle, then one downwards, tangent to it."""
    low, dip = 0.5, 1.5
    middle = (low + dip) * math.sin(math.pi / 6)
    sunk = low - (low + dip) * math.cos(math.pi / 6)
    joint = dip * math.sin(math.pi / 6), sunk + dip * math.cos(math.pi / 6)
    pieces = (ProfilePiece(joint, (0.0, sunk)), ProfilePiece((middle + low, low), (middle, low)))
    return TurnedTip(0.3, -0.7, low, (0.0, sunk + dip), pieces)


TIPS: tuple[Tip, ...] = (
    SphereTip(0.5, -1.0, 2.0),
    RidgeTip(-1.0, 0.3, 0.4, 1.2, 5.0, flank_deg=40.0),
    EllipsoidTip(0.2, 0.1, 4.5, 3.0),
    PrismTip.polygon(6, 4.5),
    PrismTip.polygon(4, 3.0, 0.8, 0.1),
    PrismTip(0.3, -0.2, 5, 4.5, 2.25),
    PrismTip(0.0, 0.0, 3, 4.0, 1.2, 0.4, 1.5, 0.39),
    TurnedTip.cylinder(4.5, 0.3),
    TurnedTip.ring(4.5, 1.5),
    TurnedTip.hat(4.5, 2.475, 2.7, 60.0, 0.3),
    dimpled(),
)
TURNED = tuple(t for t in TIPS if isinstance(t, TurnedTip))


def grid(half_x: float, half_y: float, spacing: float) -> tuple[Field, Field]:
    """Cell centres that cover +-half and one cell more."""
    x = np.arange(-half_x - spacing / 2, half_x + spacing, spacing)
    y = np.arange(-half_y - spacing / 2, half_y + spacing, spacing)
    xx, yy = np.meshgrid(x, y)
    return xx, yy


@pytest.mark.parametrize(
    ("typed", "name", "slug"),
    [
        ("sphere:10", "sphere:10", "sphere-10"),
        (" sphere:12.50 ", "sphere:12.5", "sphere-12p5"),
        ("star:9.0", "star", "star"),
        ("hexprism:7.5", "hexprism:7.5", "hexprism-7p5"),
    ],
)
def test_a_name_is_normalised(typed: str, name: str, slug: str) -> None:
    assert parse_indenter(typed).name == name
    assert parse_indenter(typed).slug == slug
    assert parse_indenter(name) == parse_indenter(typed)


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        ("elipsoid", "indenter 'elipsoid': unknown; did you mean 'ellipsoid'?"),
        ("cube:3", "valid: sphere:DIAMETER_MM or (:SIZE_MM optional) 4dots, 2dots, edges, "),
        ("sphere", "a diameter of 0.5 to 30 mm, as in 'sphere:10'"),
        ("sphere:nan", "a diameter of 0.5 to 30 mm"),
        ("star:big", "5 to 20 mm"),
        ("edges:20.1", "5 to 20 mm"),
    ],
)
def test_wrong_name_lists_valid_ones(typed: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_indenter(typed)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["sphere:10", "4dots"])
def test_spheres_keep_their_bits(name: str) -> None:
    """Recorded runs repeat byte for byte only while these sums are done in this order."""
    shape = parse_indenter(name)
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-6, 6, (2, 20000))
    expected = np.full(x.shape, np.inf)
    h, r = (0.0, 5.0) if name == "sphere:10" else (2.5, 2.0)
    for cy in sorted({-h, h}):
        for cx in sorted({-h, h}):
            r2 = (x - cx) ** 2 + (y - cy) ** 2
            inside = r2 <= r**2
            cap = r - np.sqrt(np.where(inside, r**2 - r2, 0.0))
            expected = np.where(inside, np.minimum(expected, cap), expected)
    assert np.isfinite(expected).sum() > 4000
    assert shape.height_mm(x, y).tobytes() == expected.tobytes()


@pytest.mark.parametrize("name", ["sphere:10", *SCALED, *(f"{n}:20" for n in SCALED)])
def test_field_and_footprint(name: str) -> None:
    shape = parse_indenter(name)
    hx, hy = shape.footprint_half_mm
    assert 2 * max(hx, hy) == pytest.approx(float(name.partition(":")[2] or DEFAULT_SIZE_MM))
    spacing = max(hx, hy) / 200
    x, y = grid(hx, hy, spacing)
    height = shape.height_mm(x, y)
    assert height.shape == x.shape
    assert height.dtype == np.float64
    inside = np.isfinite(height)
    # The field ends where the footprint says, and the box is no larger than it must be.
    assert hx - 3 * spacing < np.abs(x[inside]).max() <= hx
    assert hy - 3 * spacing < np.abs(y[inside]).max() <= hy
    assert height.min() >= 0
    for tip in shape.tips:
        x0, y0 = tip.lowest_mm
        assert shape.height_mm(np.array([x0]), np.array([y0]))[0] == 0.0
        own = tip.height_mm(x, y)
        assert own[np.isfinite(own)].max() <= tip.equator_mm + 1e-12
        # Up to the equator, but for the last cell, where a ball is steep.
        steep = tip.equator_mm - math.sqrt(4 * spacing * max(tip.equator_mm, tip.radius_mm))
        assert own[np.isfinite(own)].max() > steep
    assert shape.equator_mm == min(t.equator_mm for t in shape.tips)


@pytest.mark.parametrize("tip", TIPS, ids=lambda t: type(t).__name__)
def test_ball_of_radius_fits_inside_tip(tip: Tip) -> None:
    """What the contact solver's test of the grid relies on; and a ball of twice it does not fit."""
    r = tip.radius_mm
    d = r * np.sqrt(np.linspace(0, 1 - 1e-12, 300))[:, None]
    angle = np.linspace(0, 2 * np.pi, 241)[None]
    x, y = tip.lowest_mm
    height = tip.height_mm(x + d * np.cos(angle), y + d * np.sin(angle))
    assert np.all(height <= r - np.sqrt(r**2 - d**2) + 1e-9)
    wide = tip.height_mm(x + 2 * d * np.cos(angle), y + 2 * d * np.sin(angle))
    assert np.any(wide > 2 * r - np.sqrt((2 * r) ** 2 - (2 * d) ** 2) + 1e-9)


@pytest.mark.parametrize("tip", TIPS, ids=lambda t: type(t).__name__)
def test_volume_is_integral_of_height_field(tip: Tip) -> None:
    hx, hy = tip.half_mm
    spacing = min(hx, hy) / 250
    x, y = grid(hx, hy, spacing)
    for length_mm in (tip.equator_mm, 12.0):
        height = tip.height_mm(tip.x_mm + x, tip.y_mm + y)
        found = np.where(np.isfinite(height), length_mm - height, 0.0).sum() * spacing**2
        assert tip_mm3(tip, length_mm) == pytest.approx(found, rel=1e-3)


Drawn = tuple[tuple[float, float], list[tuple[str, tuple[tuple[float, float], ...]]]]


def _sampled(outline: Drawn, n: int = 4000) -> Field:
    """Points (m, 2) on what is drawn, as the CAD does: lines, and arcs through three points."""
    here, drawn = outline
    points = []
    for kind, goals in drawn:
        t = np.linspace(0, 1, n)[:, None]
        a, b = np.array(here), np.array(goals[-1])
        if kind == "line":
            points.append(a + t * (b - a))
        else:
            m = np.array(goals[0])
            centre = np.linalg.solve(2 * np.array([m - a, b - a]), [m @ m - a @ a, b @ b - a @ a])
            start, middle, end = (math.atan2(*(p - centre)[::-1]) for p in (a, m, b))
            way = (end - start) % (2 * math.pi)
            if (middle - start) % (2 * math.pi) > way:
                way -= 2 * math.pi
            angle = start + t * way
            radius = np.linalg.norm(a - centre)
            points.append(centre + radius * np.hstack([np.cos(angle), np.sin(angle)]))
        here = goals[-1]
    return np.vstack(points)


@pytest.mark.parametrize(
    "tip", [t for t in TIPS if isinstance(t, PrismTip)], ids=lambda t: t.points
)
def test_inset_is_distance_to_outline(tip: PrismTip) -> None:
    from scipy.spatial import cKDTree

    outline = _sampled(tip.outline())
    on = tip.inset_mm(tip.x_mm + outline[:, 0], tip.y_mm + outline[:, 1])
    assert np.abs(on).max() < 1e-9
    assert np.abs(outline).max(axis=0) == pytest.approx(tip.half_mm, abs=1e-6)
    rng = np.random.default_rng(8)
    x, y = rng.uniform(-tip.outer_mm, tip.outer_mm, (2, 4000))
    inset = tip.inset_mm(tip.x_mm + x, tip.y_mm + y)
    near = (inset > 0) & (inset < tip.corner_mm)
    assert near.sum() > 200
    found, _ = cKDTree(outline).query(np.stack([x[near], y[near]], axis=1))
    # The nearest point lies at most half a sample from one of them; the arcs bend a little more.
    half = np.linalg.norm(np.diff(outline, axis=0), axis=1).max() / 2
    assert half < 1e-3
    assert np.all(found > inset[near] - 1e-9)
    assert np.all(found <= np.sqrt(inset[near] ** 2 + half**2) * (1 + 1e-3) + 1e-9)
    # Outside, on and beside the rays through points and the middles of sides.
    angles = np.linspace(0, 2 * np.pi, 12 * tip.points, endpoint=False)
    r = np.linspace(1.02, 5, 60)[:, None] * tip.outer_mm
    far = np.stack([r * np.cos(angles), r * np.sin(angles)], axis=-1).reshape(-1, 2)
    found, _ = cKDTree(outline).query(far)
    at = tip.x_mm + far[:, 0], tip.y_mm + far[:, 1]
    assert np.abs(tip.inset_mm(*at) + found).max() < 1e-3
    assert np.all(np.isinf(tip.height_mm(*at)))
    # Further in, the face is flat, whatever the distance is.
    deep = inset >= tip.corner_mm
    found, _ = cKDTree(outline).query(np.stack([x[deep], y[deep]], axis=1))
    assert found.min() > tip.edge_mm
    # The outline itself closes.
    assert np.linalg.norm(outline[0] - outline[-1]) < 1e-12


@pytest.mark.parametrize("tip", TURNED, ids=lambda t: f"{t.rim_mm:.3g}-{t.radius_mm:.3g}")
def test_profile_matches_height_field(tip: TurnedTip) -> None:
    drawn = _sampled(tip.profile(), 500)
    d, z = drawn.T
    assert np.all(np.diff(d) >= -1e-12)
    # At the rims the sides are upright and rounding decides; a hair inside, it must agree.
    clear = (d > tip.start_mm[0] + 1e-9) & (d < tip.rim_mm - 1e-9)
    angle = np.random.default_rng(4).uniform(0, 2 * np.pi, d.shape)
    found = tip.height_mm(tip.x_mm + d * np.cos(angle), tip.y_mm + d * np.sin(angle))
    assert np.abs(found[clear] - z[clear]).max() < 1e-9
    outside = np.array([tip.rim_mm + 1e-9, tip.start_mm[0] - 1e-9])
    at = tip.height_mm(tip.x_mm + outside, np.full(2, tip.y_mm))
    assert at[0] == math.inf
    assert math.isinf(at[1]) == (tip.start_mm[0] > 0)


def test_hat_has_dome_flank_and_brim() -> None:
    hat, size_mm = parse_indenter("hat"), DEFAULT_SIZE_MM
    d = np.linspace(0, size_mm / 2 - 1e-9, 20001)
    z = hat.height_mm(np.zeros(20001), d)
    slope = np.gradient(z, d)
    crown = d < 0.275 * size_mm - 1e-3
    # No step on the way, and nothing steeper than 60 degrees before the brim's edge.
    assert np.abs(np.diff(z[:-40])).max() < 1e-3 * size_mm
    assert slope[crown].max() == pytest.approx(math.tan(math.radians(60)), rel=1e-3)
    assert np.all(np.diff(slope[crown]) > -1e-6)  # the dome runs into the flank without a kink
    brim = (d > 0.275 * size_mm + 1e-3) & (d < size_mm / 2 - 0.3)
    assert np.ptp(z[brim]) == 0.0
    assert z[brim][0] == pytest.approx(0.3 * size_mm)
    assert hat.equator_mm == pytest.approx(0.3 * size_mm + 0.3)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: PrismTip(0, 0, 5, 4.5, 2.25, edge_mm=0.5), r"edge_mm < corner_mm: 0\.5 < 0\.5"),
        (lambda: PrismTip(0, 0, 2, 4.5, 2.25), "points >= 3: 2 fails"),
        (lambda: PrismTip(0, 0, 5, 4.5, 4.2), r"inner_mm <= that of a polygon: 4\.2 <= 3\.7"),
        (lambda: PrismTip(0, 0, 5, 4.5, 0.4), r"corner_mm < inner_mm: 0\.5 < 0\.4"),
        (lambda: PrismTip(0, 0, 5, 4.5, 2.25, notch_mm=9.0), "length of a straight side"),
        (lambda: RidgeTip(0, 0, 1.0, 0.5, 7.0), r"radius_mm cos\(flank_deg\) < half_width_mm"),
        (lambda: RidgeTip(0, 0, 0.3, 1.0, 0.0), "length_mm > 0 and finite"),
        (lambda: EllipsoidTip(0, 0, -1.0, 3.0), "a_mm > 0 and finite: -1"),
        (lambda: TurnedTip.cylinder(2.0, 2.0), "edge_mm < radius_mm: 2 < 2 fails"),
        (lambda: TurnedTip.ring(3.0, 1.5), "2 tube_mm < radius_mm: 3 < 3 fails"),
        (
            lambda: TurnedTip.hat(4.5, 4.3, 2.7, 60.0, 0.3),
            r"crown_radius_mm \+ edge_mm < radius_mm",
        ),
        (lambda: TurnedTip.hat(4.5, 2.0, 3.6, 60.0, 0.3), "crown_mm < crown_radius_mm tan"),
        (lambda: TurnedTip.hat(4.5, 2.0, 0.5, 60.0, 0.3), "edge of the dome < crown_radius_mm"),
        (lambda: TurnedTip(0, 0, 0.1, (1, 0), (ProfilePiece((1, 1)),)), "d of a point < d of the"),
    ],
)
def test_invalid_dimensions_state_the_inequality(make: object, says: str) -> None:
    assert callable(make)
    with pytest.raises(ShapeError, match=says):
        make()


def test_indenter_height_is_its_lowest_tip() -> None:
    mixed = Indenter("mixed", (SphereTip(0, 0, 5.0), SphereTip(1.0, 0, 1.0)))
    x, y = np.array([0.0, 1.0, 2.5, 9.0]), np.zeros(4)
    assert mixed.height_mm(x, y) == pytest.approx([0.0, 0.0, 5 - math.sqrt(18.75), math.inf])
    assert mixed.equator_mm == 1.0
    assert mixed.footprint_half_mm == (5.0, 5.0)
