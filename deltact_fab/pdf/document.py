"""A small PDF writer (ISO 32000-1, PDF 1.7).

Written here because a page's images may be larger than memory should hold and must neither be
resampled nor wrapped in text, and because equal content must be equal bytes: the file has no date,
and its identifier is a hash of what it holds.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Mapping, Sequence

from . import font


def figure(value: float) -> str:
    """A number to a millionth of a point, 0.4 nm."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


class Document:
    """Objects and pages, collected and then written by `finish`. Words of a page are in font /F."""

    def __init__(self) -> None:
        self._objects: list[bytes] = [b"", b""]  # catalogue and page tree, known at the end
        self._pages: list[int] = []
        self._font = font.embed(self.add, self.deflated)

    def add(self, body: bytes) -> int:
        """Add an object and return its number."""
        self._objects.append(body)
        return len(self._objects)

    def stream(self, opening: str, data: bytes) -> int:
        """Add a stream; opening: its dictionary but for length and end."""
        head = f"{opening} /Length {len(data)} >>\nstream\n".encode()
        return self.add(b"".join([head, data, b"\nendstream"]))

    def deflated(self, opening: str, data: bytes) -> int:
        """Add a stream of data that are packed here."""
        return self.stream(f"{opening} /Filter /FlateDecode", zlib.compress(data, 9))

    def page(
        self, size_pt: Sequence[float], content: str, images: Mapping[str, int] | None = None
    ) -> None:
        """Add a page of so many points; images: objects by the names that the content uses."""
        stream = self.deflated("<<", content.encode("ascii"))
        width, height = (figure(side) for side in size_pt)
        named = " ".join(f"/{name} {number} 0 R" for name, number in (images or {}).items())
        self._pages.append(
            self.add(
                f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] "
                f"/Contents {stream} 0 R /Resources << /Font << /F {self._font} 0 R >> "
                f"/XObject << {named} >> >> >>".encode()
            )
        )

    def finish(self, title: str, producer: str, keywords: Sequence[str] = ()) -> bytes:
        """The file. Viewers are told not to fit it to the paper."""
        kids = " ".join(f"{page} 0 R" for page in self._pages)
        self._objects[0] = (
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
        )
        self._objects[1] = f"<< /Type /Pages /Kids [{kids}] /Count {len(self._pages)} >>".encode()
        words = {"Title": title, "Producer": producer, "Keywords": " ".join(keywords)}
        told = " ".join(f"/{key} ({_escaped(text)})" for key, text in words.items() if text)
        info = self.add(f"<< {told} >>".encode())
        parts = [b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n"]
        at, offsets = len(parts[0]), []
        for number, body in enumerate(self._objects, 1):
            offsets.append(at)
            parts += [b"%d 0 obj\n" % number, body, b"\nendobj\n"]
            at += sum(len(part) for part in parts[-3:])
        digest = hashlib.sha256()
        for part in parts:
            digest.update(part)
        name = digest.hexdigest()[:32]
        table = [f"xref\n0 {len(offsets) + 1}\n0000000000 65535 f \n"]
        table += [f"{offset:010d} 00000 n \n" for offset in offsets]
        table.append(
            f"trailer\n<< /Size {len(offsets) + 1} /Root 1 0 R /Info {info} 0 R "
            f"/ID [<{name}> <{name}>] >>\nstartxref\n{at}\n%%EOF\n"
        )
        return b"".join([*parts, "".join(table).encode()])


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
