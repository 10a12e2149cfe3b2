"""What every export takes of a run."""

from __future__ import annotations

from typing import Any

from ..run import Run


def presses(run: Run) -> list[str]:
    """All presses that have rows, in the plan's order; changes of the indenter among them."""
    with run.reader() as db:
        rows = db.execute(
            "SELECT press FROM (SELECT press, wall_s FROM steps UNION ALL SELECT press, wall_s "
            "FROM frames) GROUP BY press ORDER BY min(wall_s)"
        )
        return [press for (press,) in rows]


def described(run: Run) -> dict[str, Any]:
    """What every export says of the run it is of."""
    keys = ("name", "rig_name", "simulated", "air", "seed", "format", "versions")
    return {key: run.meta.get(key) for key in keys} | {
        "protocol": (run.meta.get("protocol") or {}).get("name"),
        "finished": run.finished,
    }
