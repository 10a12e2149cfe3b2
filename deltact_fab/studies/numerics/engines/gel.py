"""The gel at its levels: error of force and displacement against run time.

Truths are presses of other solvers, stored with the package. The linear level's error is its
model's, whatever its grid. The map is of the command `gel press` as it is: within its stated error
of an outside answer, flagged, or refused with its cause.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from deltact_fab.common import Field, Point2, RunFailed, read_json, validate
from deltact_fab.paths import asset
from deltact_fab.physics import (
    FORCE_TOLERANCE,
    GelLevel,
    Increments,
    ObservedChannels,
    PressOutcome,
    choose_level,
    open_path,
    press_gel,
)
from deltact_fab.sensor import (
    GelMaterial,
    Indenter,
    PosedTip,
    SkinDimensions,
    SphereTip,
    parse_indenter,
)

from ..engine import Case, CurveSetting, Engine, Flagged, Work

TRUTH_MPA = 0.56  # definition: modulus of the stored truths
CURVE_TOLERANCES = 0.1, FORCE_TOLERANCE, 0.01  # by hand: looser and tighter than the default


# -- curves --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TruePress:
    """A press in the middle of a block, with the force and field of an independent solver.

    side_mm: of the block, in x and y. shear_mm: drag along x after the press. error_rel: of
    the truth's force. radial_mm: displacement at radii RADII_STEP_MM apart; empty: not known.
    solver: of the truth.
    """

    indenter: str
    poisson: float
    friction: float
    side_mm: tuple[float, float]
    thickness_mm: float
    depth_mm: float
    force_n: tuple[float, float, float]
    error_rel: float
    solver: str
    shear_mm: float = 0.0
    radial_mm: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        drag = f", dragged {self.shear_mm:g} mm" if self.shear_mm else ""
        return (
            f"{self.indenter} pressed {self.depth_mm:g} mm into {self.thickness_mm:g} mm, nu "
            f"{self.poisson:g}, friction {self.friction:g}{drag}"
        )

    def solve(self, **options: Any) -> PressOutcome:
        """Press like `gel press`; options: of `press_gel`. Raises RunFailed where it refuses."""
        skin = self.skin()
        gel = GelMaterial(TRUTH_MPA, self.poisson, friction=self.friction)
        shear = self.shear_mm, 0.0
        press = press_gel(
            skin, gel, parse_indenter(self.indenter), (0.0, 0.0), self.depth_mm, shear, **options
        )
        if press.result["force_n"] is None:
            raise RunFailed(f"{self.name}: {press.result['reason']}")
        return press

    def skin(self, protrusion_mm: float | None = None) -> SkinDimensions:
        """Block of the press. protrusion_mm: out of its frame; None: all of it."""
        h = self.thickness_mm
        return SkinDimensions(*self.side_mm, h, min(2.0, h / 2), protrusion_mm or h)

    def force_percent(self, press: PressOutcome, modulus_mpa: float = TRUTH_MPA) -> float:
        """Error of the force, % of its size; forces are in proportion to the modulus."""
        truth = np.array(self.force_n) * (modulus_mpa / TRUTH_MPA)
        error_n = np.array(press.result["force_n"]) - truth
        return 100 * float(np.linalg.norm(error_n) / np.linalg.norm(truth))

    def in_plane_mm(self, press: PressOutcome) -> float:
        """Error of the in-plane displacement, rms over the face.

        Within a thickness of the sides, where a block is no cylinder, nothing counts as error.
        """
        x, y = np.meshgrid(press.x_mm, press.y_mm)
        r, radii_mm = np.hypot(x, y), RADII_STEP_MM * np.arange(len(self.radial_mm))
        radial = np.interp(r, radii_mm, self.radial_mm) / np.maximum(r, 1e-12)
        error_mm = press.displacement_mm[..., :2] - radial[..., None] * np.stack([x, y], axis=-1)
        inner = r <= min(self.side_mm) / 2 - self.thickness_mm
        return rms_mm(error_mm * inner[..., None])


RADII_STEP_MM = 0.25  # definition: of the stored truths


def load_truths() -> list[TruePress]:
    """Stored answers of solvers that share no line with the gel; see the file for their scripts."""
    path = asset("gel_truths.json")
    return [validate(TruePress, row, str(path)) for row in read_json(path)["presses"]]


def rms_mm(vectors_mm: Field) -> float:
    """Root mean square length of in-plane vectors (ny, nx, 2)."""
    return math.sqrt(float((vectors_mm**2).sum(axis=-1).mean()))


def curves() -> Sequence[CurveSetting]:
    """`gel press` by tolerance, and its linear level by grid, on presses of other solvers.

    In plane for the first press. The tightest tolerance, which takes minutes with friction and
    under flats, for balls without.
    """
    settings = []
    for k, truth in enumerate(load_truths()):
        ball = truth.indenter.startswith("sphere")
        tolerances = CURVE_TOLERANCES[: 3 if ball and not truth.friction else 2]
        options: list[dict[str, Any]] = [{"tolerance": t} for t in tolerances]
        if ball and not truth.shear_mm:
            options += [{"model": "linear", "spacing_mm": h} for h in (0.5, 0.25)]
        for option in options:
            settings.append(_setting(truth, option, "% of the force", TruePress.force_percent))
        for option in options if k == 0 else ():
            settings.append(_setting(truth, option, "mm rms over the face", TruePress.in_plane_mm))
    return settings + _place_settings()


PLACES_MM = ((0.0, 0.0), (4.0, 3.0), (-5.0, 2.0), (-3.0, -6.0), (6.0, -4.0))
"""By hand: of presses beside the one with a truth."""
PLACED_UNKNOWNS = (4000, 8000)  # by hand: below and at the virtual rig's


def _place_settings() -> list[CurveSetting]:
    """Presses of one ball at six places: solved at each, and from one table."""
    default = ("hyperelastic", PLACED_UNKNOWNS[-1])
    return [
        CurveSetting(
            f"{len(PLACES_MM) + 1} presses of a ball at places: force off the middle", level,
            f"{unknowns} unknowns", "% of the force", "3D, benchmarks.gel_places", 0.0,
            partial(_presses_at_places, level, unknowns), "independent solver",
            (level, unknowns) == default,
        )
        for level in ("hyperelastic", "tabulated") for unknowns in PLACED_UNKNOWNS
    ]  # fmt: skip


def _presses_at_places(level: GelLevel, unknowns: int, scratch: Path) -> Work:
    row = read_json(asset("gel_truths.json"))["placed"]
    gel = GelMaterial(TRUTH_MPA, row["poisson"], friction=row["friction"])
    skin, tip = SkinDimensions(thickness_mm=row["thickness_mm"]), parse_indenter(row["indenter"])
    depth = row["depth_mm"]

    def press(x: float, y: float) -> Field:
        corners = [(x, y, 0.0), (x, y, -depth)]
        straight = Increments(depth, depth).poses(corners)
        choice = choose_level(skin, gel, tip, straight, level=level, observe_shear=False,
                              most_unknowns=unknowns)  # fmt: skip
        poses = Increments(choice.step_mm, choice.step_mm).poses(corners)
        observed = ObservedChannels(fields="last")
        *_, last = open_path(skin, gel, tip, poses, observed, choice).solve_all()
        return TRUTH_MPA * np.array(last.force_n)

    def error(forces: list[Field]) -> float:
        truth = np.array(row["force_n"])
        return 100 * float(np.linalg.norm(forces[0] - truth) / np.linalg.norm(truth))

    places = [row["place_mm"], *PLACES_MM]
    return Work(lambda: [press(*place) for place in places], error)


def _setting(
    truth: TruePress, options: dict[str, Any], unit: str,
    error: Callable[[TruePress, PressOutcome], float],
) -> CurveSetting:  # fmt: skip
    linear = "model" in options
    force = unit.startswith("%")
    return CurveSetting(
        f"{truth.name}: {'force' if force else 'in plane'}",
        "linear" if linear else "by tolerance, error estimate included",
        f"{options['spacing_mm']:g} mm" if linear else f"tolerance {options['tolerance']:g}",
        unit, truth.solver, 100 * truth.error_rel if force else 0.0,
        partial(_build, truth, options, error), "independent solver",
        options.get("tolerance") == FORCE_TOLERANCE,
    )  # fmt: skip


def _build(
    truth: TruePress, options: dict[str, Any], error: Callable[[TruePress, PressOutcome], float],
    scratch: Path,
) -> Work:  # fmt: skip
    return Work(partial(truth.solve, **options), partial(error, truth))


# -- the map ---------------------------------------------------------------------------------------

EXTREME_VALUES: dict[str, tuple[float, ...]] = {
    "poisson": (0.0, 0.2, 0.4, 0.45, 0.49, 0.495, 0.499, 0.4999),
    "depth_share": (0.001, 0.01, 0.1, 0.25, 0.5, 0.75, 0.95),
    "thickness_mm": (0.8, 1.5, 3.0, 6.0, 12.0, 20.0),
    "sphere": (0.6, 1.5, 3.0, 6.0, 10.0, 20.0, 30.0),
    "cylinder": (6.0, 10.0, 20.0),
    "friction": (0.0, 0.1, 0.5, 1.0, 2.0),
    "drag_mm": (0.25, 1.0, 3.0),
    "modulus_mpa": (0.001, 0.1, 10.0, 100.0),
}
"""By hand: what a lab's gels and tips have, and beyond; diameters of tips, mm."""
EXTREME_SHAPES = "sphere:10", "cylinder:8", "edges", "hexprism", "star", "4dots", "pair 1 mm apart"
EXTREME_POSES: dict[str, dict[str, Any]] = {
    "level": {}, "tilted 10": {"tilt_deg": 10.0}, "tilted 40": {"tilt_deg": 40.0},
    "at x 15": {"at_mm": (15.0, 0.0)}, "over the rim": {"at_mm": (18.0, 0.0)},
}  # fmt: skip
DEEP_PRESSES = {"5 mm": (5.0, 0.0), "10 mm": (10.0, 0.0), "5, dragged 3": (5.0, 3.0)}
"""By hand: depth and drag, mm."""
LEAST_SIDE_MM = 5.0  # definition: of `SkinDimensions`
FULL_STICK = 2.0  # definition: a friction coefficient at which nothing slips
CELL_LIMIT_S = 15.0  # by hand: CPU time of a press; the command's own limit is eight times as long
PAIR_BALL_MM = 3.0  # by hand: radius of the tips of a pair
LARGEST_TOLERANCE = 100 * FORCE_TOLERANCE


