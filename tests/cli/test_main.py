"""The command line as a user meets it: quick help, one line for an error, exit codes."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from called import called

from deltact_fab import catalog
from deltact_fab.cli import main as program
from deltact_fab.cli.main import COMMANDS
from deltact_fab.errors import InputError, RunFailed
from deltact_fab.study.registry import STUDIES

HEAVY = ("cadquery", "OCP", "scipy.sparse", "matplotlib", "pandas", "cv2", "numpy",
         "serial", "pydantic", "numba")  # fmt: skip
ASK = """
import sys
sys.argv = ["deltact-fab", *{words!r}]
from deltact_fab.cli.main import entry
try:
    entry()
except SystemExit as end:
    code = end.code
loaded = sorted(m for m in {heavy!r} if m in sys.modules)
print("@@", code, ",".join(loaded))
"""
SUBCOMMANDS = [
    *(["cad", name] for name in ("list", "show", "check", "export", "bom", "guide")),
    *(["pattern", name] for name in ("make", "quality", "sheet", "show", "series")),
    ["protocol", "check"],
    ["protocol", "show"], ["rig", "show"], ["rig", "photograph"],
    ["gel", "press"],
    ["analyze", "tracking"], ["analyze", "shape"],
    ["calibrate", "lens"], ["calibrate", "depth"], ["calibrate", "force"],
    ["study", "list"], ["study", "run"],
    *(["study", "run", name] for name in STUDIES),
]  # fmt: skip


@pytest.mark.parametrize(
    "words", [[], *([name] for name in COMMANDS), *SUBCOMMANDS], ids=lambda w: "-".join(w) or "top"
)
def test_help_loads_nothing_heavy(words: list[str]) -> None:
    script = ASK.format(words=[*words, "--help"], heavy=HEAVY)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert "Usage: deltact-fab" in done.stdout
    assert done.stdout.rsplit("@@", 1)[1].strip() == "0"


@pytest.mark.parametrize(
    ("old", "now"),
    [
        ("calibrate .", "calibrate lens ."),
        ("cad designs --jsno", "cad list designs --jsno"),
        ("pattern from DELTACT1/NONSENSE -o x.png", "pattern make DELTACT1/NONSENSE -o x.png"),
        ("study index none", "report none"),
        ("rig probe none", "rig check none"),
        ("calibrate --air . --board skin", "calibrate lens --air . --board skin"),
        ("calibrate-depth none", "calibrate depth none"),
        ("analyze force none", "calibrate force none"),
    ],
)
def test_an_old_form_does_what_the_new_one_does_and_says_so(
    old: str, now: str, tmp_path: Path
) -> None:
    done, same = (called(*words.split(), cwd=tmp_path) for words in (old, now))
    told, left = done.stderr.split("\n", 1)
    new = told.split("`")[3]
    assert now.startswith(new.removeprefix("deltact-fab "))
    assert told.endswith(f"is `{new}` now; the old name goes with 0.4")
    assert (left, done.returncode) == (same.stderr, 2)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["protocol", "check", "smok"], "did you mean 'smoke'?"),
        (["protocol", "show", "missing.toml"], "missing.toml: no such file"),
        (["run", "smoke", "--rig", "vurtual", "--out", "x"], "did you mean 'virtual'?"),
        (["gel", "press", "--indenter", "cube", "--depth", "1"], "valid: sphere:DIAMETER_MM"),
        (["gel", "press", "--depth", "nan"], "--depth nan"),
        (["gel", "press", "--depth", "1", "--tolerance", "2"], "0.001 to 0.5"),
        (["gel", "press", "--depth", "1", "--limit-s", "0"], "more than 0 seconds"),
        (["gel", "press", "--depth", "1", "--poisson", "0.6"], "poisson"),
        (["gel", "press", "--depth", "1", "--at", "3"], "two numbers"),
        (["analyze", "tracking", "."], "not a run folder"),
        (["report", "nowhere"], "nowhere: no such folder"),
        (["analyse"], "no such command; did you mean 'analyze'?"),
        (["cad", "exprt"], "no such command; did you mean 'export'?"),
        (["cad", "show", "shell", "--desing", "x"], "Did you mean '--design'?"),
        (["study", "run", "shpes"], "no such study; did you mean 'shapes'?"),
        (["cad", "show", "shel"], "did you mean 'shell'?"),
        (["cad", "check", "--set", "skin.widht_mm=3"], "did you mean 'width_mm'?"),
        (
            ["cad", "export", "--set", "skin.width_mm=24", "--set", "skin.length_mm=24"],
            "room between the posts",
        ),
        (["cad", "export", "--format", "obj"], "format 'obj': unknown"),
        (["cad", "export", "skin", "--tolerance", "nan"], "expected 0.001 to 1 mm"),
        (["cad", "bom", "--sensors", "0"], "sensors"),
        (["cad", "guide", "--design", "deltakt"], "did you mean 'deltact'?"),
        (["pattern", "quality", "dens"], "did you mean 'dense'?"),
        (["pattern", "sheet", "dense", "-o", "x.jpg"], "end the name in .pdf"),
        (["pattern", "sheet", "dense", "--scale-x", "1.5", "-o", "x.pdf"], "scale x: 1.5"),
        (["pattern", "make", "DELTACT1/NONSENSE", "-o", "x.png"], "code"),
        (["pattern", "make", "DELTACT1/NONSENSE", "--dots", "-o", "x.png"], "code"),
        (["study", "run", "shapes", "--rig", ""], "--rig: empty; give a value"),
        (["cad", "check", "--design="], "--design: empty"),
        (["record", "show", ""], "an argument: empty"),
        (["pattern", "series", "--out", "."], "folder"),
        (["run", "smoke"], "--out"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(words: list[str], says: str, tmp_path: Path) -> None:
    done = called(*words, cwd=tmp_path)
    assert says in done.stderr
    assert (done.returncode, done.stderr.count("\n"), done.stdout) == (2, 1, "")
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "to", "code", "says"),
    [
        ("schema", "/dev/full", 1, "deltact-fab: output: cannot be written: No space left on dev"),
        ("rig list --json", "/dev/full", 1, "deltact-fab: output: cannot be written: No space le"),
        ("--help", "/dev/full", 1, "deltact-fab: output: cannot be written: No space left on dev"),
        ("completion bash", "/dev/full", 1, "deltact-fab: output: cannot be written: No space le"),
        ("schema protocol", "pipe", 1, ""),
    ],
)
def test_a_full_disk_is_exit_1_and_a_closed_pipe_is_silent(
    words: str, to: str, code: int, says: str
) -> None:
    read, write = os.pipe()
    os.close(read)
    with open(to if to != "pipe" else write, "w") as out:
        done = subprocess.run(
            [sys.executable, "-m", "deltact_fab", *words.split()],
            stdout=out, stderr=subprocess.PIPE, text=True, check=False, timeout=60,
        )  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (code, int(bool(says)))
    assert done.stderr.startswith(says)


@pytest.mark.parametrize("kind", [InputError, RunFailed])
def test_a_full_disk_is_exit_1_whatever_met_it(
    kind: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**options: object) -> None:
        raise kind("out: cannot be written") from OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr(program, "main", full)
    done = called("schema")
    assert (done.returncode, done.stderr) == (1, "deltact-fab: out: cannot be written\n")


@pytest.mark.slow
def test_a_sensor_s_number_is_shown_with_its_protocol(tmp_path: Path) -> None:
    text = catalog.find("protocols", "smoke").read_text()
    (tmp_path / "mine.toml").write_text(text.replace("[specimen]", '[specimen]\nserial = "DT-007"'))
    shown = called("protocol", "show", "mine.toml", cwd=tmp_path).stdout
    assert shown.startswith(
        "specimen: design deltact, pattern dense-with-dots, serial number DT-007\n"
    )
    data = json.loads(called("protocol", "show", "mine.toml", "--json", cwd=tmp_path).stdout)
    assert data["specimen"]["serial"] == "DT-007"


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    done = called("--debug", "protocol", "check", "smok", cwd=tmp_path)
    assert "Traceback" in done.stderr


@pytest.mark.slow
def test_a_check_that_fails_is_exit_1(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "protocols" / "smoke.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace("[1.0]", "[11.5]"))
    done = called("protocol", "check", "p.toml", cwd=tmp_path)
    assert done.returncode == 1
    assert "FAIL  depth against the gel: depth (mm) 11.5 (limit 11)" in done.stdout


@pytest.mark.slow
def test_the_linear_level_refuses_a_depth_and_names_the_level_that_would_do(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "protocols" / "smoke.toml").read_text()
    text = text.replace("[1.0]", "[3.5]").replace('"sphere:10", "4dots"', '"sphere:10"')
    (tmp_path / "p.toml").write_text(text)
    done = called("run", "p.toml", "--out", "r", cwd=tmp_path)
    assert done.returncode == 2
    assert "hyperelastic" in done.stderr
    assert not (tmp_path / "r").exists()


@pytest.mark.slow
def test_gel_press_prints_what_the_json_says(tmp_path: Path) -> None:
    words = ["gel", "press", "--depth", "0.6", "--model", "linear", "--spacing", "0.4"]
    data = json.loads(called(*words, "--json", cwd=tmp_path).stdout)
    assert data["converged"] is True
    assert data["force_n"][2] < 0
    assert data["max_stretch"] is None
    shown = called(*words, cwd=tmp_path).stdout
    assert f"{data['force_n'][2]:+.3f} N (simulated)" in shown
    assert "chosen: linear (asked for): grid 0.4 mm" in shown


PRESS_KEYS = {
    "force_n", "depth_mm", "contact_area_mm2", "contact_area_error_mm2", "stick_area_mm2",
    "stick_area_error_mm2", "centroid_mm", "max_stretch", "model", "converged",
    "error_estimate", "within_tolerance", "seconds", "picked", "peak_in_plane_mm", "flags",
}  # fmt: skip


@pytest.mark.slow
def test_gel_press_refused_has_the_same_keys_and_exit_1(tmp_path: Path) -> None:
    done = called("gel", "press", "--depth", "4", "--model", "linear", "--json", cwd=tmp_path)
    data = json.loads(done.stdout)
    assert done.returncode == 1
    assert data["converged"] is False
    assert data["force_n"] is None
    assert "25%" in data["reason"]
    assert "hyperelastic can" in data["reason"]
    assert set(data) == PRESS_KEYS | {"reason"}
    done = called("gel", "press", "--depth", "12", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        "deltact-fab: gel: depth 12 mm is not below the gel's thickness of 12 mm"
    ]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--depth", "-1"], "--depth -1"),
        (["--depth", "nan"], "--depth nan"),
        (["--depth", "1", "--indenter", "nosuch"], "'nosuch': unknown"),
        (["--depth", "1", "--limit-s", "nan"], "--limit-s nan"),
        (["--depth", "1", "--thickness", "-3"], "thickness_mm"),
        (["--depth", "1", "--modulus", "0"], "modulus_mpa"),
    ],
)
def test_what_gel_press_cannot_use_is_refused_in_json_too(words: list[str], says: str) -> None:
    done = called("gel", "press", *words, "--json")
    data = json.loads(done.stdout)
    assert done.returncode == 2
    assert set(data) == PRESS_KEYS | {"reason"}
    assert (data["converged"], data["force_n"]) == (False, None)
    assert says in data["reason"]
    assert len(done.stderr.splitlines()) == 1
    assert says in done.stderr


@pytest.mark.parametrize(("modulus", "warns"), [("0.009", True), ("10", False), ("56", True)])
def test_gel_press_warns_of_a_modulus_that_no_gel_has(
    modulus: str, warns: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DELTACT_FAB_CACHE", str(tmp_path))
    words = ["--depth", "0.6", "--model", "linear", "--spacing", "0.5", "--modulus", modulus]
    done = called("gel", "press", *words, "--json")
    assert done.returncode == 0
    flags = json.loads(done.stdout)["flags"]
    said = [f for f in flags if f.startswith("modulus: ") and "0.01 to 10 MPa" in f]
    assert bool(said) == warns
    assert ("warning: modulus: " in done.stderr) == warns


@pytest.mark.slow
def test_gel_press_ends_at_its_limit_of_time(tmp_path: Path) -> None:
    words = ["gel", "press", "--indenter", "star", "--at", "1,0", "--depth", "3"]
    done = called(*words, "--tolerance", "0.005", "--limit-s", "0.01", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    # A machine that is busy for 5 s has told its progress too.
    said = [line for line in done.stderr.splitlines() if not line.startswith("gel press: ")]
    assert said == [
        "deltact-fab: --limit-s 0.01: no mesh was solved in that CPU time; more is needed"
    ]


@pytest.mark.parametrize(
    ("place", "says"),
    [("f.gif", ".png, .svg, .pdf is needed"), ("no/f.png", "there is no folder no")],
)
def test_gel_refuses_a_figures_place_before_it_solves(
    tmp_path: Path, place: str, says: str
) -> None:
    (tmp_path / "press.csv").write_text("depth_mm,normal_n\n")  # fit would refuse it, later
    words = ["fit", "press.csv", "--indenter", "sphere:10", "--plot", place]
    done = called("gel", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.splitlines() == [f"deltact-fab: --plot {place}: {says}"]


@pytest.mark.slow
def test_gel_press_picks_finite_strain_and_estimates_its_error(tmp_path: Path) -> None:
    words = ["--depth", "2", "--shear-x", "1", "--tolerance", "0.15"]
    done = called("gel", "press", "--model", "hyperelastic", *words, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert set(data) == PRESS_KEYS
    assert data["model"] == "hyperelastic"
    assert data["picked"]["mirrors"] == [False, True]
    assert data["within_tolerance"] is True
    assert 0 < data["error_estimate"]["force_rel"] < 0.15
    assert data["max_stretch"] > 1.05
    # 8.0 N is where fine meshes meet without shear; dragging moves it by some per cent.
    assert -data["force_n"][2] == pytest.approx(8.0, rel=0.1)
    assert 0 < data["force_n"][0] < 0.5 * -data["force_n"][2] * 1.3
