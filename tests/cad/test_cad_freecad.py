"""The assembly by another kernel's front end: FreeCAD reads our STEP files and intersects them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from threads import thread_overlap_mm3

from benchmarks.cad_random import drawn
from deltact_fab.cad.assembly import assemble, bench
from deltact_fab.cad.design import load_design
from deltact_fab.cad.export.formats.step import part_bytes
from deltact_fab.cad.registry import find

FREECAD = shutil.which("freecadcmd")
SCRIPT = Path(__file__).with_name("freecad_common.py")
# Designs of benchmarks/cad_random.py that pass every row: large ones on M3 and M2.5.
RANDOM = (3, 5)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(FREECAD is None, reason="FreeCAD's freecadcmd is not here"),
]


def _seen_by_freecad(placed, folder, turn=None):
    """What freecad_common.py says of the pieces."""
    pieces = []
    for piece in placed:
        # Written where its builder made it: the shift is FreeCAD's to apply.
        file = f"{piece.part.name}.step"
        if not (folder / file).exists():
            back = piece.solid.translate(tuple(-v for v in piece.shift_mm))
            (folder / file).write_bytes(part_bytes(back, piece.part.name))
        pieces.append([piece.part.name, file, list((turn or {}).get(file, piece.shift_mm))])
    (folder / "pieces.json").write_text(json.dumps(pieces))
    done = subprocess.run(
        [FREECAD, str(SCRIPT)],
        env={**os.environ, "PIECES": str(folder)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (folder / "common.json").exists(), done.stdout + done.stderr
    return json.loads((folder / "common.json").read_text())


@pytest.mark.parametrize(
    "change",
    [[name] for name in ("deltact", "screws-19mm", "skin-44x40", "franka", "large-60x50")]
    + [["deltact", *drawn(index)] for index in RANDOM],
    ids=lambda change: change[0] if len(change) == 1 else "random",
)
def test_no_two_parts_share_volume_but_the_threads(change, tmp_path):
    name, *changes = change
    design = load_design(name, changes)
    placed = assemble(design)
    seen = _seen_by_freecad(placed, tmp_path)
    for (part, valid, solids, volume_mm3), piece in zip(seen["shapes"], placed, strict=True):
        assert (part, valid, solids) == (piece.part.name, True, 1)
        assert volume_mm3 == pytest.approx(piece.solid.Volume(), rel=1e-6)
    threads = thread_overlap_mm3(design)
    found = {key: [] for key in threads}
    for one, other, common_mm3 in seen["common"]:
        pair = next((key for key in threads if set(key) == {one, other}), None)
        if pair is None:
            assert common_mm3 <= 1e-3, (one, other)
        elif common_mm3 > 1e-3:
            found[pair].append(common_mm3)
    assert {key: len(v) for key, v in found.items()} == dict(zip(threads, (4, 2), strict=True))
    for key, volumes in found.items():
        assert volumes == pytest.approx([threads[key]] * len(volumes), rel=1e-5)
    assert seen["size"] == pytest.approx(design.outer_mm, abs=1e-5)


def test_nothing_of_the_bench_shares_volume(tmp_path):
    seen = _seen_by_freecad(bench(load_design(), find("star")), tmp_path)
    names = {name for name, *_ in seen["shapes"]}
    assert names >= {"stage-plate", "testing-shell", "tool-holder", "nano17-adapter", "nano17"}
    shared = {tuple(sorted(pair)) for *pair, common_mm3 in seen["common"] if common_mm3 > 1e-3}
    assert shared == {("screw", "skin-frame"), ("camera-holder", "camera-screw")}


def test_a_part_out_of_place_is_seen(tmp_path):
    placed = assemble(load_design())
    seen = _seen_by_freecad(placed, tmp_path, {"acrylic.step": (0.0, 0.0, 0.5)})
    clash = {frozenset(pair[:2]): pair[2] for pair in seen["common"] if pair[2] > 1e-3}
    assert clash[frozenset(("acrylic", "skin"))] > 100
