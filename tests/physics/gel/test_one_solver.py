"""One solver behind `gel press`, `gel fit`, `run` and the prediction."""

from __future__ import annotations

import pytest

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.rig.config import FiniteGelConfig, GelConfig
from deltact_fab.physics.gel.fit.force_curve import cells_mm, force_curve
from deltact_fab.physics.gel.press import press_gel
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.preflight.peaks import press_curve
from deltact_fab.simulate.virtual.presses import Presses


def four(indenter: str, depth_mm: float, spacing_mm: float | None) -> dict[str, float]:
    """One press in the middle of the standard block, friction 0.5, for a modulus of 1 MPa."""
    skin, unit, shape, middle = (
        SkinDimensions(),
        GelMaterial(1.0),
        parse_indenter(indenter),
        (0.0, 0.0),
    )
    pressed = press_gel(
        skin, unit, shape, middle, depth_mm, model="hyperelastic", spacing_mm=spacing_mm
    ).result
    cells = spacing_mm or cells_mm(skin, shape, unit.poisson, middle, depth_mm)
    curve = force_curve(skin, unit, shape, middle, depth_mm, spacing_mm=cells)
    protocol = Protocol.model_validate(
        {
            "name": "one",
            "indenters": [indenter],
            "positions_mm": [middle],
            "depths_mm": [depth_mm],
            "channels": ["force"],
            "capture": {"settle_s": 1.0},
            "specimen": {"gel_model": "hyperelastic", "modulus_mpa": 1.0},
        }
    )
    config = GelConfig(hyperelastic=FiniteGelConfig(cell_mm=spacing_mm))
    run = Presses(protocol, skin, config)
    predicted = press_curve(skin, unit, shape, middle, [depth_mm])
    assert predicted is not None
    return {
        "press": -pressed["force_n"][2],
        "fit": float(curve.normal_n([depth_mm])[0]),
        "run": -run.planned_press(run.paths[0]).solver.solve_all()[-1].force_n[2],
        "predicted": predicted.normal_n(depth_mm)[0],
    }


@pytest.mark.slow
def test_four_solutions_of_a_press_agree() -> None:
    found = four("sphere:15", 5.0, None)
    for name in ("fit", "run"):
        assert found[name] == pytest.approx(found["press"], rel=0.03), name
    assert found["press"] <= found["predicted"] <= 1.2 * found["press"]
