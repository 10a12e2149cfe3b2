"""PDF files that are the same bytes for the same content, and the font that they embed.

A small writer (ISO 32000-1, PDF 1.7), written here because a page's images may be larger than
memory should hold and must neither be resampled nor wrapped in text, and because equal content must
be equal bytes: the file has no date, and its identifier is a hash of what it holds. The one font is
a sans of Helvetica's widths, embedded whole (16 kB): Liberation Sans, reduced to Latin-1 and a few
signs and renamed as its licence asks (OFL.txt).
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from deltact_fab.common import MM_PER_INCH
from deltact_fab.paths import asset

POINTS_PER_MM = 72 / MM_PER_INCH
FONT_PATH = asset("deltact-sans.ttf")
# Six letters mark a subset (ISO 32000-1, 9.6.4).
FONT_NAME = "DELTAC+DeltactSans"


@dataclass(frozen=True)
class _Font:
    """Glyph of a character, and the advance of a glyph in thousandths of the size."""

    glyph: dict[int, int]
    advance: tuple[int, ...]
    box: tuple[int, ...]
    ascent: int
    descent: int
    capital: int


def width_em(text: str) -> float:
    """Width of a line over the font's size. Raises ValueError for a character it has not."""
    font = _font()
    return sum(font.advance[glyph] for glyph in _ids(text)) / 1000


def glyphs(text: str) -> str:
    """A line as the hexadecimal glyph numbers of a PDF string. Raises ValueError likewise."""
    return "".join(f"{glyph:04X}" for glyph in _ids(text))


def _ids(text: str) -> list[int]:
    glyph_of = _font().glyph
    if absent := [c for c in text if ord(c) not in glyph_of]:
        raise ValueError(f"{text!r}: the font has no {absent[0]!r}")
    return [glyph_of[ord(c)] for c in text]


@lru_cache(maxsize=1)
def _font() -> _Font:
    from fontTools.ttLib import TTFont

    with TTFont(FONT_PATH, lazy=True) as file:
        em = file["head"].unitsPerEm
        order = file.getGlyphOrder()
        number = {name: i for i, name in enumerate(order)}
        head, line, style = file["head"], file["hhea"], file["OS/2"]

        def scaled(value: int) -> int:
            return round(value * 1000 / em)

        return _Font(
            {code: number[name] for code, name in file.getBestCmap().items()},
            tuple(scaled(file["hmtx"][name][0]) for name in order),
            tuple(scaled(v) for v in (head.xMin, head.yMin, head.xMax, head.yMax)),
            scaled(line.ascent),
            scaled(line.descent),
            scaled(style.sCapHeight),
        )


def _embed(add: Callable[[bytes], int], stream: Callable[[str, bytes], int]) -> int:
    """Put the font into a file as a composite one (ISO 32000-1, 9.7); its object's number.

    add: an object's body; stream: the beginning of a dictionary, and data to be deflated.
    """
    font = _font()
    data = FONT_PATH.read_bytes()
    file = stream(f"<< /Length1 {len(data)}", data)
    box = " ".join(str(v) for v in font.box)
    descriptor = add(
        f"<< /Type /FontDescriptor /FontName /{FONT_NAME} /Flags 32 /FontBBox [{box}] /ItalicAngle 0 "
        f"/Ascent {font.ascent} /Descent {font.descent} /CapHeight {font.capital} /StemV 80 "
        f"/FontFile2 {file} 0 R >>".encode()
    )
    widths = " ".join(str(v) for v in font.advance)
    kind = add(
        f"<< /Type /Font /Subtype /CIDFontType2 /BaseFont /{FONT_NAME} /CIDSystemInfo << /Registry "
        f"(Adobe) /Ordering (Identity) /Supplement 0 >> /FontDescriptor {descriptor} 0 R "
        f"/W [0 [{widths}]] /CIDToGIDMap /Identity >>".encode()
    )
    unicode_map = stream("<<", _to_unicode(font).encode())
    return add(
        f"<< /Type /Font /Subtype /Type0 /BaseFont /{FONT_NAME} /Encoding /Identity-H "
        f"/DescendantFonts [{kind} 0 R] /ToUnicode {unicode_map} 0 R >>".encode()
    )


def _to_unicode(font: _Font) -> str:
    """What a reader copies and searches: the character of each glyph (9.10.3)."""
    # Of characters that share a glyph the lowest, so that a hyphen is no soft one.
    code_of = {glyph: code for code, glyph in sorted(font.glyph.items(), reverse=True)}
    lines = [f"<{glyph:04X}> <{code:04X}>" for glyph, code in sorted(code_of.items())]
    blocks = [lines[i : i + 100] for i in range(0, len(lines), 100)]  # a block holds no more
    mapping = "\n".join(
        f"{len(block)} beginbfchar\n" + "\n".join(block) + "\nendbfchar" for block in blocks
    )
    return (
        "/CIDInit /ProcSet findresource begin\n12 dict begin\nbegincmap\n"
        "/CIDSystemInfo << /Registry (Adobe) /Ordering (UCS) /Supplement 0 >> def\n"
        "/CMapName /Adobe-Identity-UCS def\n/CMapType 2 def\n"
        "1 begincodespacerange\n<0000> <FFFF>\nendcodespacerange\n"
        f"{mapping}\nendcmap\nCMapName currentdict /CMap defineresource pop\nend\nend\n"
    )


def figure(value: float) -> str:
    """A number to a millionth of a point, 0.4 nm."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


class Document:
    """Objects and pages, collected and then written by `finish`. Words of a page are in font /F."""

    def __init__(self) -> None:
        self._objects: list[bytes] = [b"", b""]  # catalogue and page tree, known at the end
        self._pages: list[int] = []
        self._font = _embed(self.add, self.deflated)

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
        resources = " ".join(f"/{name} {number} 0 R" for name, number in (images or {}).items())
        self._pages.append(
            self.add(
                f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] "
                f"/Contents {stream} 0 R /Resources << /Font << /F {self._font} 0 R >> "
                f"/XObject << {resources} >> >> >>".encode()
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
        entries = " ".join(f"/{key} ({_escaped(text)})" for key, text in words.items() if text)
        info = self.add(f"<< {entries} >>".encode())
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
