"""What a calibration measures on gels that it does not believe in.

`python -m benchmarks.strangers` prints the table, in five CPU minutes.
Truth: gel_strangers.npz, presses by a solver that shares no line with the product's. The camera is
the product's pinhole and the flow is the projected displacement with noise: no tracker, no images.
Ten presses calibrate, as a lab would, and the others of that gel judge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from deltact_fab.aliases import Array
from deltact_fab.analysis.force import ForceData
from deltact_fab.analysis.force.gel import (
    EarlyLabels,
    ToldGel,
    early_labels,
    search,
    squared_errors,
)
from deltact_fab.cad.design import load_design
from deltact_fab.measure.face import FaceFlow
from deltact_fab.measure.force import Features, ForceModel
from deltact_fab.measure.force.inverse import Inverse
from deltact_fab.measure.shape import DepthFinder, DepthModel, contacts
from deltact_fab.measure.shape.depth import ball_mm
from deltact_fab.measure.view import SensorView
from deltact_fab.optics import Pinhole
from deltact_fab.shapes import SkinDimensions

from .force_truth import flows_of
from .gel_strangers import SEED, STRANGERS, Press, stored

NOISE_PX = 0.05  # alike over a millimetre; the tracker's own on rendered images is less
LEARN = 10  # presses
MARGIN = stdtrit(LEARN - 1, 0.975) * np.sqrt(1 + 1 / LEARN)  # of the error told: 95 %
CONTACT = 0.05  # of the peak pressure: where there is a contact
BELIEVED = SensorView(Pinhole.of(load_design("deltact")), SkinDimensions(), 0.49)


@dataclass(frozen=True)
class Seen:
    """The presses of a stranger's gel as a camera and a force sensor see them."""

    truth: dict[Press, dict[str, Array]]
    flows: dict[Press, list[FaceFlow]]

    @classmethod
    def of(cls, stranger: str, noise_px: float = NOISE_PX) -> Seen:
        truth = stored(stranger)
        rng = np.random.default_rng(SEED)
        return cls(
            truth, {p: flows_of(t, BELIEVED.camera, noise_px, rng) for p, t in truth.items()}
        )

    def wrench(self, press: Press) -> Array:
        """(n, 6)."""
        return np.column_stack((self.truth[press]["force_n"], self.truth[press]["torque_nmm"]))

    @cached_property
    def presses(self) -> list[Press]:
        return list(self.truth)

    def told(self, use: list[Press]) -> ToldGel | None:
        """The gel that some presses tell."""
        names = np.repeat(np.arange(len(use)), [len(self.flows[p]) for p in use])
        flows = [flow for p in use for flow in self.flows[p]]
        wrench = np.concatenate([self.wrench(p) for p in use])
        return search(BELIEVED, squared_errors(flows, wrench, names, names))


EARLY = EarlyLabels(0.05, 3.0)
WAITS_S = (0.0, 30.0)


def figures(seen: Seen, view: SensorView, labels: str = "late") -> dict[str, Any]:
    """Ten presses calibrate a view, the others judge; and each of the ten left out in turn.

    labels: "late"; "early", every second press's taken at once, and so EARLY.share too high; or
    "mended", the same as `early_labels` mends them.
    """
    features = Inverse(view)
    X = {p: np.array([features.of(flow) for flow in seen.flows[p]]) for p in seen.presses}
    wrench = {p: seen.wrench(p) for p in seen.presses}
    label = dict(wrench)
    if labels != "late":
        label |= {p: wrench[p] * (1 + EARLY.share) for p in seen.presses[::2]}
    if labels == "mended":
        learn = seen.presses[:LEARN]
        of = np.repeat(np.arange(LEARN), [len(X[p]) for p in learn])
        wait_s = np.where(of % 2, WAITS_S[1], WAITS_S[0])
        points = pd.DataFrame({"press": of, "position": of, "wait_s": wait_s})
        known, numbers = (np.concatenate([of_press[p] for p in learn]) for of_press in (label, X))
        sets: dict[str, Features] = {features.name: features}
        data = ForceData(points, known, {features.name: numbers}, sets, [])
        found = early_labels(data)
        if found is not None:
            mended = found.mended(data).wrench
            label |= {p: mended[of == i] for i, p in enumerate(learn)}

    def model(use: list[Press]) -> ForceModel:
        numbers, labels = (np.concatenate([of[p] for p in use]) for of in (X, label))
        return ForceModel.fit(features, numbers, labels)[0]

    learn, judge = seen.presses[:LEARN], seen.presses[LEARN:]
    held = np.concatenate(
        [model([q for q in learn if q != p]).predict(X[p]) - label[p] for p in learn]
    )
    whole = model(learn)
    off = np.concatenate([whole.predict(X[p]) - wrench[p] for p in judge])
    told, true = (np.sqrt((e[:, :3] ** 2).mean(axis=0)) for e in (held, off))
    span = np.ptp(np.concatenate([wrench[p] for p in seen.presses])[:, :3], axis=0)
    finder = DepthFinder(view, DepthModel(_gain(seen, view, learn[0]), 20.0))
    rows = [
        _fields(finder, features, whole, flow, seen.truth[p], i)
        for p in judge for i, flow in enumerate(seen.flows[p])
    ]  # fmt: skip
    place, pressure, depth = np.nanmean(np.array(rows), axis=0)
    return {
        "judged": len(judge), "states": len(off), "range_n": span,
        "told_n": told, "true_n": true, "worst_normal_n": float(np.abs(off[:, 2]).max()),
        "shear_percent": float(100 * (true[:2] / span[:2]).max()),
        "held": float((np.abs(off[:, :3]) <= MARGIN * told).mean()),
        "place_mm": float(place), "pressure_of_peak": float(pressure),
        "depth_mm": float(depth), "gain": finder.model.gain,
    }  # fmt: skip


