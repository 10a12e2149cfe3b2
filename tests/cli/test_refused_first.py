"""What is wrong with a command is said before a port is opened or a folder is made."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from deltact_fab.cli.main import main
from deltact_fab.errors import InputError

FILE = """
kind = "grbl"
[stage]
port = "/dev/not-there"
origin_machine_mm = [-60.0, -60.0, -40.0]
travel_mm = [120.0, 120.0, 60.0]
max_feed_mm_min = [1500.0, 1500.0, 1200.0]
acceleration_mm_s2 = [2000.0, 2000.0, 2000.0]
[force]
range_n = [25.0, 25.0, 35.0]
[force.netft]
host = "127.0.0.1"
"""


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("rig jog b.toml nan 0 0", "nan is not a finite number"),
        ("rig jog b.toml 0 0 500", "500 mm is more than 10; give --most 500"),
        ("rig jog b.toml 0 0 1 --feed -3", "-3"),
        ("rig goto b.toml 0 0 inf --as-counted", "inf is not a finite number"),
        ("rig goto b.toml 0 0 9 --as-counted --clearance -1", "-1"),
        ("rig check b.toml --seconds nan", "nan is not a finite number"),
        ("rig register b.toml -o f.toml --indenter 4dots", "registered with a ball"),
        ("rig register b.toml -o f.toml --at nan,0", "two numbers are needed"),
        (
            "rig register b.toml -o gone/f.toml",
            "gone/f.toml: there is no folder gone; create it first",
        ),
        ("run first-moves --air --out r --seed -1", "-1"),
        ("run first-moves --air --out r --note ''", "--note: empty; give a value, or leave it out"),
        ("run first-moves --air --out r --note a\x01b", "no character that can be printed"),
    ],
)
def test_it_is_refused_with_nothing_opened_or_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b.toml").write_text(FILE)
    done = CliRunner().invoke(main, [w.strip("'") for w in words.split(" ")])
    told = done.output if isinstance(done.exception, SystemExit) else str(done.exception)
    assert says in told
    assert isinstance(done.exception, InputError) or done.exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["b.toml"]
