"""The page of a rehearsal: verdict, then what each fault did."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..files import write_whole
from .templating import environment, render, save


def write(found: dict[str, Any], protocol: str, rig: str, out: Path) -> list[Path]:
    """rehearsal.html and .json of `Rehearsal.as_dict()`; as `templating.save`."""
    page = render(environment(), "rehearsal.html", found=found, protocol=protocol, rig=rig)
    data = out / "rehearsal.json"
    written = [save(page, out / "rehearsal.html"), data]
    write_whole(data, json.dumps(found, indent=1).encode())
    return written
