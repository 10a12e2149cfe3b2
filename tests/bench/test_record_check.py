"""`record check` finds everything that is wrong with a run; `show` and `note` tell of it."""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rig_text import VIRTUAL_STAGE

from deltact_fab.app.cli.main import main
from deltact_fab.bench.record.check import check_run
from deltact_fab.bench.record.files import LATTICE_FILE, truth_file
from deltact_fab.bench.record.journal import CLOCK_COLUMNS, claim
from deltact_fab.bench.record.notes import RunNote
from deltact_fab.bench.record.run import open_run
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

# As 0.2.0 left it, stopped in its second press; force at 40 Hz, no images. Its rig:
OF_0_2 = Path(__file__).parents[1] / "data" / "run-format-5"
RIG = f"""{VIRTUAL_STAGE}[force]
rate_hz = 40.0
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.4
shear_increment_mm = 0.5
"""


def command(*words: object) -> Result:
    return CliRunner().invoke(main, ["record", *map(str, words)])


@pytest.fixture
def copy(mini_run: Path, tmp_path: Path) -> Path:
    """A run that a test may spoil."""
    shutil.copytree(mini_run, tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture(scope="module")
def no_images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of today by the protocol and on the rig of the one of 0.2.0, and a note."""
    folder = tmp_path_factory.mktemp("no-images")
    (folder / "rig.toml").write_text(RIG)
    of = str(OF_0_2 / "protocol.toml"), str(folder / "rig.toml")
    run_experiment(RunRequest(*of, folder / "run", seed=3), note="the gel is new")
    return folder / "run"


def sql(run: Path, text: str) -> None:
    with closing(sqlite3.connect(run / "journal.sqlite")) as db, db:
        assert db.execute(text).rowcount != 0


def first_image(run: Path) -> Path:
    return sorted((run / "images").iterdir())[0]


def problems(run: Path) -> list[tuple[str, str]]:
    return [(problem.kind, problem.where) for problem in check_run(run).problems]


def test_intact_run_is_reported_intact(mini_run: Path) -> None:
    done = command("check", mini_run)
    assert done.exit_code == 0, done.output
    assert "intact, finished: 2/2 presses complete" in done.output
    found = json.loads(command("check", mini_run, "--json").output)
    assert found["whole"]
    assert found["found_frames"] == found["frames"] == found["images"] > 10


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))


PRESS = "sphere-10/p1"
SPOILT: dict[str, tuple[Callable[[Path], object], str, str, str]] = {
    "image gone": (lambda r: first_image(r).unlink(), "damaged", "4dots/p1", "No such file"),
    "one bit": (lambda r: flip(first_image(r)), "damaged", "4dots/p1", "hash"),
    "samples": (
        lambda r: sql(r, "UPDATE samples SET data = substr(data, 1, 40) "
                         f"WHERE stream = 'force' AND step_id = '{PRESS}/rest'"),
        "damaged", PRESS, f"force of {PRESS}/rest",
    ),
    "truth gone": (lambda r: (r / truth_file(PRESS)).unlink(), "damaged", PRESS, "missing"),
    "frame gone": (
        lambda r: sql(r, f"DELETE FROM frames WHERE frame_id = '{PRESS}/rest#001'"),
        "missing", PRESS, "rest#001",
    ),
    "step gone": (
        lambda r: sql(r, f"DELETE FROM steps WHERE step_id = '{PRESS}/after'"),
        "missing", PRESS, "after",
    ),
    "strange frame": (
        lambda r: sql(r, "UPDATE frames SET frame_id = 'x#001' "
                         f"WHERE frame_id = '{PRESS}/rest#001'"),
        "extra", "x#001", "not in the protocol",
    ),
    "moved": (
        lambda r: sql(r, f"UPDATE steps SET seq = 900 WHERE step_id = '{PRESS}/after'"),
        "differs", f"{PRESS}/after", "900",
    ),
    "stray": (lambda r: (r / "images" / "new.png").write_bytes(b""), "extra", "images/new.png", ""),
    "journal": (
        lambda r: (r / "journal.sqlite").write_bytes(b"no journal"),
        "damaged", "journal.sqlite", "",
    ),
    "run.json": (lambda r: (r / "run.json").write_text("{"), "damaged", "run.json", ""),
    "protocol's value": (
        lambda r: (r / "protocol.toml").write_text(
            (r / "protocol.toml").read_text().replace("1.5", "1.25")),
        "damaged", "protocol.toml", "differs",
    ),
    "summary": (lambda r: (r / "summary.json").write_text("{}"), "damaged", "summary.json", ""),
    "lattice's value": (
        lambda r: flip(r / LATTICE_FILE), "damaged", "truth/lattice.json", "hash",
    ),
    "hashed, and gone": (
        lambda r: (r / "truth/lattice.json").unlink(), "missing", "truth/lattice.json", "",
    ),
    "note": (lambda r: (r / "notes.jsonl").write_text("[]\n"), "damaged", "notes.jsonl", "line 1"),
}  # fmt: skip


@pytest.mark.parametrize("how", SPOILT)
def test_what_is_wrong_is_named(copy: Path, how: str) -> None:
    spoil, kind, where, words = SPOILT[how]
    spoil(copy)
    done = command("check", copy)
    assert done.exit_code == 1, done.output
    first, *lines = done.output.splitlines()
    assert "DAMAGED" in first
    assert any(line.split()[:2] == [kind, where] and words in line for line in lines), done.output


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("run.json", '"seed": 3', '"seed": 4'), ("pattern.json", '"seed": 7', '"seed": 8'),
     ("summary.json", '"wall_seconds": ', '"wall_seconds": 1'), ("protocol.toml", "0.3", "0.30"),
     ("notes.jsonl", "the gel is new", "the gel is old")],
)  # fmt: skip
def test_changed_metadata_is_always_detected(
    no_images: Path, tmp_path: Path, name: str, old: str, new: str
) -> None:
    run = tmp_path / "run"
    shutil.copytree(no_images, run)
    assert check_run(run).intact
    text = (run / name).read_text()
    assert old in text
    (run / name).write_text(text.replace(old, new, 1))
    found = check_run(run)
    assert any(name in f"{p.where} {p.text}" for p in found.problems)


def test_old_run_is_readable_not_resumable(no_images: Path) -> None:
    found = check_run(OF_0_2)
    assert (found.format, found.intact, list(found.open)) == (5, True, ["sphere-6/p2"])
    assert found.unhashed == ["run.json", "protocol.toml", "pattern.json"]
    assert found.rows()[1][:2] == ("not hashed", "run.json, protocol.toml, pattern.json")
    old, new = (open_run(folder).frames("sphere-6/p1") for folder in (OF_0_2, no_images))
    assert len(old) == 8
    clocks = list(CLOCK_COLUMNS)
    assert old.drop(columns=clocks, errors="ignore").equals(
        new.drop(columns=clocks, errors="ignore")
    )
    of = str(OF_0_2 / "protocol.toml"), str(no_images.parent / "rig.toml")
    with pytest.raises(InputError, match="format 5 is of an older version"):
        run_experiment(RunRequest(*of, OF_0_2, seed=3), resume=True)


def test_changed_metadata_prevents_resume(copy: Path) -> None:
    (copy / "summary.json").unlink()
    pattern = copy / "pattern.json"
    pattern.write_text(pattern.read_text().replace('"seed": 7', '"seed": 8'))
    with pytest.raises(RunFailed, match=r"pattern\.json: differs from its hash .*restore it"):
        RunWriter.resume(copy, [])


def test_missing_press_is_no_damage_unfinished(copy: Path) -> None:
    (copy / "summary.json").unlink()
    sql(copy, "DELETE FROM steps WHERE step_id = '4dots/p1/after'")
    (copy / "images" / "left-over.png").write_bytes(b"")
    done = command("check", copy)
    assert done.exit_code == 0, done.output
    assert "intact, unfinished: 1/2 presses" in done.output
    assert re.search(r"open +4dots/p1 ", done.output)
    held = claim(copy)
    assert "being written now" in command("check", copy).output
    held.close()


def test_other_folders_are_input_errors(tmp_path: Path) -> None:
    for verb in (["check"], ["show"], ["note", "text"]):
        done = CliRunner().invoke(main, ["record", verb[0], str(tmp_path), *verb[1:]])
        assert isinstance(done.exception, InputError), verb
        assert "not a run folder" in str(done.exception)


@pytest.mark.slow
def test_resume_reports_lost_image(mini: tuple[Path, Path], copy: Path) -> None:
    protocol, rig = map(str, mini)
    summary = run_experiment(RunRequest(protocol, rig, copy, seed=3), resume=True)
    assert summary["already_finished"]
    lost = first_image(copy)
    lost.unlink()
    text = rf"damaged after its end: .*{lost.name}: No such file.*--resume"
    with pytest.raises(RunFailed, match=text):
        run_experiment(RunRequest(protocol, rig, copy, seed=3), resume=True)
    (copy / "summary.json").unlink()  # as the error advises
    summary = run_experiment(RunRequest(protocol, rig, copy, seed=3), resume=True)
    assert list(summary["redone"]) == ["4dots/p1"]
    assert check_run(copy).intact


def test_notes_during_and_after_a_run(copy: Path) -> None:
    held = claim(copy)  # as the process that carries it out
    assert command("note", copy, "the gel looks dry").exit_code == 0
    held.close()
    with (copy / "notes.jsonl").open("a") as file:
        file.write('{"wall_s": 1')  # by a process that was killed
    assert command("note", copy, "wetted: ü").exit_code == 0
    notes = open_run(copy).notes()
    assert notes["text"].tolist() == ["the gel looks dry", "wetted: ü"]
    assert notes["wall_s"].is_monotonic_increasing
    shown = command("show", copy).output
    assert "the gel looks dry" in shown
    assert "wetted: ü" in shown
    with pytest.raises(InputError, match="1 to 4000"):
        RunNote(" ").add_to(copy)


def test_show_tells_what_a_run_is(mini_run: Path) -> None:
    lines = [line.split(maxsplit=1) for line in command("show", mini_run).output.splitlines()]
    told = {line[0]: line[1] for line in lines if len(line) == 2}
    keys = ("protocol", "simulated", "seed", "state", "events.complete")
    assert [told[key] for key in keys] == ["mini", "yes", "3", "finished", "2"]
    found = json.loads(command("show", mini_run, "--json").output)
    assert found["presses"] == 2
    assert found["sessions"] == 1
    assert found["registration"]["origin_machine_mm"] == [-60.0, -60.0, -40.0]
    assert found["indenters"] == ["sphere:10 mounted", "4dots mounted"]
