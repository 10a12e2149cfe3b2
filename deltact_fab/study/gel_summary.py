"""What jobs report of their gel (`press_jobs.gel_of`), in words for a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def interpolation(gel: Sequence[dict[str, Any]], settled: str) -> dict[str, str]:
    """The worst error between solved poses, under its name; empty where none was tried.

    settled: what is taken at solved poses alone ("points", "frames").
    """
    tried = [one for one in gel if one["between_samples"]]
    if not tried:
        return {}
    return {
        "gel's interpolation": f"between solved poses off by at most "
        f"{max(g['between_n'] for g in tried):.2g} N and "
        f"{max(g['between_mm'] for g in tried):.2g} mm in plane; settled {settled} are solved poses"
    }
