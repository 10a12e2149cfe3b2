"""The paper's pattern selection: declared as printed, checked, estimated; the gel it needs."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.protocols.plan import Protocol, Step
from deltact_fab.common.errors import InputError
from deltact_fab.sensor.shapes.sensor import SensorDimensions
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.virtual.presses import require_gel_level

NAME = "pattern-selection"


@pytest.fixture(scope="module")
def declared() -> Protocol:
    return plan.load_protocol(NAME)[0]


@pytest.fixture(scope="module")
def steps(declared: Protocol) -> list[Step]:
    return plan.expand_protocol(declared)


def test_protocol_matches_the_paper(declared: Protocol) -> None:
    assert declared.indenters == ("4dots", "edges", "ellipsoid", "hexprism", "star")
    assert len(set(declared.positions_mm)) == 4
    assert declared.depths_mm == (5.0, 10.0)
    assert declared.shear is not None
    assert declared.shear.amplitude_mm == 10.0
    assert declared.shear.axes == ("x", "y")
    assert {"image", "dots", "shear"} <= declared.channels


def test_each_indenter_gets_3600_frames(declared: Protocol, steps: list[Step]) -> None:
    frames: Counter[str] = Counter()
    for step in steps:
        frames[step.indenter] += step.frames
    assert frames == dict.fromkeys(declared.indenters, 3600)


def test_every_check_passes_on_virtual_rig() -> None:
    rows = RunRequest(NAME, "virtual").checks()
    assert [r for r in rows if r.failed] == []
    reach = {r.subject: r.value for r in rows if r.name == "contact on the skin"}
    assert reach == pytest.approx({"reach in x (mm)": 17.5, "reach in y (mm)": 16.5})


@pytest.mark.parametrize("level", ["linear", "layer", "block"])
def test_linear_run_is_refused_before_motion(level: str, tmp_path: Path) -> None:
    text = plan.load_protocol(NAME)[1].read_text()
    protocol, out = tmp_path / "linear.toml", tmp_path / "run"
    protocol.write_text(text.replace('gel_model = "hyperelastic"', f'gel_model = "{level}"'))
    with pytest.raises(
        InputError, match=r"10 mm is over 3 mm.*level 'linear'.*needs the level 'hyperelastic'"
    ) as e:
        run_experiment(RunRequest(str(protocol), "virtual", out))
    assert "\n" not in str(e.value)
    assert "linear.toml" in str(e.value)
    assert not out.exists()


@pytest.mark.parametrize(
    ("specimen", "depth_mm", "says"),
    [
        ({"gel_model": "hyperelastic"}, 12.0, "not less than the gel's thickness of 12 mm"),
        ({"gel_model": "hyperelastic", "poisson": 0.5}, 1.0, "poisson: 0.5 exceeds 0.49999"),
        ({"gel_model": "linear", "poisson": 0.5}, 1.0, "poisson: 0.5 exceeds 0.4999,"),
        ({"gel_model": "linear", "prony": [[0.2, 1.0]]}, 1.0, "needs the level 'hyperelastic'"),
        ({"gel_model": "hyperelastic", "prony": [[0.2, 1.0]]}, 11.0, ""),
    ],
)
def test_only_unsupported_presses_are_refused(
    declared: Protocol, specimen: dict[str, object], depth_mm: float, says: str
) -> None:
    data = declared.model_dump() | {"indenters": ("sphere:15",), "depths_mm": (depth_mm,)}
    other = Protocol.model_validate(data | {"specimen": specimen})
    if not says:
        require_gel_level(other, SensorDimensions(), "p.toml")
        return
    with pytest.raises(InputError, match=r"^p\.toml: ") as caught:
        require_gel_level(other, SensorDimensions(), "p.toml")
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("name", "depth_mm", "needs"),
    [
        ("4dots", 2.0, "presses 4dots to 2 mm, its rim"),
        ("sphere:3", 1.6, "presses sphere:3 to 1.5 mm"),
        ("hexprism", 0.3, "to 0.3 mm"),
        ("star", 1.2, "to 0.3 mm"),
        ("edges", 1.7, "to 1.625"),
        ("4dots", 1.999, ""),
        ("hexprism", 0.299, ""),
        ("edges", 1.6, ""),
        ("ellipsoid", 2.9, ""),
        ("sphere:10", 3.0, ""),
        ("sphere:10", 3.001, "25% of the thickness"),
    ],
)
def test_linear_model_requires_height_fields(
    declared: Protocol, name: str, depth_mm: float, needs: str
) -> None:
    other = Protocol.model_validate(
        declared.model_dump()
        | {"indenters": (name,), "depths_mm": (depth_mm,), "specimen": {"gel_model": "linear"}}
    )
    if not needs:
        require_gel_level(other, SensorDimensions(), "p.toml")
        return
    with pytest.raises(InputError, match=r"^p\.toml: depths_mm: .*'hyperelastic'$") as caught:
        require_gel_level(other, SensorDimensions(), "p.toml")
    assert needs in str(caught.value)
