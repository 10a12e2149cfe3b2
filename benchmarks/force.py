"""Force models on presses that they never saw: the believed sensor right and wrong, and rivals."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deltact_fab.common.aliases import Array
from deltact_fab.estimate.measure.force import FORCE_FEATURES, make_features
from deltact_fab.estimate.measure.force.inverse import Inverse
from deltact_fab.estimate.measure.force.model import Features, ForceModel
from deltact_fab.estimate.measure.sensor_id import SensorModel
from deltact_fab.estimate.measure.shape.depth import DepthFinder, DepthModel, find_contacts
from deltact_fab.fabricate.cad.design import load_design
from deltact_fab.sensor.optics.camera import Pinhole

from .force_truth import GEL, SETTINGS, SKIN, Press, flows, presses, solved

DRAWS = 10  # of presses to learn from, for each number of them
CONTACT = 0.05  # of the peak pressure: where there is a contact


@dataclass(frozen=True)
class Believed:
    """What the estimate is given: flow errors, and a sensor that may not be the true one."""

    name: str
    noise_px: float = 0.1
    wide_mm: float = 1.0
    poisson: float = GEL.poisson
    thicker_mm: float = 0.0
    eye: float = 1.0
    models: tuple[str, ...] = ("inverse-placed",)

    @property
    def view(self) -> SensorModel:
        """The sensor as believed."""
        camera = Pinhole.from_sensor(load_design("deltact"))
        eye_mm = self.eye * camera.eye_distance_mm
        view = SensorModel(replace(camera, eye_distance_mm=eye_mm), SKIN)
        return view.with_gel(self.poisson, SKIN.thickness_mm + self.thicker_mm)


CONDITIONS = (
    Believed("as it is", models=tuple(FORCE_FEATURES)),
    Believed("no error of the flow", 0.0),
    Believed("flow: 0.1 px over 3 mm", wide_mm=3.0),
    Believed("flow: 0.3 px over 1 mm", 0.3),
    Believed("flow: 1 px over 1 mm", 1.0),
    Believed("Poisson's ratio 0.45", poisson=0.45),
    Believed("Poisson's ratio 0.499", poisson=0.499),
    Believed("gel 1 mm thinner", thicker_mm=-1.0),
    Believed("gel 1 mm thicker", thicker_mm=1.0),
    Believed("eye 10 % nearer", eye=0.9),
    Believed("eye 10 % farther", eye=1.1),
)


def force_row(believed: Believed) -> dict[str, Any]:
    """Left-out figures of each model on the presses that set nothing, and of other shapes."""
    balls = [p for p in presses() if p.indenter.startswith("sphere:")][SETTINGS:]
    others = [p for p in presses() if not p.indenter.startswith("sphere:")]
    camera = Pinhole.from_sensor(load_design("deltact"))
    seen = {p: flows(p, camera, believed.noise_px, believed.wide_mm) for p in [*balls, *others]}
    found: dict[str, Any] = {"presses": len(balls), "states": sum(len(seen[p]) for p in balls)}
    for name in believed.models:
        features = make_features(name, believed.view)
        numbers, cpu_ms = _numbers(features, seen)
        by_place, by_ball = (
            _left_out(features, balls, numbers, of)
            for of in (lambda p: p.name, lambda p: p.indenter)
        )
        model = _fitted(features, balls, numbers)
        found[name] = {
            "place": rms(by_place),
            "indenter": rms(by_ball),
            "other": rms([_errors(model, p, numbers) for p in others]),
            "cpu_ms": cpu_ms,
        }
        if isinstance(features, Inverse):
            found[name] |= _fields(features, model, balls, seen)
    found["range"] = np.ptp(np.concatenate([wrench(p) for p in balls]), axis=0).round(2).tolist()
    return found


def learning_row() -> dict[str, Any]:
    """Normal and shear error from 1, 3, 5 and 12 presses at scattered places, drawn DRAWS times."""
    balls = [p for p in presses() if p.indenter.startswith("sphere:")][SETTINGS:]
    believed = CONDITIONS[0]
    camera = Pinhole.from_sensor(load_design("deltact"))
    seen = {p: flows(p, camera, believed.noise_px, believed.wide_mm) for p in balls}
    found: dict[str, Any] = {}
    for name in believed.models:
        features = make_features(name, believed.view)
        numbers, _ = _numbers(features, seen)
        for n in (1, 3, 5, 12):
            errors = []
            for draw in range(DRAWS):
                order = np.random.default_rng([n, draw]).permutation(len(balls))
                model = _fitted(features, [balls[i] for i in order[:n]], numbers)
                errors += [_errors(model, balls[i], numbers) for i in order[n:]]
            found[f"{name}: {n}"] = rms(errors)
    return found


def _numbers(features: Features, seen: dict[Press, list[Any]]) -> tuple[dict[Press, Array], float]:
    start = time.process_time()
    found = {p: np.array([features.compute(flow) for flow in flows]) for p, flows in seen.items()}
    return found, 1e3 * (time.process_time() - start) / sum(map(len, seen.values()))


def wrench(press: Press) -> Array:
    """Of each state (n, 6), N and N mm."""
    truth = solved(press)
    return np.column_stack((truth["force_n"], truth["torque_nmm"]))


def _fitted(features: Features, use: Sequence[Press], numbers: dict[Press, Array]) -> ForceModel:
    x, y = (np.concatenate([of(p) for p in use]) for of in (numbers.__getitem__, wrench))
    return ForceModel.fit(features, x, y)[0]


def _errors(model: ForceModel, press: Press, numbers: dict[Press, Array]) -> Array:
    return np.asarray(model.predict(numbers[press]) - wrench(press))


def _left_out(
    features: Features,
    use: Sequence[Press],
    numbers: dict[Press, Array],
    group: Callable[[Press], str],
) -> list[Array]:
    found = []
    for value in sorted({group(p) for p in use}):
        model = _fitted(features, [p for p in use if group(p) != value], numbers)
        found += [_errors(model, p, numbers) for p in use if group(p) == value]
    return found


def rms(errors: Sequence[Array]) -> list[float]:
    """Of each component, over all rows (n, 6)."""
    squares = np.concatenate(errors) ** 2
    return [round(float(v), 4) for v in np.sqrt(squares.mean(axis=0))]


def _fields(
    features: Inverse, model: ForceModel, use: Sequence[Press], seen: dict[Press, list[Any]]
) -> dict[str, Any]:
    """Traction, place and depth against truth: means over the states, and the largest of place.

    not_found: share of the states in which nothing is found to press, or only out of the view.
    """
    inverse, finder = features.inverse, DepthFinder(features.view, DepthModel(1.0, 20.0))
    rows = []
    for press in use:
        truth = solved(press)
        for i, flow in enumerate(seen[press]):
            field = features.traction(flow, model)
            at_x, at_y = _nearest(truth["x_mm"], field.x_mm), _nearest(truth["y_mm"], field.y_mm)
            true = _cell_means(truth["traction_mpa"][i], at_y, at_x)
            peak = -true[..., 2].min()
            pressed = inverse.solve(flow)
            touched = -true[..., 2] > CONTACT * peak
            total = field.force_n - wrench(press)[i, :3]
            found = find_contacts(finder.find(flow), flow, features.view.camera)
            place = np.hypot(*(found[0].place_mm - truth["tips_mm"][i, :2])) if found else np.nan
            depth = inverse.indentation_mm(pressed)
            at = np.ix_(*(_nearest(truth[k], s) for k, s in
                          (("y_mm", inverse.seen_y_mm), ("x_mm", inverse.seen_x_mm))))  # fmt: skip
            error = np.abs(depth + truth["displacement_mm"][i][..., 2][at])
            inner = -truth["traction_mpa"][i][..., 2][at] > CONTACT * peak
            off = np.abs(field.traction_mpa - true)[touched].mean(axis=0) / peak
            rows.append((off[2], off[:2].mean(), np.linalg.norm(total) / np.linalg.norm(
                wrench(press)[i, :3]), place, error[inner].mean(), error.mean(),
                truth["tips_mm"][i, 2]))  # fmt: skip
    table = np.array(rows)
    deepest = table[:, -1] <= table[:, -1].min() + 1e-6
    names = ("pressure_of_peak", "shear_of_peak", "total", "place_mm", "depth_mm", "face_mm")
    means = {k: round(float(v), 4) for k, v in zip(names, np.nanmean(table, axis=0), strict=False)}
    return means | {
        "not_found": round(float(np.isnan(table[:, 3]).mean()), 4),
        "place_most_mm": round(float(np.nanmax(table[:, 3])), 3),
        "deepest_depth_mm": round(float(table[deepest, 4].mean()), 3),
        "deepest_face_mm": round(float(table[deepest, 5].mean()), 3),
    }


def _nearest(axis_mm: Array, at_mm: Array) -> Array:
    return np.abs(axis_mm - at_mm[:, None]).argmin(axis=1)


def _cell_means(field: Array, rows: Array, columns: Array) -> Array:
    """Means over 1 mm cells of a field on nodes 0.5 mm apart, nodes on the edge by half."""
    wide = np.pad(field.astype(float), ((1, 1), (1, 1), (0, 0)))
    part = (wide[:-2] + 2 * wide[1:-1] + wide[2:]) / 4
    part = (part[:, :-2] + 2 * part[:, 1:-1] + part[:, 2:]) / 4
    return np.asarray(part[np.ix_(rows, columns)])
