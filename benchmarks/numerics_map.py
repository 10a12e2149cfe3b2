"""Map of stiff and extreme cases: `python -m benchmarks.numerics_map [ENGINE...]` solves all cells.

With `--missing` only those that are not stored.
Simulated; half an hour of CPU time for all. The outcomes are stored with the package, with date,
digests of the code and versions; a page of `deltact-fab numerics` computes a tenth of them anew.
"""

from __future__ import annotations

import datetime
import io
import json
import sys
import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

from PIL import Image

from deltact_fab.paths import asset
from deltact_fab.present.report.numerics_page import extremes_chart
from deltact_fab.studies.numerics import extremes, harness
from deltact_fab.version import library_versions

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "extremes.png"
LIBRARIES = ("deltact-fab", "numpy", "scipy", "opencv-contrib-python-headless")


def solve(engine: str, known: Collection[str]) -> list[dict[str, Any]]:
    """Rows of the cells of an engine, without those known by name."""
    module, rows = harness.ENGINE_MODULES[engine], []
    cells = [c for c in harness.load_engine(module).extremes() if c.name not in known]
    with tempfile.TemporaryDirectory() as scratch:
        for row in harness.case_rows(engine, module, cells, Path(scratch), False):
            rows.append(row | {"seconds": round(row["seconds"], 1)})
            print(row["outcome"], engine, row["case"], row["figure"], row["note"], flush=True)
    return rows


def read(path: Path) -> dict[str, Any]:
    """Stored map; empty without a file."""
    empty: dict[str, Any] = {"rows": [], "digests": {}}
    return json.loads(path.read_text()) if path.exists() else empty


def draw(rows: list[dict[str, Any]]) -> None:
    """Draw all charts, in two columns, as the picture of the docs."""
    charts: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        charts.setdefault(row["chart"], []).append(row | {"anew": False})
    images = []
    for chart in charts.values():
        png = io.BytesIO()
        extremes_chart(chart).savefig(png, format="png", dpi=80, facecolor="white")
        images.append(Image.open(png).convert("RGB"))
    columns: list[list[Image.Image]] = [[], []]
    for image in sorted(images, key=lambda image: -image.height):
        min(columns, key=lambda column: sum(i.height for i in column)).append(image)
    widths = [max(i.width for i in column) for column in columns]
    heights = [sum(i.height for i in column) for column in columns]
    page = Image.new("RGB", (sum(widths), max(heights)), "white")
    for x, column in zip((0, widths[0]), columns, strict=True):
        y = 0
        for image in column:
            page.paste(image, (x, y))
            y += image.height
    page.quantize(64).save(PICTURE, optimize=True)


def main() -> None:
    path = asset(extremes.MAP_FILE)
    missing, names = "--missing" in sys.argv, [a for a in sys.argv[1:] if a != "--missing"]
    for engine in names or harness.ENGINE_MODULES:
        digest = extremes.map_digest(engine)
        of_engine = [row for row in read(path)["rows"] if missing and row["engine"] == engine]
        rows = of_engine + solve(engine, {row["case"] for row in of_engine})
        stored = read(path)
        rows += [row for row in stored["rows"] if row["engine"] != engine]
        stored["digests"][engine] = digest
        stored |= {
            "simulated": True, "script": "benchmarks.numerics_map", "rows": rows,
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "versions": library_versions(LIBRARIES),
        }  # fmt: skip
        path.write_text(json.dumps(stored) + "\n")
    draw(read(path)["rows"])


if __name__ == "__main__":
    main()
