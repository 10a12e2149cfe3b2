"""cad/view.py, the file that CQ-editor opens."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from deltact_fab.paths import shipped_folder

VIEW = shipped_folder("cad") / "view.py"


def _shown(source: Path) -> dict[str, dict]:
    """What a viewer is handed when it runs the file with its own show_object."""
    seen: dict[str, dict] = {}

    def show_object(solid, name, options):
        assert solid.isValid()
        seen[name] = options

    runpy.run_path(str(source), init_globals={"show_object": show_object})
    return seen


@pytest.mark.slow
def test_viewer_gets_pieces_with_colours():
    seen = _shown(VIEW)
    assert len(seen) == 10 + 3 + 1  # ten parts, of which four screws and two camera screws
    assert {"skin-0", "screw-3", "camera-screw-1"} <= set(seen)
    for options in seen.values():
        assert all(0 <= c <= 255 for c in options["color"])
        assert 0 <= options["alpha"] < 1


def test_chosen_parts_with_own_dimensions(tmp_path):
    own = tmp_path / "view.py"
    text = VIEW.read_text(encoding="utf-8")
    text = text.replace("PARTS = []", 'PARTS = ["shell", "sphere:12.5"]')
    own.write_text(text.replace("CHANGES = []", 'CHANGES = ["mount.kind=plate"]'))
    assert set(_shown(own)) == {"shell", "sphere:12.5"}


@pytest.mark.slow
def test_the_bench_with_an_indenter(tmp_path):
    own = tmp_path / "view.py"
    own.write_text(VIEW.read_text(encoding="utf-8").replace('BENCH = ""', 'BENCH = "star"'))
    seen = set(_shown(own))
    hangs = {"indenter-star-0", "tool-holder-0", "nano17-adapter-0", "nano17-0"}
    assert seen >= hangs | {"stage-plate-0", "testing-shell-0", "skin-0", "screw-3"}
    assert "shell-0" not in seen


@pytest.mark.slow
def test_outside_a_viewer_it_prints(capsys):
    runpy.run_path(str(VIEW))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 14
    assert lines[0].startswith("skin-0")
    assert "14140.63 mm3" in lines[0]