@dataclass(frozen=True)
class ExtremePress:
    """Cell of the map. outside: whether the force of the press is an outside answer.

    causes: words of a refusal, separated by "|". tilt_deg: about y, of a single tip.
    """

    chart: str
    row: str
    column: str
    press: TruePress
    causes: str
    outside: bool = False
    modulus_mpa: float = TRUTH_MPA
    at_mm: Point2 = (0.0, 0.0)
    tilt_deg: float = 0.0
    protrusion_mm: float | None = None

    @property
    def name(self) -> str:
        return f"{self.chart.partition(':')[0]}: {self.row}, {self.column}"

    def indenter(self) -> Indenter:
        """Tip of the press, tilted about y."""
        name = self.press.indenter
        if name.startswith("pair"):
            x_mm = 0.5 * float(name.split()[1])
            return Indenter(name, tuple(SphereTip(x, 0.0, PAIR_BALL_MM) for x in (-x_mm, x_mm)))
        shape = parse_indenter(name)
        if not self.tilt_deg:
            return shape
        tips = (tip if isinstance(tip, PosedTip) else PosedTip(tip, 0.0, 0.0) for tip in shape.tips)
        tilted = tuple(replace(tip, tilt_y_deg=self.tilt_deg) for tip in tips)
        return Indenter(f"{name}, tilted", tilted)

    def check(self, scratch: Path) -> tuple[float, str]:
        """Error of the force over what is stated; without an outside answer what is stated, %."""
        p = self.press
        skin = p.skin(self.protrusion_mm)
        gel = GelMaterial(self.modulus_mpa, p.poisson, friction=p.friction)
        outcome = press_gel(
            skin, gel, self.indenter(), self.at_mm, p.depth_mm, (p.shear_mm, 0.0),
            limit_s=CELL_LIMIT_S,
        )  # fmt: skip
        result = outcome.result
        if result["force_n"] is None:
            raise RunFailed(result["reason"])
        stated = 100 * result["error_estimate"]["force_rel"]
        note = f"stated {stated:.2g} %"
        if self.outside:
            error = p.force_percent(outcome, self.modulus_mpa)
            note = f"off by {error:.2g} %, {note}, {p.solver}"
        if not result["within_tolerance"]:
            limited = any(flag.startswith("limit") for flag in result["flags"])
            reason = f"--limit-s {CELL_LIMIT_S:g}" if limited else "not within tolerance"
            raise Flagged(f"flagged: {reason}; {note}")
        return (error / (stated + 100 * p.error_rel), note) if self.outside else (stated, note)


