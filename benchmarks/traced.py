"""Truths of the numerics page from outside: `python -m benchmarks.traced` writes them.

Presses of `gel_strangers` (another solver's), seen through `raytraced` (another camera): motion of
the face, depth, force, two images; corners of boards; and how well `raytraced` images of a search's
patterns are tracked. Simulated, in five minutes of CPU time, into assets/traced.npz.
"""

from __future__ import annotations

import io
import json
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

from deltact_fab.common.aliases import Array
from deltact_fab.estimate import FlowTracker
from deltact_fab.fabricate import PatternRecipe, load_recipe
from deltact_fab.sensor import Checkerboard, Fisheye, Rectified, SensorDimensions
from deltact_fab.studies.numerics import traced
from deltact_fab.studies.numerics.engines.search import search_candidates
from deltact_fab.version import library_versions

from .gel_strangers import stored
from .raytraced import LAWS, Field, Imaging, Lens, Motion, Tracer, true_motion_mm

GEL, LEARN, STATES = "Q", 10, (2, 4, 5)  # straight down, and both ways aside
IMAGED = 31  # of the kept states
VIEW_MM = (15.5, 11.5)
SEED = 60
PATTERN_SEEDS = (101, 102, 103)
SKIN, BOARD = Checkerboard(23, 23, 1.5, skin=True), Checkerboard(9, 7, 3.0)
LENS_LAWS = ("equidistant", "equisolid", "stereographic", "seventh order -")
AIR_BOARDS = 6
LIBRARIES = ("numpy", "scipy", "Pillow")


@dataclass(frozen=True, eq=False)
class FaceSpline:
    """Displacement of the face, as `raytraced.Motion` gives it."""

    splines: tuple[RectBivariateSpline, ...]

    @classmethod
    def of(cls, truth: dict[str, Array], i: int) -> FaceSpline:
        u = truth["displacement_mm"][i]
        axes = truth["y_mm"], truth["x_mm"]
        return cls(tuple(RectBivariateSpline(*axes, u[..., k]) for k in range(3)))

    def __call__(self, xy_mm: Field) -> Field:
        return np.stack([f.ev(xy_mm[..., 1], xy_mm[..., 0]) for f in self.splines], axis=-1)


def presses(lens: Lens) -> dict[str, Any]:
    """States of presses, learnt from first; two images of one."""
    keys = ["tip_mm", "ball_mm", "force_n", "torque_nmm", "calibrates", "press", "shift", "depth"]
    kept: dict[str, list[Any]] = {key: [] for key in keys}
    splines, axes = [], None
    for k, (press, truth) in enumerate(stored(GEL).items()):
        inner = [np.flatnonzero(np.abs(truth[n]) <= half)
                 for n, half in zip(("y_mm", "x_mm"), reversed(VIEW_MM), strict=True)]  # fmt: skip
        axes = truth["x_mm"][inner[1]], truth["y_mm"][inner[0]]
        points = np.stack(np.meshgrid(*axes), axis=-1)
        for i in STATES:
            motion = FaceSpline.of(truth, i)
            splines.append(motion)
            shift = true_motion_mm(lens, motion, points)  # type: ignore[arg-type]
            sunk = -truth["displacement_mm"][i][np.ix_(*inner)][..., 2]
            row = (truth["tip_mm"][i], press.ball_mm, truth["force_n"][i], truth["torque_nmm"][i],
                   k < LEARN, k, traced.to_units(shift), traced.to_units(sunk))  # fmt: skip
            for key, value in zip(kept, row, strict=True):
                kept[key].append(value)
    assert axes is not None
    recipe = load_recipe("dense-with-dots").model_copy(update={"dots": None})
    imaged = splines[IMAGED]
    tracer = Tracer(recipe.patches(), recipe.printed_mm, lens)
    rng = np.random.default_rng(SEED)
    images = [jpeg(Imaging(jpeg=0).develop(tracer.light(m), rng))  # type: ignore[arg-type]
              for m in (None, imaged)]  # fmt: skip
    points = np.stack(np.meshgrid(*axes), axis=-1)
    return {
        **{key: np.array(values) for key, values in kept.items()},
        "x_mm": axes[0], "y_mm": axes[1], "imaged": np.array(IMAGED),
        "displacement": traced.to_units(imaged(points)), "rest": images[0], "pressed": images[1],
    }  # fmt: skip


