"""Reproducible PDF files, and the font they embed.

A small writer (ISO 32000-1, PDF 1.7), needed because a page's images may be larger than memory
should hold and must be neither resampled nor encoded as text, and because equal content must give
equal bytes: the file has no date, and its identifier is a hash of its content. The one font is
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
    """Glyphs by character, and advance of a glyph in thousandths of the size."""

    glyph: dict[int, int]
    advance: tuple[int, ...]
    box: tuple[int, ...]
    ascent: int
    descent: int
    capital: int


def width_em(text: str) -> float:
    """Width of a line over the font's size. Raises ValueError for a character without glyph."""
    font = _font()
    return sum(font.advance[glyph] for glyph in _ids(text)) / 1000


def glyphs(text: str) -> str:
    """Return a line as hexadecimal glyph numbers. Raises ValueError as `width_em`."""
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
    """Embed the font as a composite one (ISO 32000-1, 9.7); return its object number.

    add: adds an object's body; stream: adds the start of a dictionary and data to compress.
    """
    font = _font()
    data = FONT_PATH.read_bytes()
    file = stream(f"<< /Length1 {len(data)}", data)
    box = " ".join(str(v) for v in font.box)
    descriptor = add(
        f"<< /Type /FontDescriptor /FontName /{FONT_NAME} /Flags 32 /FontBBox [{box}] "
        f"/ItalicAngle 0 /Ascent {font.ascent} /Descent {font.descent} /CapHeight {font.capital} "
        f"/StemV 80 /FontFile2 {file} 0 R >>".encode()
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
    """Return the map from glyphs to characters, for copy and search (9.10.3)."""
    # The lowest of characters that share a glyph, so that a hyphen is not a soft hyphen.
    code_of = {glyph: code for code, glyph in sorted(font.glyph.items(), reverse=True)}
    lines = [f"<{glyph:04X}> <{code:04X}>" for glyph, code in sorted(code_of.items())]
    blocks = [lines[i : i + 100] for i in range(0, len(lines), 100)]  # format: at most 100
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
    """Format a number to a millionth of a point, 0.4 nm."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


class Document:
    """Objects and pages, collected and then written by `finish`. Pages use font /F."""

    def __init__(self) -> None:
        self._objects: list[bytes] = [b"", b""]  # catalogue and page tree, known at the end
        self._pages: list[int] = []
        self._font = _embed(self.add, self.deflated)

    def add(self, body: bytes) -> int:
        """Add an object and return its number."""
        self._objects.append(body)
        return len(self._objects)

    def stream(self, opening: str, data: bytes) -> int:
        """Add a stream; opening: its dictionary without length and end."""
        head = f"{opening} /Length {len(data)} >>\nstream\n".encode()
        return self.add(b"".join([head, data, b"\nendstream"]))

    def deflated(self, opening: str, data: bytes) -> int:
        """Add a stream and compress its data."""
        return self.stream(f"{opening} /Filter /FlateDecode", zlib.compress(data, 9))

    def page(
        self, size_pt: Sequence[float], content: str, images: Mapping[str, int] | None = None
    ) -> None:
        """Add a page of a size in points; images: object numbers by name in the content."""
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
        """Return the file. It asks viewers not to scale it to the paper."""
        kids = " ".join(f"{page} 0 R" for page in self._pages)
        self._objects[0] = (
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
        )
        self._objects[1] = f"<< /Type /Pages /Kids [{kids}] /Count {len(self._pages)} >>".encode()
        words = {"Title": title, "Producer": producer, "Keywords": " ".join(keywords)}
        entries = " ".join(f"/{key} ({_escaped(text)})" for key, text in words.items() if text)
        info = self.add(f"<< {entries} >>".encode())
        parts = [b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n"]
        position, offsets = len(parts[0]), []
        for number, body in enumerate(self._objects, 1):
            offsets.append(position)
            parts += [b"%d 0 obj\n" % number, body, b"\nendobj\n"]
            position += sum(len(part) for part in parts[-3:])
        digest = hashlib.sha256()
        for part in parts:
            digest.update(part)
        name = digest.hexdigest()[:32]
        table = [f"xref\n0 {len(offsets) + 1}\n0000000000 65535 f \n"]
        table += [f"{offset:010d} 00000 n \n" for offset in offsets]
        table.append(
            f"trailer\n<< /Size {len(offsets) + 1} /Root 1 0 R /Info {info} 0 R "
            f"/ID [<{name}> <{name}>] >>\nstartxref\n{position}\n%%EOF\n"
        )
        return b"".join([*parts, "".join(table).encode()])


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