def wide_side_mm(thickness_mm: float, contact_mm: float) -> float:
    """Side of a block so wide that its shape does not matter."""
    return max(LEAST_SIDE_MM, round(2 * (2.5 * thickness_mm + contact_mm), 1))


def wide_press(
    indenter: str, poisson: float, friction: float, thickness_mm: float, depth_mm: float
) -> TruePress:
    """Press in the middle of a wide block; its force is unknown."""
    kind, _, size = indenter.partition(":")
    radius = float(size) / 2
    contact = math.sqrt(radius * depth_mm) if kind == "sphere" else radius
    side = wide_side_mm(thickness_mm, contact)
    return TruePress(
        indenter, poisson, friction, (side, side), thickness_mm, depth_mm, (0.0, 0.0, 0.0), 0.0,
        "axisymmetric, benchmarks.gel_axisymmetric",
    )  # fmt: skip


def wide_cells() -> Iterator[ExtremePress]:
    """Cells whose truth an axisymmetric solver can give."""
    chart = "Poisson's ratio and depth: sphere:10, 12 mm of gel, no friction"
    for nu in EXTREME_VALUES["poisson"]:
        for share in EXTREME_VALUES["depth_share"]:
            press = wide_press("sphere:10", nu, 0.0, 12.0, round(12 * share, 4))
            yield ExtremePress(chart, f"{nu:g}", f"{share:.1%}", press, "poisson|deep|depth")
    for kind in ("sphere", "cylinder"):
        chart = f"{kind.capitalize()}s by thickness: full stick, 10 % of the gel or 20 % of the tip"
        for h in EXTREME_VALUES["thickness_mm"]:
            for size in EXTREME_VALUES[kind]:
                depth = round(min(0.1 * h, 0.2 * size), 4)
                press = wide_press(f"{kind}:{size:g}", 0.48, FULL_STICK, h, depth)
                yield ExtremePress(chart, f"{h:g} mm of gel", f"{size:g} mm", press,
                                   "thick|mm wide|cells|deep")  # fmt: skip