def jpeg(bgr: Any) -> Array:
    """Bytes of an image with halved colours, as a USB camera sends it."""
    packed = io.BytesIO()
    Image.fromarray(bgr[..., ::-1]).save(packed, "JPEG", quality=85, subsampling=2)
    return np.frombuffer(packed.getvalue(), np.uint8)


def boards(law: str, rng: np.random.Generator) -> dict[str, Any]:
    """Corners without noise of the skin and of boards in the air; points of the view at depths."""
    lens, sensor = Lens(law=LAWS[law]), SensorDimensions()

    def plane_mm(board: Checkerboard) -> Field:
        index = np.stack(np.meshgrid(*map(np.arange, board.corners)), -1).reshape(-1, 2)
        return np.column_stack((board.at_mm(index), np.zeros(len(index))))

    flat = plane_mm(SKIN)
    px = lens.project_px(flat)
    inside = np.all((px > 6) & (px < np.array(lens.size_px) - 7), -1)
    inside &= np.all(np.abs(flat[:, :2]) < sensor.skin.opening_half_mm, -1)
    out = {"skin": np.where(inside[:, None], px, np.nan)}
    held: list[Field] = []
    while len(held) < AIR_BOARDS:
        turns = (*rng.uniform(-25, 25, 2), rng.uniform(-15, 15))
        at = Rotation.from_euler("xyz", turns, degrees=True).apply(plane_mm(BOARD))
        at += (*rng.uniform(-5, 5, 2), rng.uniform(3, 20))
        px = lens.project_px(at, 1.0)
        if at[:, 2].min() > 0.5 and np.all((px > 6) & (px < np.array(lens.size_px) - 7)):
            held.append(px)
    face = traced.view_points_mm(sensor)
    rest, slope = lens.rays(lens.project_px(np.column_stack((face, np.zeros(len(face))))))
    for depth_mm in traced.LENS_DEPTHS_MM:
        at = np.column_stack((rest - depth_mm * slope, np.full(len(face), -depth_mm)))
        out[f"points_{depth_mm:g}"] = at
        out[f"px_{depth_mm:g}"] = lens.project_px(at)
    return {f"{law} {key}": value for key, value in {**out, "air": np.array(held)}.items()}


def tracked_mm(recipe: PatternRecipe, seed: int, lens: Lens, view: Rectified) -> float:
    """Mean error of the default tracker on a steep drag of traced images."""
    recipe = recipe.model_copy(update={"seed": seed})
    tracer = Tracer(recipe.patches(), recipe.printed_mm, lens)
    rng = np.random.default_rng(seed)
    motion = Motion(press_mm=2.0, drag_mm=(2.0, 0.6), twist_rad=0.05, dent_mm=2.0, reach_mm=2.4)
    tracker, camera = FlowTracker(), Imaging()
    for k in range(13):
        moved = motion.share(k / 12) if k else None
        estimate = tracker.update(view.rectify(camera.develop(tracer.light(moved), rng)))
    y, x = np.mgrid[20 : view.height_px - 20 : 12, 20 : view.width_px - 20 : 12]
    points = np.stack((x, y), -1) - np.asarray(view.centre_px)
    truth = true_motion_mm(lens, motion, points * view.mm_per_px)
    off = np.linalg.norm(estimate.flow_px[y, x] * view.mm_per_px - truth, axis=-1)
    moves = np.linalg.norm(truth, axis=-1) > 0.1
    return float(off[moves].mean())


def main() -> None:
    lens = Lens()
    view = Rectified.from_sensor(SensorDimensions(), Fisheye(f_px=lens.f_px))
    rng = np.random.default_rng(SEED)
    data = {} if "--patterns" in sys.argv else presses(lens)
    for law in LENS_LAWS if data else ():
        data |= boards(law, rng)
    if "--patterns" in sys.argv:  # these alone anew
        data = {key: value for key, value in traced.load().items() if key != "head"}
    errors = {}
    for name, recipe in search_candidates().items():
        errors[name] = float(np.mean([tracked_mm(recipe, s, lens, view) for s in PATTERN_SEEDS]))
        print(f"{name}: {errors[name]:.5f} mm", flush=True)
    head = {"simulated": True, "scripts": "benchmarks.traced", "patterns_mm": errors,
            "versions": library_versions(LIBRARIES)}  # fmt: skip
    np.savez_compressed(traced.path(), head=np.array(json.dumps(head)), **data)


if __name__ == "__main__":
    main()
