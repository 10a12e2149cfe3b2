"""Two contacts near each other: from which distance they are two, and what is called one.

`python -m benchmarks.near` prints the tables of docs/evidence/shape.md, in ten minutes of CPU time
(simulated). Truth: the linear contact on nodes 0.25 mm apart, frictionless or dragged with
friction; the flow is the projected displacement with noise. The estimate works on cells of 1 mm.
A pair is two where its patches of pressure do not touch.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from scipy import ndimage

from deltact_fab import sensor
from deltact_fab.common import DeltactFabError
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.estimate.measure.shape.depth import DepthFinder, DepthModel, find_contacts
from deltact_fab.fabricate import load_design
from deltact_fab.physics import LinearContact

from .force_truth import flows_of

CAMERA = sensor.Pinhole.from_sensor(load_design("deltact"))
THICKNESSES_MM, DEPTHS_MM, NOISES_PX = (2.0, 4.0, 8.0, 12.0), (0.3, 0.8, 1.5), (0.05, 0.1)
APART_MM = (1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 8, 10, 12)
SEEDS = 1, 2  # the limits were set on other presses, off the middle
COLUMNS = ["seed", "noise", "thickness", "depth", "kind", "apart", "patches", "axis", "verdict",
           "resolution"]  # fmt: skip
PLACES_MM, SEEN_MM = np.array([9.0, 7.0]), np.array([12.5, 8.5])  # of the press, of every tip
MIDDLE_MM, DRAG_MM = 2.5, 0.7


@dataclass(frozen=True)
class HigherTip(sensor.SphereTip):
    lift_mm: float = 0.0

    def height_mm(self, x_mm: Any, y_mm: Any) -> Any:
        return super().height_mm(x_mm, y_mm) + self.lift_mm


def presses(depth_mm: float, rng: np.random.Generator) -> Iterator[tuple[str, float, list[Any]]]:
    """Kind, distance and tips: single balls, pairs, long ones, flat ends."""
    for radius in np.exp(rng.uniform(np.log(1.6), np.log(10), 40)):
        yield "ball", 0.0, [sensor.SphereTip(0.0, 0.0, radius)]
    for apart, i in product(APART_MM, range(9)):
        (a, b), turn = rng.uniform(2, 3, 2), rng.uniform(0, np.pi)
        x, y = apart / 2 * np.array([np.cos(turn), np.sin(turn)])
        lift = rng.uniform(0, 0.3) * depth_mm if i % 2 else 0.0
        yield "pair", apart, [sensor.SphereTip(-x, -y, a), HigherTip(x, y, b, lift)]
    for i, turn in enumerate(rng.uniform(0, 180, 10)):
        ridge = sensor.RidgeTip(0.0, 0.0, 1.5, 2.5, rng.uniform(3, 8))
        tip = ridge if i % 2 else sensor.EllipsoidTip(0.0, 0.0, rng.uniform(3.5, 6), 3.0)
        yield "long", 0.0, [sensor.PosedTip(tip, 0.0, 0.0, turn)]
    for radius in rng.uniform(3, 4.5, 4):
        yield "flat", 0.0, [sensor.TurnedTip.cylinder(radius, edge_mm=1.8)]


def rows(thickness_mm: float, seed: int) -> pd.DataFrame:
    """Verdicts on one gel; a press that the linear gel refuses is left out."""
    rest = {"edge_fillet_mm": min(2.0, thickness_mm / 2), "protrusion_mm": min(6.0, thickness_mm)}
    skin = sensor.SkinDimensions(thickness_mm=thickness_mm, **rest)
    block = sensor.FreeBlock(skin, sensor.GelMaterial(0.56, 0.49, 0.5), 0.25)
    face = {"x_mm": block.x_mm, "y_mm": block.y_mm}
    finder, out = DepthFinder(SensorModel(CAMERA, skin, 0.49), DepthModel(1.0, 5.0)), []
    for depth in (d for d in DEPTHS_MM if d <= thickness_mm / 4):
        rng = np.random.default_rng([seed, int(10 * thickness_mm), int(10 * depth)])
        for i, (kind, apart, tips) in enumerate(presses(depth, rng)):
            reach = np.abs([(tip.x_mm, tip.y_mm) for tip in tips]).max(axis=0)
            room = np.minimum(SEEN_MM - reach, PLACES_MM)
            (x, y), drag = rng.uniform(-room, room), i % 3 == 0
            if i % 2:  # in the middle depth is hardly seen as motion
                x, y = MIDDLE_MM * np.array([x, y]) / PLACES_MM
            dx, dy = DRAG_MM * rng.uniform(-1, 1, 2)
            contact = LinearContact(block, sensor.Indenter(kind, tuple(tips)), 0.5 if drag else 0.0)
            try:
                state = contact.solve(contact.rest(), (x, y, depth))
                state = contact.solve(state, (x + dx, y + dy, depth)) if drag else state
            except DeltactFabError:
                continue
            truth: dict[str, Any] = {"displacement_mm": [state.displacement_mm], **face}
            patches = ndimage.label(state.pressure_mpa > 0)[1]
            for noise in NOISES_PX:
                (flow,) = flows_of(truth, CAMERA, noise, rng)
                found = find_contacts(finder.find(flow), flow, CAMERA)
                verdict = found[0].count if len(found) == 1 else "two or more" if found else "none"
                resolution = found[0].resolution_mm if found else np.nan
                out.append((seed, noise, thickness_mm, depth, kind, apart, patches,
                            np.hypot(x, y), verdict, resolution))  # fmt: skip
    return pd.DataFrame(out, columns=COLUMNS)


def show(table: pd.DataFrame) -> None:
    """The tables of one seed and one noise."""
    gel = ["thickness", "depth"]
    print(pd.crosstab([table.kind, *(table[k] for k in gel)], table.verdict).to_string())
    pairs = table[(table.kind == "pair") & (table.patches == 2)]
    for word in ("two or more", "one"):
        share = pairs.assign(share=pairs.verdict == word).groupby([*gel, "apart"]).share.mean()
        print(f"pairs called {word!r}\n{share.unstack().round(2).to_string()}")
    balls = table[(table.kind == "ball") & (table.verdict != "none")]
    print(f"resolution, mm\n{balls.groupby(gel).resolution.median().round(1).to_string()}")
    for name, group in {"pairs": pairs, "balls": balls}.items():
        for part in (group, group[group.axis < MIDDLE_MM], group[group.apart >= group.resolution]):
            print(f"one: {(part.verdict == 'one').sum()} of {len(part)} {name}", end=", ")


if __name__ == "__main__":
    with ProcessPoolExecutor(2) as pool:
        everything = pd.concat(pool.map(rows, *zip(*product(THICKNESSES_MM, SEEDS), strict=True)))
    for key, part in everything.groupby(["seed", "noise"]):
        print(f"\nseed, noise in px: {key}")
        show(part)
