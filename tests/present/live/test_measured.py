"""A run measured live and for its report: one measurement, and what it may say."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_run import first_press

from deltact_fab.bench.record.run import open_run
from deltact_fab.common.errors import InputError
from deltact_fab.estimate.analysis.force.result import write_force_calibration
from deltact_fab.estimate.analysis.measured import RunMeasurement, find_calibrations, measure_run
from deltact_fab.estimate.measure.force.calibration import load_force
from deltact_fab.present.live.formatting import (
    RESULT_COLUMNS,
    contact_number,
    status_text,
    table_row,
)
from deltact_fab.present.live.open import open_measurement, open_source
from deltact_fab.present.live.outputs import HealthOutput, JsonLines, StatusLine
from deltact_fab.present.live.picture import LOST_BYTE, page_data
from deltact_fab.present.live.session import MeasuredImage, MeasurementSession
from deltact_fab.present.report.page import _contacts

PRESSED = 2
"""The image at the end of the first press: a ball of 10 mm, 1 mm deep, at (0.5, -0.5)."""


@pytest.fixture(scope="module")
def session(mini_run: Path, calibrations: list[Path]) -> MeasurementSession:
    source = open_source(str(mini_run))
    return MeasurementSession(source, open_measurement(source.model, calibrations))


@pytest.fixture(scope="module")
def results(session: MeasurementSession) -> list[MeasuredImage]:
    return list(session.results())


@pytest.mark.slow
def test_outputs_contain_force_contacts_health(
    session: MeasurementSession, results: list[MeasuredImage]
) -> None:
    people, program, said = io.StringIO(), io.StringIO(), list[str]()
    origin = "simulated, seed 3"
    outputs = (
        StatusLine(people, origin),
        JsonLines(program, origin),
        HealthOutput(session.source, lambda *told: said.append(told[0])),
    )
    for output in outputs:
        for m in results:
            output.show(m)
        output.end("ended", results[-1])
    rows = [json.loads(line) for line in program.getvalue().splitlines()]
    normal = [-row["force_n"][2] for row in rows]
    assert normal[0] == pytest.approx(0, abs=0.02)
    assert max(normal) > 3
    (contact,) = rows[PRESSED]["contacts"]
    assert contact["force_share"] == pytest.approx(1, abs=1e-3)
    assert np.hypot(*np.subtract(contact["place_mm"], [0.5, -0.5])) < 1
    assert contact["count"] == "one"
    assert 0.5 < contact["resolution_mm"] < 4
    names = [column.name for column in RESULT_COLUMNS]
    row = dict(zip(names, table_row(results[PRESSED], "", ""), strict=True))
    assert (row["contact_count"], row["contact_resolution_mm"]) == ("one", contact["resolution_mm"])
    assert rows[0]["contacts"] == []
    assert "contacts: 1 " in status_text(results[PRESSED])
    assert "N mm" in people.getvalue()
    assert said == ["state of health: fit to use"]


@pytest.mark.slow
def test_report_agrees_with_command(
    results: list[MeasuredImage], mini_run: Path, calibrations: list[Path]
) -> None:
    run = open_run(mini_run)
    found = measure_run(run, calibrations)
    assert found.force is not None
    assert found.left_out == []
    table = found.force.frames
    first = table["press"] == table["press"].iloc[0]  # the command keeps its first reference
    said = table.loc[first, [f"{name}_est" for name in RunMeasurement.FORCE_COLUMNS]].to_numpy()
    live = [m.result.force.force_n for m in results if m.result.force is not None]
    assert said == pytest.approx(np.array(live)[: len(said)], abs=2e-3)
    assert "not a test" in found.force.line
    assert found.force.rms_n is not None
    assert max(found.force.rms_n[:2]) < 0.1
    assert found.force.rms_n[2] < 1
    assert [d.indenter for d in found.deepest] == ["sphere:10", "4dots"]
    assert all(d.depth_mm == pytest.approx(1, abs=0.01) for d in found.deepest)
    assert all(d.result.contacts for d in found.deepest)
    numbers = [[row["number"] for row in _contacts(d)] for d in found.deepest]
    assert numbers == [[c.count for c in d.result.contacts or ()] for d in found.deepest]
    assert numbers[0] == ["one"]


def test_another_sensors_calibration_is_refused(mini_run: Path, calibrations: list[Path]) -> None:
    text = calibrations[0].read_text()
    assert 'design = "deltact"' in text
    other = calibrations[0].with_name("other.toml")
    other.write_text(text.replace('design = "deltact"', 'design = "another"'))
    with pytest.raises(InputError, match="made on another sensor"):
        open_measurement(open_source(str(mini_run)).model, [other])
    with pytest.raises(InputError, match="made on another sensor"):
        find_calibrations(open_run(mini_run), [other])


def test_page_draws_the_measurement(
    results: list[MeasuredImage], session: MeasurementSession
) -> None:
    told = page_data(results[PRESSED], session.view)
    json.dumps(told, allow_nan=False)
    assert [m["name"] for m in told["maps"]] == ["pressure", "depth", "relative depth"]
    depth = told["maps"][1]
    levels = np.frombuffer(_bytes(depth["data"]), np.uint8).reshape(depth["height"], depth["width"])
    peak = np.argmax(np.where(levels == LOST_BYTE, 0, levels))
    row, column = np.unravel_index(peak, levels.shape)
    x, y = (
        low + (at + 0.5) / n * (high - low)
        for at, n, (low, high) in (
            (column, depth["width"], depth["x_mm"]), (row, depth["height"], depth["y_mm"])
        )
    )  # fmt: skip
    assert np.hypot(x - 0.5, y + 0.5) < 1
    arrows = np.frombuffer(_bytes(told["flow"]["data"]), np.float32).reshape(-1, 2)
    assert len(arrows) == len(told["flow"]["x_mm"]) * len(told["flow"]["y_mm"])
    assert np.nanmax(np.hypot(*arrows.T)) <= told["motion"] + 0.02
    assert len(told["contacts"][0]["seen_mm"]) == len(told["contacts"][0]["outline_mm"])
    assert told["contact_number"] == "1"


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        ([], "0"),
        (["one", "one"], "2"),
        (["cannot tell"], "1, perhaps more"),
        (["two or more", "cannot tell"], "3 or more"),
    ],
)
def test_number_of_contacts_in_words(counts: list[str], text: str) -> None:
    assert contact_number([{"count": count} for count in counts]) == text


@pytest.mark.parametrize(
    ("source", "own"), [("{name}", True), ("{folder}", True), ("another", False)]
)
def test_own_calibration_is_no_test(
    mini_run: Path, calibrations: list[Path], tmp_path: Path, source: str, own: bool
) -> None:
    run = open_run(first_press(mini_run, tmp_path / "renamed"))
    names = {"name": run.meta["name"], "folder": "renamed"}
    assert len({*names.values()}) == 2
    calibration, file = load_force(calibrations[0]), tmp_path / "force.toml"
    head = calibration.head
    head = replace(head, made=replace(head.made, runs=("first", source.format(**names))))
    write_force_calibration(replace(calibration, head=head), file)
    force = measure_run(run, [file]).force
    assert force is not None
    assert force.rms_n is not None
    assert force.fitted_to_run == own
    assert ("not a test" in force.line) == own
    for beyond in (False, True):
        table = force.frames.assign(extrapolated=beyond)
        assert replace(force, frames=table).doubtful == (own or beyond)


def _bytes(text: str) -> bytes:
    import base64

    return base64.b64decode(text)
