"""`deltact-fab pattern` as it is typed."""

from __future__ import annotations

import hashlib
import json
import sys

import pytest

from deltact_fab.cli.main import entry


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Type a command in an empty folder: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def typed(line):
        monkeypatch.setattr(sys, "argv", ["deltact-fab", "pattern", *line.split()])
        with pytest.raises(SystemExit) as done:
            entry()
        said = capsys.readouterr()
        return done.value.code, said.out, said.err

    return typed


def test_make_from_d_and_r_with_dots(run, tmp_path):
    code, out, err = run("make -d 0.15 -r 0.1 --size 35 --seed 7 --dots -o out.png --json")
    assert (code, err) == (0, "")
    made = json.loads(out)
    assert made["files"] == ["out.png", "out.dots.csv"]
    assert (made["size_mm"], made["n"], made["dpi"], made["seed"]) == (34.95, 233, 1200, 7)
    assert (made["law"], made["d"], made["r"]) == ("algorithm1", 0.15, 0.1)
    content = (tmp_path / "out.png").read_bytes()
    assert made["sha256"] == hashlib.sha256(content).hexdigest()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.dots.csv", "out.png"]


def test_make_a_named_recipe_and_show_it(run):
    code, out, _ = run("make dense -o x.png")
    assert code == 0
    assert "466 x 466 whole patches, d 0.075 mm, r 0.6, seed 7" in out
    assert "34.95 x 34.95 mm (35 mm requested)" in out
    code, out, _ = run("show x.png --json")
    assert code == 0
    assert json.loads(out)["patch_mm"] == 0.075
    code, out, _ = run("list")
    assert code == 0
    assert "dense-with-dots" in out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("-d 0.1 -r 1 -o p.png", "; 0 <= r < 1"),
        ("-d 0.1 -r nan -o p.png", "; 0 <= r < 1"),
        ("-d nan -r 0.1 -o p.png", "; 0 < patch_mm <= 300"),
        ("-d 5 -r 0.1 --size 2 -o p.png", "at most the side, 2 mm"),
        ("dense --dpi 5 -o p.png", "use 339 to 7994"),
        ("dense --dpi -3 -o p.png", "above 0"),
        ("dense -d 0.1 -o p.png", "not both"),
        ("-o p.png", "give a RECIPE"),
        ("dens -o p.png", "did you mean 'dense'?"),
        ("dense -o no/p.png", "no folder no; create it first"),
        ("dense -o .", "is a folder"),
        ("dense --seed -4 -o p.png", "seed"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(run, tmp_path, line, said):
    code, out, err = run(f"make {line}")
    assert (code, out) == (2, "")
    assert said in err
    assert err.startswith("deltact-fab: ")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