def _gain(seen: Seen, view: SensorView, press: Press) -> float:
    """As `calibrate-depth` finds it, of the deepest straight state of a press."""
    flow, tip = seen.flows[press][2], seen.truth[press]["tip_mm"][2] * [1, 1, -1]
    wanted = ball_mm(flow, view, tip, press.ball_mm / 2)
    sure = wanted > -0.4 * tip[2]
    found = DepthFinder(view, DepthModel(1.0, 20.0)).of(flow).depth_mm[sure]
    return float(found @ wanted[sure] / (found @ found))


def _fields(
    finder: DepthFinder, features: Inverse, model: ForceModel, flow: FaceFlow,
    truth: dict[str, Array], i: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Errors of place (mm), pressure (of its peak) and depth (mm, over the contact)."""
    found = contacts(finder.of(flow), flow, finder.view.camera)
    place = np.hypot(*(found[0].place_mm - truth["tip_mm"][i, :2])) if found else np.nan
    field = features.traction(flow, model)
    true = binned(truth["points"][i], field.x_mm, field.y_mm)
    peak = -true[..., 2].min()
    touched = -true[..., 2] > CONTACT * peak
    pressure = np.abs(field.traction_mpa - true)[touched][:, 2].mean() / peak
    inverse = features.inverse
    cells = binned(truth["points"][i], inverse.seen_x_mm, inverse.seen_y_mm)[..., 2]
    seen = (("y_mm", inverse.seen_y_mm), ("x_mm", inverse.seen_x_mm))
    at = np.ix_(*(np.abs(truth[k][:, None] - c).argmin(axis=0) for k, c in seen))
    z = finder.inverse.displacement_mm(inverse.of(flow), (2,))[..., 0] * finder.model.gain
    below = -cells > CONTACT * peak
    depth = np.abs(z - truth["displacement_mm"][i][..., 2][at])[below].mean()
    return float(place), float(pressure), float(depth)


def binned(points: Array, x_mm: Array, y_mm: Array) -> Array:
    """Mean traction (ny, nx, 3) of cells, each point's spread over a square of its area."""
    area = (x_mm[1] - x_mm[0]) * (y_mm[1] - y_mm[0])
    half = np.sqrt(points[:, 5]) / 2
    shares = []
    for at, centres in ((points[:, 1], y_mm), (points[:, 0], x_mm)):
        step = (centres[1] - centres[0]) / 2
        low = np.clip(centres[:, None] - step, at - half, at + half)
        high = np.clip(centres[:, None] + step, at - half, at + half)
        shares.append((high - low) / (2 * half))
    return np.asarray(
        np.einsum("yp,xp,pi,p->yxi", *shares, points[:, 2:5], points[:, 5], optimize=True) / area
    )


def main() -> None:
    """The table, as markdown; simulated."""
    head = ("gel", "believed", "normal, N (told; worst)", "range", "shear, %", "in the interval",
            "place, mm", "pressure, of its peak", "depth, mm (gain)")  # fmt: skip
    print(f"| {' | '.join(head)} |", "|---" * len(head) + "|", sep="\n")
    for name, (gel, _) in STRANGERS.items():
        seen = Seen.of(name)
        told = seen.told(seen.presses[:LEARN])
        print(f"<!-- {name}: Poisson's ratio {gel.poisson}, {gel.size_mm[2]} mm: "
              f"{told.line if told else 'nothing is told'} -->")  # fmt: skip
        views = {"the design": BELIEVED} | (
            {"what ten presses tell": told.view(BELIEVED)} if told else {}
        )
        labels = {"late": "", "early": ", every second label 5 % high", "mended": ", these mended"}
        for what, view in views.items():
            for kind, more in labels.items():
                f = figures(seen, view, kind)
                print(
                    f"| {name} | {what}{more} | {f['true_n'][2]:.3f} ({f['told_n'][2]:.3f}; "
                    f"{f['worst_normal_n']:.2f}) | {f['range_n'][2]:.1f} | "
                    f"{f['shear_percent']:.2f} | {f['held']:.0%} | "
                    f"{f['place_mm']:.2f} | {f['pressure_of_peak']:.2f} | "
                    f"{f['depth_mm']:.3f} ({f['gain']:.2f}) |",
                    flush=True,
                )  # fmt: skip


if __name__ == "__main__":
    main()
