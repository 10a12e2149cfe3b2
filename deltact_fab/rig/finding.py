"""What a look at a device of a rig found: a line of `rig check`."""

from __future__ import annotations

from typing import NamedTuple


class BenchFinding(NamedTuple):
    """One thing that was looked at."""

    passed: bool
    text: str
