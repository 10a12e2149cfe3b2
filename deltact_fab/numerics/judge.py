"""What a case came to, against what was expected of it."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import DeltactFabError

if TYPE_CHECKING:
    from .engine import Case


def judge(case: Case, scratch: Path) -> dict[str, Any]:
    """One row of the stability table: what was expected, what came, and the verdict."""
    start_s = time.perf_counter()
    figure: float | None = None
    note = ""
    try:
        found = case.check(scratch)
        figure, note = found if isinstance(found, tuple) else (found, "")
        figure = float(figure)
    except DeltactFabError as why:
        note = " ".join(str(why).split())
        came = "refused"
    except Exception as why:  # a crash is a verdict of its own
        note = f"{type(why).__name__}: {' '.join(str(why).split())}"[:300]
        came = "crashed"
    else:
        within = case.bound is not None and math.isfinite(figure) and abs(figure) <= case.bound
        came = "right" if within else "off"
    if came == "refused" and case.says not in note:
        came, note = "off", f"refused for another reason: {note}"
    wanted = case.expectation.split(" or ")
    return {
        "case": case.name,
        "expectation": case.expectation,
        "bound": case.bound,
        "unit": case.unit,
        "figure": plain(figure),
        "outcome": came if came in wanted else "wrong",
        "note": note,
        "seconds": time.perf_counter() - start_s,
    }


def plain(value: Any) -> Any:
    """JSON knows no NaN: a figure that is none is null."""
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