def _other_cells() -> Iterator[ExtremePress]:
    """Cells on the standard block: materials, drags, shapes and poses."""
    truths = load_truths()
    for modulus in EXTREME_VALUES["modulus_mpa"]:
        yield ExtremePress("Modulus: a press of the curves", truths[0].indenter, f"{modulus:g} MPa",
                           truths[0], "modulus", True, modulus)  # fmt: skip
    base = truths[-1]
    for friction in EXTREME_VALUES["friction"]:
        for drag in EXTREME_VALUES["drag_mm"]:
            press = replace(base, friction=friction, shear_mm=drag)
            true = stored_extremes()["drags"].get(f"{friction:g}, {drag:g}")
            if true is not None:
                press = replace(press, force_n=tuple(true))
            yield ExtremePress(
                f"Friction and drag: {base.indenter}, {base.depth_mm:g} mm deep",
                f"friction {friction:g}", f"{drag:g} mm", press, "drag|friction|slip",
                true is not None, protrusion_mm=6.0,
            )  # fmt: skip
    for shape in EXTREME_SHAPES:
        for pose, options in EXTREME_POSES.items():
            press = replace(base, indenter=shape, depth_mm=1.0, friction=0.5, shear_mm=0.0)
            cell = ExtremePress("Shapes and poses: 1 mm deep in 12 mm", shape, pose, press,
                                "rim|tilt|edge|deep in", protrusion_mm=6.0)  # fmt: skip
            if "tilt_deg" not in options or len(cell.indenter().tips) == 1:
                yield replace(cell, **options)
        for name, (depth, drag) in DEEP_PRESSES.items():
            deep = replace(press, depth_mm=depth, shear_mm=drag)
            yield ExtremePress("Shapes, deep: in 12 mm, friction 0.5", shape, name, deep,
                               "gel|converge|depth|deep", protrusion_mm=6.0)  # fmt: skip


