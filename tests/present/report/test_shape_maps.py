"""The gallery of shapes and the force distribution, on a face whose dent and traction are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from deltact_fab.estimate.analysis.shape.press import ShapeMaps
from deltact_fab.estimate.measure.face import FaceFlow
from deltact_fab.estimate.measure.force.model import TractionField, Wrench
from deltact_fab.estimate.measure.shape.density import Density
from deltact_fab.estimate.measure.shape.depth import ContactRegion, Depth
from deltact_fab.present.report import shape_figures
from deltact_fab.present.report.figures import to_svg

X, Y = np.linspace(-10, 10, 81), np.linspace(-8, 8, 65)
FAR2 = X**2 + Y[:, None] ** 2
DENT = np.exp(-FAR2 / 8).astype(np.float32)
SQUARE = np.array([[-2.0, -2], [2, -2], [2, 2], [-2, 2]])
CELLS = np.arange(-6.5, 7)
PRESSURE = np.exp(-(CELLS**2 + CELLS[:, None] ** 2) / 6)


def picture(**changed: Any) -> ShapeMaps:
    """A dent of 1 mm that the flow shows as motion outwards."""
    shift = np.stack((DENT * X / 10, DENT * Y[:, None] / 10), axis=-1)
    one = ShapeMaps(
        indenter="sphere:10",
        frame_id="p/1",
        tip_mm=np.array([0.0, 0, -1]),
        flow=FaceFlow(shift, FAR2 < 150, X, Y),
        density=Density(1 - DENT / 5, FAR2 < 140),
        relative=DENT / 5,
        depth=Depth(DENT, FAR2 < 150, X, Y, 1.0, False),
        contacts=[
            ContactRegion(16.0, np.zeros(2), SQUARE, np.zeros(2), 1.0, None, 1.0, "one", 2.0)
        ],
        image=np.full((32, 40, 3), 200, np.uint8),
        edges_mm=np.array([-10.0, 10, -8, 8]),
    )
    return replace(one, **changed)


def with_field(**changed: Any) -> ShapeMaps:
    traction = np.stack((0.2 * PRESSURE, 0 * PRESSURE, -PRESSURE), axis=-1)
    field = TractionField(traction, CELLS, CELLS, 1.0)
    wrench = Wrench(field.force_n, field.torque_nmm, 1.0, False)
    return picture(field=field, wrench=wrench, force_n=np.array([1.0, 0, -5]), **changed)


WITH_TRUTH: dict[str, Any] = {"true_depth_mm": DENT, "true_contact": DENT > 0.4}


def meshes(axis: Any) -> list[QuadMesh]:
    """Maps, but for bars of colours."""
    found = [part for part in axis.collections if isinstance(part, QuadMesh)]
    return [part for part in found if part.get_array().shape[1] > 1]


@pytest.mark.slow
def test_plotted_density_is_the_measured_one() -> None:
    figure = shape_figures.plot_gallery([picture(), picture(**WITH_TRUTH)], "")
    drawn = [mesh for axis in figure.axes for mesh in meshes(axis)]
    assert len(drawn) == 2
    np.testing.assert_array_equal(drawn[0].get_array(), DENT / 5)
    assert to_svg(figure).count("measured, to 1.00 mm") == 2


def test_exact_depth_has_white_error_map() -> None:
    figure = shape_figures.plot_depth_against_truth([picture(), picture(**WITH_TRUTH)], "")
    (mesh,) = (m for axis in figure.axes for m in meshes(axis))
    assert not mesh.get_array().any()
    low, high = mesh.get_clim()
    assert low == -high == -0.02


def test_forces_share_scale_with_white_contact() -> None:
    nodes = np.linspace(-18, 18, 30)
    true = np.zeros((30, 30, 3))
    true[..., 2] = -2 * np.exp(-(nodes**2 + nodes[:, None] ** 2) / 6)
    figure = shape_figures.plot_distribution(
        with_field(**WITH_TRUTH, true_traction=(nodes, nodes, true)), "run"
    )
    titles = {axis.get_title(): axis for axis in figure.axes}
    found, known = titles["normal force, found"], titles["normal force, true"]
    (above,), (below,) = meshes(found), meshes(known)
    assert above.get_clim() == below.get_clim()
    np.testing.assert_allclose(above.get_array(), 1e3 * PRESSURE)
    outline = found.lines[0].get_xydata()
    np.testing.assert_array_equal(outline, np.vstack((SQUARE, SQUARE[:1])))
    assert found.lines[0].get_color() == "white"
    # The true contact's line lies between the points that touch and those that do not.
    (line,) = known.collections[1].get_paths()
    radius = np.hypot(*line.vertices.T)
    assert np.sqrt(-8 * np.log(0.4)) == pytest.approx(radius.mean(), abs=X[1] - X[0])
    assert "force sensor: normal 5.00 N, shear (1.00, 0.00) N" in to_svg(figure)
