"""What a calibration measures on gels that it does not believe in.

`python -m benchmarks.strangers` prints the table, in a quarter of an hour of CPU time.
Truth: gel_strangers.npz, presses by a solver that shares no line with the product's. The camera is
the product's pinhole and the flow is the projected displacement with noise: no tracker, no images.
Ten presses calibrate, as a lab would, and six others of that gel judge, till each has judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from deltact_fab.common.aliases import Array
from deltact_fab.estimate.analysis.force.dataset import ForceData
from deltact_fab.estimate.analysis.force.gel import (
    IdentifiedGel,
    UnrelaxedForces,
    error_function,
    fit_unrelaxed,
    search_gel,
)
from deltact_fab.estimate.analysis.force.judge import fit_force, predict_left_out
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.force.inverse import Inverse
from deltact_fab.estimate.measure.force.model import Features, ForceModel
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.estimate.measure.shape.depth import (
    DepthFinder,
    DepthModel,
    ball_depth_mm,
    find_contacts,
)
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.sensor.optics.camera import Pinhole
from deltact_fab.sensor.shapes.sensor import SkinDimensions

from .force_truth import flows_of
from .gel_strangers import SEED, STRANGERS, Press, stored

NOISE_PX = 0.05  # alike over a millimetre; the tracker's own on rendered images is less
LEARN = 10  # presses
MARGIN = stdtrit(LEARN - 1, 0.975) * np.sqrt(1 + 1 / LEARN)  # of the error told: 95 %
CONTACT = 0.05  # of the peak pressure: where there is a contact
BELIEVED = SensorModel(Pinhole.from_sensor(load_design("deltact")), SkinDimensions(), 0.49)


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

    def data(self, use: Sequence[Press], view: SensorModel, early: bool = False) -> ForceData:
        """The points of presses as `calibrate force` has them.

        early: the labels of every second press were taken at once, and so are EARLY.share too high.
        """
        features: Features = Inverse(view)
        of = np.repeat(np.arange(len(use)), [len(self.flows[p]) for p in use])
        wait_s = np.where(of % 2, WAITS_S[1], WAITS_S[0])
        wrench = np.concatenate([self.wrench(p) for p in use])
        if early:
            wrench *= 1 + EARLY.share * np.exp(-wait_s / EARLY.time_s)[:, None]
        X = np.array([features.compute(flow) for p in use for flow in self.flows[p]])
        points = pd.DataFrame({"press": of, "position": of, "wait_s": wait_s})
        return ForceData(points, wrench, {features.name: X}, {features.name: features}, [])

    def rounds(self) -> Iterator[tuple[list[Press], list[Press]]]:
        """LEARN presses to calibrate on and others to judge by, till each has judged once."""
        presses = list(self.truth)
        for first in range(0, len(presses), len(presses) - LEARN):
            judge = presses[first : first + len(presses) - LEARN]
            yield [*presses[first + len(judge) :], *presses[:first]][:LEARN], judge

    def told(self, learn: Sequence[Press], labels: str = "late") -> IdentifiedGel | None:
        """The gel that presses tell; labels: as of `judged`."""
        data = self.data(learn, BELIEVED, labels != "late")
        found = fit_unrelaxed(data) if labels == "mended" else None
        flows = [flow for p in learn for flow in self.flows[p]]
        return search_gel(
            BELIEVED, error_function(flows, found.relaxed_wrenches(data) if found else data)
        )


EARLY = UnrelaxedForces(0.05, 3.0)
WAITS_S = (0.0, 30.0)


@dataclass(frozen=True)
class Judged:
    """off_n (n, 3): errors of the judged states; told_n (3,): of each that learnt, left out.
    fields (n, 3): errors of place (mm), pressure (of its peak) and depth (mm, over the contact)."""

    off_n: Array
    told_n: Array
    fields: Array
    gain: float


def judged(
    seen: Seen, learn: Sequence[Press], judge: Sequence[Press], gel: IdentifiedGel | None,
    labels: str = "late",
) -> Judged:  # fmt: skip
    """Some presses calibrate with a gel (None: the design's), the others judge.

    labels: "late"; "early", see `Seen.data`; or "mended", the same as `fit_unrelaxed` mends them.
    """
    view = BELIEVED if gel is None else BELIEVED.with_gel(gel.poisson, gel.thickness_mm)
    data = seen.data(learn, view, labels != "late")
    found = fit_unrelaxed(data) if labels == "mended" else None
    data = found.relaxed_wrenches(data) if found else data
    held = predict_left_out(data, Inverse.name, "position")[0] - data.wrench
    model, features = fit_force(data, Inverse.name), Inverse(view)
    true = seen.data(judge, view)
    off = model.predict(true.features[Inverse.name]) - true.wrench
    finder = DepthFinder(view, DepthModel(_gain(seen, view, learn[0]), 20.0))
    fields = [
        _fields(finder, features, model, flow, seen.truth[p], i)
        for p in judge for i, flow in enumerate(seen.flows[p])
    ]  # fmt: skip
    told_n = np.sqrt((held[:, :3] ** 2).mean(axis=0))
    return Judged(off[:, :3], told_n, np.array(fields), finder.model.gain)


def figures(seen: Seen, rounds: Sequence[Judged]) -> dict[str, Any]:
    """Of rounds together."""
    off = np.concatenate([one.off_n for one in rounds])
    span = np.ptp(np.concatenate([seen.wrench(p) for p in seen.truth])[:, :3], axis=0)
    true = np.sqrt((off**2).mean(axis=0))
    inside = [np.abs(one.off_n) <= MARGIN * one.told_n for one in rounds]
    place, pressure, depth = np.nanmean(np.concatenate([one.fields for one in rounds]), axis=0)
    return {
        "states": len(off), "range_n": float(span[2]), "normal_n": float(true[2]),
        "told_n": float(np.mean([one.told_n[2] for one in rounds])),
        "worst_n": float(np.abs(off[:, 2]).max()),
        "shear_percent": float(100 * (true[:2] / span[:2]).max()),
        "held": float(np.concatenate(inside).mean()),
        "place_mm": float(place), "pressure_of_peak": float(pressure), "depth_mm": float(depth),
        "gains": (min(one.gain for one in rounds), max(one.gain for one in rounds)),
    }  # fmt: skip


def _gain(seen: Seen, view: SensorModel, press: Press) -> float:
    """As `calibrate depth` finds it, of the deepest straight state of a press."""
    flow, tip = seen.flows[press][2], seen.truth[press]["tip_mm"][2] * [1, 1, -1]
    wanted = ball_depth_mm(flow, view, tip, press.ball_mm / 2)
    sure = wanted > -0.4 * tip[2]
    found = DepthFinder(view, DepthModel(1.0, 20.0)).find(flow).depth_mm[sure]
    return float(found @ wanted[sure] / (found @ found))


def _fields(
    finder: DepthFinder, features: Inverse, model: ForceModel, flow: FaceFlow,
    truth: dict[str, Array], i: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Errors of place (mm), pressure (of its peak) and depth (mm, over the contact)."""
    found = find_contacts(finder.find(flow), flow, finder.view.camera)
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
    z = -finder.inverse.indentation_mm(inverse.solve(flow)) * finder.model.gain
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
    head = ("gel", "believed", "normal, N (told; worst)", "range, N", "shear, %", "in the interval",
            "place, mm", "pressure, of its peak", "depth, mm (gain)")  # fmt: skip
    print(f"| {' | '.join(head)} |", "|---" * len(head) + "|", sep="\n")
    words = {"late": "", "early": ", every second label 5 % high", "mended": ", these mended"}
    for name, (gel, _) in STRANGERS.items():
        seen = Seen.of(name)
        for labels, more in words.items():
            told = [seen.told(learn, labels) for learn, _ in seen.rounds()]
            for what, gels in (("the design", [None] * len(told)), ("what presses tell", told)):
                rounds = [
                    judged(seen, *presses, one, labels)
                    for presses, one in zip(seen.rounds(), gels, strict=True)
                ]
                f = figures(seen, rounds)
                low, high = f["gains"]
                print(
                    f"| {name} | {what}{more} | {f['normal_n']:.3f} ({f['told_n']:.3f}; "
                    f"{f['worst_n']:.2f}) | {f['range_n']:.1f} | {f['shear_percent']:.2f} | "
                    f"{f['held']:.0%} | {f['place_mm']:.2f} | {f['pressure_of_peak']:.2f} | "
                    f"{f['depth_mm']:.3f} ({low:.2f}-{high:.2f}) |",
                    flush=True,
                )
            for one in told:
                print(f"<!-- {name}{more} ({gel.poisson}, {gel.size_mm[2]} mm): "
                      f"{one.line if one else 'nothing is told'} -->", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
