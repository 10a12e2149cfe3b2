"""A written page as a browser meets it: what it would fetch, and what a reader sees."""

from __future__ import annotations

import re
from html.parser import HTMLParser


class SeenPage(HTMLParser):
    """Ids, links, tags, the cells of table rows, and the text outside scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self._open = ""
        self.feed(page)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self._open = tag
        for name, value in attrs:
            if name == "id" and value:
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "srcset") and value:
                self.links.append(value)

    def handle_endtag(self, tag: str) -> None:
        if tag == self._open:
            self._open = ""

    def handle_data(self, data: str) -> None:
        if self.tags[-1:] not in (["script"], ["style"]):
            self.text += data
        if self._open:
            self.rows[-1][-1] += data


def offline(page: str) -> tuple[SeenPage, set[str]]:
    """The page, which fetches nothing and whose ids do not meet; the files that it links to."""
    seen = SeenPage(page)
    assert not re.search(r"@import|url\((?!#)", page.partition("<body>")[0])
    assert len(seen.ids) == len(set(seen.ids))
    return seen, {link for link in seen.links if not link.startswith(("data:", "#"))}
