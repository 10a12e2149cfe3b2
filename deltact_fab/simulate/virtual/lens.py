"""The two lenses of a virtual rig: the true one, which draws, and the calibrated one, which tracks.

A real bench knows its lens only as it was calibrated; so does all that estimates here. The true
one is in the rig file's `[virtual.lens]` and goes to the run's `truth/`, nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from deltact_fab.bench import VirtualConfig, load_view, view_notes
from deltact_fab.common import InputError, Note
from deltact_fab.fabricate import load_design
from deltact_fab.sensor import Fisheye, Pinhole, Rectified, SensorDimensions, restore_camera

from .picture import BAND_PX
from .population import SensorDraw

ASSEMBLY_MM = {"air_gap_mm": 1.0, "acrylic_mm": 0.5, "gel_mm": 1.0}
"""Largest deviation of a sensor put together by hand; a larger one is another sensor's."""


def true_lens(config: VirtualConfig, sensor: SensorDimensions) -> Fisheye:
    """Lens that the rig draws through: the design's, with the overrides of `[virtual.lens]`.

    Raises InputError for numbers that are another sensor's.
    """
    nominal = Fisheye.from_sensor(sensor).as_dict()
    overrides = config.virtual.lens
    values = dict(nominal)
    if overrides is not None:
        made_for = nominal
        if overrides.design is not None:
            made_for = Fisheye.from_sensor(load_design(overrides.design)).as_dict()
        for key, value in overrides.numbers().items():
            differs = abs(value - nominal[key]) > ASSEMBLY_MM.get(key, np.inf)
            if overrides.design is None and differs:
                raise InputError(
                    f"virtual.lens.{key}: {value:g}, and the design has {nominal[key]:g}: values "
                    "of another sensor; name its design as virtual.lens.design, and only "
                    "differences from that design apply"
                )
            same = made_for[key] == nominal[key]
            values[key] = value if same else nominal[key] + value - made_for[key]
    lens = restore_camera(values, "virtual.lens")
    assert isinstance(lens, Fisheye), "as_dict names its class"
    return lens


def true_camera(
    config: VirtualConfig, sensor: SensorDimensions, view: Pinhole | Rectified, draw: SensorDraw
) -> Fisheye | Pinhole | None:
    """Camera that a drawn sensor is rendered through; None: the view itself.

    Raises InputError for one of another sensor, or so far off that the view is not in its picture.
    """
    camera = draw.camera(true_lens(config, sensor) if isinstance(view, Rectified) else view)
    if draw.number is not None:
        source = f"virtual.population: sensor {draw.number}"
        _require_drawn(camera, view, source, "lower the camera's deviations")
    return None if camera is view else camera


def tracked_view(config: VirtualConfig, sensor: SensorDimensions, source: Path) -> Rectified:
    """The view that trackers take, by the calibrated lens; by the design's where none was.

    source: of the rig file. Raises InputError for a camera file that is missing, holds no fisheye,
    or is so far off that its view is not in the picture.
    """
    if config.camera is None:
        view, label = Rectified.from_sensor(sensor), "the design's lens"
    else:
        label = str(source.parent / config.camera.model)
        loaded = load_view(config.camera, sensor, source)
        assert loaded is not None, "the table names a file"
        if not isinstance(loaded, Rectified):
            raise InputError(
                f"{label}: camera.model: {loaded.as_dict()['model']!r}; a virtual rig needs a "
                "'fisheye'"
            )
        view = loaded
    _require_drawn(true_lens(config, sensor), view, f"{source}: camera.model: {label}")
    return view


def _require_drawn(
    true: Fisheye | Pinhole,
    view: Pinhole | Rectified,
    source: str,
    remedy: str = "calibrate this rig's own camera",
) -> None:
    """Refuse a view of which the border is not in the drawn picture."""
    lens = view.lens if isinstance(view, Rectified) else view
    if (true.width_px, true.height_px) != (lens.width_px, lens.height_px):
        raise InputError(
            f"{source}: an image of {lens.width_px} x {lens.height_px} px, and [virtual.lens] "
            f"makes {true.width_px} x {true.height_px} px"
        )
    w, h = view.width_px - 1, view.height_px - 1
    x, y = np.linspace(0, w, 65), np.linspace(0, h, 65)
    sides = [(x, 0 * x), (x, 0 * x + h), (0 * y, y), (0 * y + w, y)]
    border_mm = view.rest_mm(np.concatenate([np.stack(side, axis=-1) for side in sides]))
    try:
        raw = lens.rest_px(border_mm)
    except InputError as error:
        raise InputError(f"{source}: the view's border: {error}") from error
    looks_mm = true.rest_mm(raw)
    inside = ((raw > -1e-6) & (raw < (true.width_px - 1 + 1e-6, true.height_px - 1 + 1e-6))).all()
    off_mm = np.nan_to_num(np.hypot(*(looks_mm - border_mm).T), nan=np.inf).max()
    most_mm = BAND_PX * view.mm_per_px
    if not inside or off_mm > most_mm:
        raise InputError(
            f"{source}: the view's border is up to {off_mm:.2g} mm off that of the true camera, "
            f"and only {most_mm:.2g} mm beyond it are drawn; {remedy}"
        )


def lens_notes(config: VirtualConfig, view: Rectified, patch_mm: float | None) -> Iterator[Note]:
    """Notes on the lens for readers of a run."""
    if config.camera is None:
        text = (
            "lens not calibrated, the design's lens is used: photograph the chessboard skin on "
            "this rig; `deltact-fab calibrate lens` writes the file for [camera] model"
        )
        yield Note("lens", text, warns=True)
    yield from view_notes(view, patch_mm)