@functools.cache
def stored_extremes() -> dict[str, Any]:
    """Stored forces: wide {cell: [N, relative error]}, drags {friction, drag: force}."""
    stored: dict[str, Any] = read_json(asset("gel_truths.json"))["extremes"]
    return stored


def extremes() -> Sequence[Case]:
    """`gel press` over the ranges of gels, tips, depths and poses, and beyond."""
    cells = []
    for cell in wide_cells():
        normal_n, error_rel = stored_extremes()["wide"].get(cell.name, (None, 0.0))
        if normal_n is not None:
            press = replace(cell.press, force_n=(0.0, 0.0, -normal_n), error_rel=error_rel)
            cell = replace(cell, press=press, outside=True)
        cells.append(cell)
    return [
        Case(cell.name, "right or refused", cell.check, 1.0 if cell.outside else LARGEST_TOLERANCE,
             "of what is stated" if cell.outside else "% stated", f"flagged|{cell.causes}",
             (cell.chart, cell.row, cell.column), cell.outside)
        for cell in (*cells, *_other_cells())
    ]  # fmt: skip


def _refused(indenter: str, poisson: float, depth_mm: float, scratch: Path) -> float:
    """Press that must be refused; NaN if it is not."""
    replace(wide_press(indenter, poisson, 0.0, 12.0, 1.0), depth_mm=depth_mm).solve()
    return math.nan


def cases(quick: bool) -> Sequence[Case]:
    """Numbers that are none."""
    refused: dict[str, tuple[str, float, float, str]] = {
        "depth NaN": ("sphere:10", 0.49, math.nan, "expected a depth"),
        "nu 0.5": ("sphere:10", 0.5, 1.0, "poisson"),
        "a ball of 0.3 mm": ("sphere:0.3", 0.49, 0.1, "0.5 to 30"),
        "deeper than the gel": ("sphere:10", 0.49, 13.0, "thick"),
    }
    return [
        Case(name, "refused", partial(_refused, tip, poisson, depth_mm), says=says)
        for name, (tip, poisson, depth_mm, says) in refused.items()
    ] + [Case("a press of the curves", "right", _first_press, 1.0, "of what is stated")]


def _first_press(scratch: Path) -> float:
    """Error of the force over what is stated."""
    truth = load_truths()[0]
    press = truth.solve()
    return truth.force_percent(press) / (100 * press.result["error_estimate"]["force_rel"])


ENGINE = Engine(
    "Gel", "The command gel press against presses of independent solvers.", cases, curves, extremes
)
