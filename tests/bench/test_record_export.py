"""Exports of a run hold every row at its time, and the same pixels."""

from __future__ import annotations

import base64
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from deltact_fab.app.cli.main import main
from deltact_fab.bench.protocols.plan import Step
from deltact_fab.bench.record.export import export_run
from deltact_fab.bench.record.export.lerobot import MM_PER_LEVEL, MOTION_KEY, RAW_KEY
from deltact_fab.bench.record.export.tables import TABLE_COLUMNS, TimeLine
from deltact_fab.bench.record.notes import RunNote
from deltact_fab.bench.record.run import Run, open_run
from deltact_fab.bench.record.streams import Chunk
from deltact_fab.bench.record.writer import RunWriter
from deltact_fab.common.errors import InputError, RunFailed
from deltact_fab.estimate.analysis.flows import open_follower
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

OF_0_2 = Path(__file__).parents[1] / "data" / "run-format-5"
FORCE = ["fx_n", "fy_n", "fz_n", "tx_nmm", "ty_nmm", "tz_nmm"]


@pytest.fixture(scope="module")
def run(mini_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """With a note, so that there is one to export."""
    folder = tmp_path_factory.mktemp("exported") / "run"
    shutil.copytree(mini_run, folder)
    RunNote("a note").add_to(folder)
    return open_run(folder)


def messages(path: Path) -> dict[str, list[tuple[int, dict]]]:
    """All messages by topic, in the file's order."""
    found: dict[str, list[tuple[int, dict]]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(
            log_time_order=False
        ):
            assert schema is not None
            data = json.loads(message.data)
            assert data.keys() <= json.loads(schema.data)["properties"].keys()
            found.setdefault(channel.topic, []).append((message.log_time, data))
    return found


@pytest.mark.slow
def test_mcap_has_every_message_at_time(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    done = CliRunner().invoke(
        main, ["record", "export", str(run.folder), "--format", "mcap", "-o", str(out), "--json"]
    )
    assert done.exit_code == 0, done.output
    found = messages(out)
    line, frames = TimeLine.from_run(run), run.frames()
    for topic, table in (
        ("/camera/image", frames), ("/stage/pose", run.pose()), ("/force/wrench", run.force()),
    ):  # fmt: skip
        wanted = [
            t
            for press, part in table.groupby("press", sort=False)
            for t in line.press_time_ns(str(press), part["t_s"].to_numpy())
        ]
        assert [t for t, _ in found[topic]] == wanted, topic
        assert json.loads(done.stdout)["rows"][topic] == len(table)
    z_m = [m["pose"]["position"]["z"] for _, m in found["/stage/pose"]]
    np.testing.assert_allclose(np.array(z_m) * 1e3, run.pose()["z_mm"], atol=1e-9)
    force = [[m["wrench"]["force"][a] for a in "xyz"] for _, m in found["/force/wrench"]]
    np.testing.assert_array_equal(force, run.force()[["fx_n", "fy_n", "fz_n"]].to_numpy())
    tz_nm = [m["wrench"]["torque"]["z"] for _, m in found["/force/wrench"]]
    np.testing.assert_allclose(np.array(tz_nm) * 1e3, run.force()["tz_nmm"], rtol=1e-12)
    for time_ns, message in found["/stage/pose"][:5]:
        stamp = message["timestamp"]
        assert stamp["sec"] * 1_000_000_000 + stamp["nsec"] == time_ns
    for (_, image), file in zip(found["/camera/image"], frames["file"], strict=True):
        seen = cv2.imdecode(np.frombuffer(base64.b64decode(image["data"]), np.uint8), 1)
        assert np.array_equal(seen, run.raw(file))
    with out.open("rb") as file:
        reader = make_reader(file)
        times = [m.log_time for _, _, m in reader.iter_messages(log_time_order=False)]
        assert times == sorted(times)
        told = {m.name: m.metadata for m in reader.iter_metadata()}
        names = {s.name for s in reader.get_summary().schemas.values()}
    assert told["deltact-fab"]["simulated"] == "true"
    assert told["deltact-fab"]["seed"] == "3"
    assert {"foxglove.CompressedImage", "foxglove.PoseInFrame"} <= names
    # What base64 adds to an image, the chunks' packing takes back.
    assert out.stat().st_size < 1.4 * sum(f.stat().st_size for f in run.folder.rglob("*.png"))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_exported_tables_match_the_record(run: Run, tmp_path: Path, form: str) -> None:
    out = tmp_path / "out"
    rows = export_run([run], form, out)
    read = pd.read_csv if form == "csv" else pd.read_parquet
    wanted = {
        "frames": run.frames(), "force": run.force(), "pose": run.pose(), "steps": run.steps()
    }  # fmt: skip
    for name, table in wanted.items():
        found = read(out / f"{name}.{form}")
        assert list(found) == list(TABLE_COLUMNS[name])
        assert rows[name] == len(found) == len(table)
        for column in set(found) - {"time_ns"}:
            if column in table:
                a, b = found[column].to_numpy(), table[column].to_numpy()
                if table[column].dtype.kind in "fi":
                    np.testing.assert_array_equal(a.astype(float), b.astype(float), column)
                else:
                    assert a.tolist() == b.tolist(), column
    events = read(out / f"events.{form}")
    assert events["kind"].tolist().count("note") == 1
    assert len(events) == len(run.events()) + 1
    assert json.loads((out / "run.json").read_text())["seed"] == 3


def test_parquet_has_the_run_with_it(run: Run, tmp_path: Path) -> None:
    export_run([run], "parquet", tmp_path / "out")
    file = pq.ParquetFile(tmp_path / "out" / "force.parquet")
    schema = file.schema_arrow
    assert "UTC" in str(schema.field("time_ns").type)
    assert (schema.metadata[b"simulated"], schema.metadata[b"seed"]) == (b"true", b"3")
    assert file.num_row_groups == 4  # press by press


def test_old_and_interrupted_runs_are_exported(run: Run, tmp_path: Path) -> None:
    assert export_run([open_run(OF_0_2)], "csv", tmp_path / "old")["frames"] == 10
    cut = tmp_path / "cut"
    shutil.copytree(run.folder, cut)
    (cut / "summary.json").unlink()
    with closing(sqlite3.connect(cut / "journal.sqlite")) as db, db:
        db.execute("DELETE FROM steps WHERE step_id LIKE '4dots/p1/%'")
    assert export_run([open_run(cut)], "csv", tmp_path / "out")["frames"] == len(run.frames())


@pytest.mark.parametrize("form", ["csv", "mcap", "lerobot"])
def test_failed_export_leaves_nothing(run: Run, tmp_path: Path, form: str) -> None:
    spoilt = tmp_path / "run"
    shutil.copytree(run.folder, spoilt)
    with closing(sqlite3.connect(spoilt / "journal.sqlite")) as db, db:
        db.execute("UPDATE samples SET data = x'00' WHERE stream = 'pose' AND press = '4dots/p1'")
    with pytest.raises(RunFailed, match="damaged"):
        export_run([open_run(spoilt)], form, tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_invalid_export_is_one_line(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="already exists"):
        export_run([run], "csv", tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        export_run([run], "csv", tmp_path / "none" / "out")
    with pytest.raises(InputError, match="lerobot takes several"):
        export_run([run, run], "csv", tmp_path / "out")


@pytest.mark.slow
def test_lerobot_has_frames_and_quantised_motion(run: Run, tmp_path: Path) -> None:
    """`benchmarks/datasets.py` asks its own loader."""
    av = pytest.importorskip("av")
    counts = export_run([run, run], "lerobot", tmp_path / "out", follow=open_follower)
    frames = run.frames()
    data = pd.read_parquet(tmp_path / "out" / "data")
    assert counts["frames"] == 2 * len(frames) == len(data)
    wrench = np.stack(data["observation.wrench"].tolist())
    twice = pd.concat([frames, frames])
    np.testing.assert_array_equal(wrench, twice[FORCE].to_numpy().astype(np.float32))
    touched = data["observation.contact"].to_numpy()
    np.testing.assert_array_equal(touched, (twice["fz_n"] < -0.1).to_numpy())
    info = json.loads((tmp_path / "out" / "meta" / "info.json").read_text())
    assert info["total_episodes"] == 2 * frames["press"].nunique()
    seen = {}
    for key in (RAW_KEY, MOTION_KEY):
        with av.open(tmp_path / "out" / "videos" / key / "chunk-000" / "file-000.mp4") as video:
            shown = [(f.time, f.to_ndarray(format="rgb24")) for f in video.decode(video=0)]
        assert [t for t, _ in shown] == [k / info["fps"] for k in range(2 * len(frames))]
        seen[key] = [image for _, image in shown]
    track = open_follower(run)
    for at, file in enumerate(frames[frames["press"] == frames["press"].iloc[0]]["file"]):
        motion = track(run.image(file))
        shift = (seen[MOTION_KEY][at][..., :2].astype(float) - 128) * MM_PER_LEVEL
        inside = np.abs(motion.shift_mm) < 127 * MM_PER_LEVEL
        assert np.abs(shift - motion.shift_mm)[inside].max() <= MM_PER_LEVEL / 2 + 1e-6
        assert np.array_equal(seen[MOTION_KEY][at][..., 2] == 255, motion.known)
        off = cv2.cvtColor(seen[RAW_KEY][at], cv2.COLOR_RGB2BGR).astype(float) - run.raw(file)
        assert 10 * np.log10(255**2 / np.mean(off**2)) > 35


def test_jpeg_xl_is_exported_as_png(tmp_path: Path) -> None:
    pytest.importorskip("imagecodecs")
    step = Step("ball/p1/rest", "ball/p1", "sphere:10", "travel", (0, 0, 5.0), 30.0, 1)
    meta = {
        "name": "t", "simulated": False, "seed": 0, "camera": None,
        "rig": {"camera": {"format": "jxl"}},
    }  # fmt: skip
    writer = RunWriter.create(tmp_path / "run", meta, b"", {}, [step])
    image = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    writer.frame(step, 1, image, 3.0, 0.5, 2.5)
    writer.step(step, 1.0, 2.5, 3.5, [])
    writer.close({})
    run = open_run(tmp_path / "run")
    assert run.frames()["file"].iloc[0].endswith(".jxl")
    export_run([run], "mcap", tmp_path / "out.mcap")
    [(_, message)] = messages(tmp_path / "out.mcap")["/camera/image"]
    assert message["format"] == "png"
    data = np.frombuffer(base64.b64decode(message["data"]), np.uint8)
    assert np.array_equal(cv2.imdecode(data, 1), image)


@pytest.mark.slow
def test_time_line_spans_all_sessions(mini: tuple[Path, Path], run: Run, tmp_path: Path) -> None:
    again = tmp_path / "run"
    shutil.copytree(run.folder, again)
    (again / "summary.json").unlink()
    sorted((again / "images").glob("sphere-10*"))[0].unlink()
    protocol, rig = map(str, mini)
    run_experiment(RunRequest(protocol, rig, again, seed=3), resume=True)
    resumed = open_run(again)
    line = TimeLine.from_run(resumed)
    assert len(line.offsets_ns) == 2
    assert line.press_session["4dots/p1"] == 0
    assert line.press_session["sphere-10/p1"] == 1
    spans = {
        press: line.press_time_ns(str(press), part[["t_start_s", "t_end_s"]].to_numpy())
        for press, part in resumed.steps().groupby("press", sort=False)
    }
    assert spans["4dots/p1"].max() <= spans["sphere-10/p1"].min()  # though it comes later
    begun = resumed.events()["wall_s"].min()
    assert 0 <= spans["sphere-10/change"].min() / 1e9 - begun < 600
    export_run([resumed], "mcap", tmp_path / "out")
    times = [t for found in messages(tmp_path / "out").values() for t, _ in found]
    assert min(times) / 1e9 >= begun - 1e-3


def test_a_chunk_keeps_its_nanoseconds(tmp_path: Path) -> None:
    """Stamps of a machine that has been up for months, on the day's time."""
    step = Step("ball/p1/rest", "ball/p1", "sphere:10", "travel", (0, 0, 5.0), 30.0, 0)
    meta = {"name": "t", "simulated": False, "seed": 0, "camera": None}
    writer = RunWriter.create(tmp_path / "run", meta, b"", {}, [step])
    up_s = 1e7 + 0.123456789
    t_ns = np.arange(5, dtype=np.int64) * 1_000_001
    zero = np.zeros(5)
    columns = {"t_ns": t_ns, "x_mm": zero, "y_mm": zero, "z_mm": zero}
    writer.event("homed", "", up_s)
    writer.step(step, 1.0, up_s, up_s + 1, [Chunk("pose", up_s, columns)])
    writer.close({})
    export_run([open_run(tmp_path / "run")], "mcap", tmp_path / "out")
    times = np.array([t for t, _ in messages(tmp_path / "out")["/stage/pose"]])
    assert np.abs(np.diff(times) - 1_000_001).max() <= 4
