"""Flags, notes and what is left out go by their ids: another sentence changes nothing else."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from deltact_fab.bench.protocols.plan import Protocol
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.bench.rig.config import GelConfig
from deltact_fab.bench.rig.force.netft import NoteCounts
from deltact_fab.bench.rig.interface import ForceSamples
from deltact_fab.bench.rig.run.streams import ForceStream
from deltact_fab.common.aliases import Note
from deltact_fab.physics.gel.press import press_gel
from deltact_fab.sensor.elasticity.material import GelMaterial
from deltact_fab.sensor.shapes.indenter import parse_indenter
from deltact_fab.sensor.shapes.sensor import SkinDimensions
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment
from deltact_fab.simulate.virtual.presses import Presses, gel_not_built, gel_notes
from deltact_fab.studies.study.press_jobs import gel_report
from deltact_fab.studies.study.scene import collect_left_out, flag_setting

ODD = "WARNING: other: words; taken 1 mm"
Change = Callable[[], None]


@pytest.fixture
def change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Change:
    """Makes the sentence of every note ODD from here on, with a store that has none yet."""
    made = Note.__init__

    def other(self: Note, id: str, text: str, warns: bool = False) -> None:
        made(self, id, ODD, warns)

    def changed() -> None:
        monkeypatch.setattr(Note, "__init__", other)
        monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path / "store"))

    return changed


def test_press_flags_have_ids(change: Change) -> None:
    asked = (SkinDimensions(), GelMaterial(), parse_indenter("sphere:10"), (0.0, 0.0), 1.5)
    results = []
    for _ in range(2):
        results.append(press_gel(*asked, model="linear", spacing_mm=1.0).result)
        change()
    before, after = results
    assert before["flags"][0].startswith("small strain: depth 1.5 mm is over 10 %")
    ids = [flag.partition(":")[0] for flag in before["flags"]]
    assert ids == ["small strain", "tolerance"]
    assert after["flags"] == [f"{id}: {ODD}" for id in ids]
    unlike = {key for key in before if before[key] != after[key]}
    assert unlike <= {"flags", "seconds"}


def test_a_gel_is_reported_by_ids(change: Change) -> None:
    protocol = Protocol.model_validate({
        "name": "t", "indenters": ["sphere:12"], "positions_mm": [[0.0, 0.0]], "depths_mm": [1.5],
        "channels": ["force"], "capture": {"rate_hz": 1.0},
    })  # fmt: skip
    skin, reports, settings, notes = SkinDimensions(), [], [], []
    for _ in range(2):
        presses = Presses(protocol, skin, GelConfig(spacing_mm=2.0, press_increment_mm=0.5))
        presses.planned_press(presses.paths[0]).solver.solve_all()
        choices = [presses.choice(path) for path in presses.paths]
        notes.append([*gel_notes(presses, choices, skin)])
        bench: Any = SimpleNamespace(
            presses=presses,
            omissions=lambda: gel_not_built(presses, choices),  # noqa: B023
        )
        reports.append(gel_report(bench))
        settings.append(flag_setting(reports[-1:], "jobs"))
        change()
    assert settings[1] == settings[0] == {"gel's flags": "small strain at 1 of 1 jobs"}
    assert [(n.id, n.warns) for n in notes[1]] == [(n.id, n.warns) for n in notes[0]]
    assert notes[0][-1].line.startswith("WARNING: small strain: depth 1.5 mm is over 10 %")
    assert notes[0][-1].line.endswith("; affected states: 1 of sphere-12/p1")
    before, after = ([note.id for note in collect_left_out([report])] for report in reports)
    assert before == after
    assert "viscosity" in before
    assert reports[0].pop("left_out") != reports[1].pop("left_out")
    assert reports[0] == reports[1]


def test_event_keeps_the_sensor_id(change: Change) -> None:
    events: list[tuple[str, str]] = []

    def read() -> ForceSamples:
        tally = NoteCounts()
        tally.add("gap", 3)
        none = np.zeros((0, 6), np.int32)
        return ForceSamples(none[:, 0], none, np.ones(6), none[:, 0] > 0, notes=tally.pop_notes(0))

    sensor: Any = SimpleNamespace(read=read)
    for _ in range(2):
        ForceStream(sensor, None, lambda id, text: events.append((id, text))).step()
        change()
    (before, text), after = events
    assert before == "gap"
    assert text.startswith("3 ")
    assert after == ("gap", ODD)


def test_warnings_are_read_from_data(mini_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = open_run(mini_run)
    summary, remarks = run.summary(), run.remarks()
    assert summary["notes"] == [Note(**one).line for one in summary["remarks"]]
    older = {key: value for key, value in summary.items() if key != "remarks"}
    notes = [*older["notes"], "WARNING: an old one"]
    monkeypatch.setattr(Run, "summary", lambda run: {**older, "notes": notes})
    assert run.remarks() == ([*remarks[0], "an old one"], remarks[1])
    odd = [asdict(Note("one", ODD)), asdict(Note("two", "no mark", warns=True))]
    monkeypatch.setattr(Run, "summary", lambda run: {**summary, "remarks": odd})
    assert run.remarks() == (["no mark"], [ODD])


@pytest.mark.slow
def test_run_does_not_depend_on_sentences(
    mini: tuple[Path, Path], tmp_path: Path, change: Change
) -> None:
    protocol = tmp_path / "force.toml"
    text = mini[0].read_text().replace('"image", "dots", ', "").replace(', "4dots"', "")
    protocol.write_text(text)
    summaries, tables, kept = [], [], []
    for name in ("before", "after"):
        request = RunRequest(str(protocol), str(mini[1]), tmp_path / name)
        summaries.append(json.loads(json.dumps(run_experiment(request))))
        run = open_run(tmp_path / name)
        read = run.steps(), run.frames(), run.events()
        tables.append([table.drop(columns="wall_s") for table in read])
        kept.append(run.remarks())
        change()
    for before, after in zip(*tables, strict=True):
        assert before.equals(after)
    assert [len(part) for part in kept[0]] == [len(part) for part in kept[1]]
    ids = [[(one["id"], one["warns"]) for one in s.pop("remarks")] for s in summaries]
    assert ids[0] == ids[1]
    labels = [[line.partition(":")[0] for line in s.pop("left_out")] for s in summaries]
    assert labels[0] == labels[1]
    for summary in summaries:
        del summary["notes"], summary["wall_seconds"]
    assert summaries[0] == summaries[1]
