"""Index page of an export: the verdict of the design, then its files by process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from deltact_fab.common import render_page

from ..check.verdict import DesignVerdict
from ..part import Part
from .part_files import ASSEMBLY_FOLDER, PartFile

INDEX_FILE = "index.html"
FOLDER_TITLES = {
    "print": "Print",
    "laser": "Cut by laser",
    "machine": "Machine",
    "order": "Order",
    ASSEMBLY_FOLDER: "Cast, wire, assemble",
}


def render_index(
    parts: Sequence[Part], files: Sequence[PartFile], pages: Sequence[str], verdict: DesignVerdict
) -> str:
    """Return the page of an export; pages: paths of its other files.

    Raises MissingLibrary without the extra `report`.
    """
    parts_by_name = {part.name: part for part in parts}
    sections = []
    for folder, title in FOLDER_TITLES.items():
        inside = [entry for entry in files if Path(entry.file).parent.name == folder]
        rows = []
        for name in dict.fromkeys(entry.part for entry in inside):
            part_files = [entry for entry in inside if entry.part == name]
            part = parts_by_name.get(name)
            low, high = part_files[0].bounding_box_mm
            rows.append(
                {
                    "part": name,
                    "pieces": part_files[0].quantity,
                    "material": part_files[0].material,
                    "size": [b - a for a, b in zip(low, high, strict=True)],
                    "how": part.making if part else "",
                    "check": part.look_for if part else "",
                    "files": [entry.file for entry in part_files],
                }
            )
        other_pages = [page for page in pages if Path(page).parent.name == folder]
        if rows or other_pages:
            sections.append({"title": title, "rows": rows, "pages": other_pages})
    return render_page(
        "export.html", verdict.findings(), name=Path(verdict.name).stem, sections=sections
    )
