"""The files of examples/extend as docs/how-to/extend-*.md show them, word for word.

`write` sets the code of the pages anew; `python -m benchmarks.reference` calls it.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples" / "extend"
_FILE = re.compile(r"(<!-- file: (\S+) -->\n```python\n).*?^```$", re.M | re.S)


def pages() -> dict[Path, str]:
    """Each page as it is with the files as they are."""
    return {
        page: _FILE.sub(lambda m: f"{m[1]}{(EXAMPLES / m[2]).read_text()}```", page.read_text())
        for page in sorted((ROOT / "docs" / "how-to").glob("extend-*.md"))
    }


def shown() -> set[str]:
    """The files that some page shows."""
    return {m[2] for text in pages().values() for m in _FILE.finditer(text)}


def write() -> None:
    """Write the pages."""
    for page, text in pages().items():
        page.write_text(text)
