"""A short run of small images: its files, its finished folder, and ways to break it off."""

from __future__ import annotations

import shutil
import sqlite3
from functools import cached_property
from pathlib import Path
from typing import Any

from rig_text import VIRTUAL_STAGE

from deltact_fab.bench.protocols import plan
from deltact_fab.bench.record.journal import PRESS_TABLES
from deltact_fab.simulate.experiment.request import RunRequest
from deltact_fab.simulate.experiment.session import run_experiment

# Tail of a protocol: quick moves, short waits.
QUICK = """[capture]
settle_s = 0.3
[motion]
clearance_mm = 2.0
press_feed_mm_min = 120.0
travel_feed_mm_min = 1200.0
[specimen]
design = "{design}"
"""
# Two positions of two indenters, so that a resume may start after a change or after a press.
PROTOCOL = """
name = "tiny"
indenters = ["sphere:6", "sphere:8"]
positions_mm = [[0.0, 0.0], [1.0, 0.5]]
depths_mm = [0.4]
channels = ["image", "dots", "force", "shear"]
[shear]
amplitude_mm = 0.5
axes = ["x"]
[capture]
rate_hz = 1.0
settle_s = 0.3
[specimen]
design = "{design}"
"""
# 24 presses in random order, with repeats, a drag, two depths at one place, a tip that is mounted
# twice, and reference presses.
MIXED = (
    """
name = "mixed"
order = "random"
order_seed = 3
channels = ["image", "force", "shear"]
press = [
    {{indenter = "sphere:6", depth_mm = 0.3, repeats = 3}},
    {{indenter = "sphere:6", depth_mm = 0.5, repeats = 2}},
    {{indenter = "sphere:6", depth_mm = 0.4, x_mm = 2.0, shear_x_mm = 0.3, role = "validate"}},
    {{indenter = "sphere:6", depth_mm = 0.4, x_mm = -2.0, y_mm = 1.0, repeats = 3}},
    {{indenter = "sphere:8", depth_mm = 0.3, repeats = 2}},
    {{indenter = "sphere:8", depth_mm = 0.4, y_mm = 1.0, repeats = 2}},
    {{indenter = "sphere:6", depth_mm = 0.2, repeats = 2}},
    {{indenter = "sphere:6", depth_mm = 0.5, x_mm = 2.0}},
]
[reference]
every = 4
depth_mm = 0.4
"""
    + QUICK
)
DESIGN = """
[optics]
image_width_px = 160
image_height_px = 120
"""
RIG = f"""{VIRTUAL_STAGE}[force]
range_n = [25.0, 25.0, 35.0]
range_nmm = [250.0, 250.0, 250.0]
[virtual.gel]
spacing_mm = 0.5
press_increment_mm = 0.4
shear_increment_mm = 0.5
"""


def first_press(run: Path, out: Path) -> Path:
    """A copy of a run with the images of its first press alone, before it is sheared."""
    shutil.copytree(run, out)
    with sqlite3.connect(out / "journal.sqlite") as db:
        db.execute(
            "DELETE FROM frames WHERE kind = 'shear' OR step_id LIKE '%/after' "
            "OR press <> (SELECT press FROM frames ORDER BY seq LIMIT 1)"
        )
    db.close()
    return out


class ShortRun:
    """protocol, rig: paths of the files. presses: names, in order."""

    def __init__(self, folder: Path, protocol: str = PROTOCOL, tables: str = "") -> None:
        """tables: added to the rig file."""
        self.folder, self.protocol, self.rig = folder, folder / "tiny.toml", folder / "bench.toml"
        (folder / "design.toml").write_text(DESIGN)
        self.protocol.write_text(protocol.format(design=folder / "design.toml"))
        self.rig.write_text(RIG + tables)
        self.steps = plan.expand_protocol(plan.load_protocol(str(self.protocol))[0])
        self.presses = list(dict.fromkeys(step.press for step in self.steps))

    @cached_property
    def finished(self) -> Path:
        """The folder of the undisturbed run."""
        out = self.folder / "undisturbed"
        run_experiment(RunRequest(str(self.protocol), str(self.rig), out, seed=3))
        return out

    def words(self, out: Path, *more: str) -> list[str]:
        """Of the command that runs it."""
        files = [str(self.protocol), "--rig", str(self.rig)]
        return ["run", *files, "--seed", "3", "--out", str(out), *more]

    def resume(self, out: Path, **other: Any) -> dict[str, Any]:
        """Go on with it; its summary."""
        seed = other.get("seed", 3)
        protocol, rig = (other.get(name, str(getattr(self, name))) for name in ("protocol", "rig"))
        return run_experiment(RunRequest(protocol, rig, out, seed=seed), resume=True)

    def unfinished(self, out: Path, press: str = "") -> Path:
        """A copy of the finished run without its summary, and without a press and what follows."""
        shutil.copytree(self.finished, out)
        (out / "summary.json").unlink()
        gone = self.presses[self.presses.index(press) :] if press else []
        with sqlite3.connect(out / "journal.sqlite") as db:
            for name in gone:
                for table in PRESS_TABLES:
                    db.execute(f"DELETE FROM {table} WHERE press = ?", (name,))
        db.close()
        return out
