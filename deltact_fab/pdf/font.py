"""The one font of printed files: a sans of Helvetica's widths, embedded whole (16 kB).

Liberation Sans, reduced to Latin-1 and a few signs and renamed as its licence asks (OFL.txt).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

PATH = Path(__file__).with_name("deltact-sans.ttf")
# Six letters mark a subset (ISO 32000-1, 9.6.4).
NAME = "DELTAC+DeltactSans"


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
    known = _font().glyph
    if absent := [c for c in text if ord(c) not in known]:
        raise ValueError(f"{text!r}: the font has no {absent[0]!r}")
    return [known[ord(c)] for c in text]


@lru_cache(maxsize=1)
def _font() -> _Font:
    from fontTools.ttLib import TTFont

    with TTFont(PATH, lazy=True) as file:
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


def embed(add: Callable[[bytes], int], stream: Callable[[str, bytes], int]) -> int:
    """Put the font into a file as a composite one (ISO 32000-1, 9.7); its object's number.

    add: an object's body; stream: the beginning of a dictionary, and data to be deflated.
    """
    font = _font()
    data = PATH.read_bytes()
    file = stream(f"<< /Length1 {len(data)}", data)
    box = " ".join(str(v) for v in font.box)
    descriptor = add(
        f"<< /Type /FontDescriptor /FontName /{NAME} /Flags 32 /FontBBox [{box}] /ItalicAngle 0 "
        f"/Ascent {font.ascent} /Descent {font.descent} /CapHeight {font.capital} /StemV 80 "
        f"/FontFile2 {file} 0 R >>".encode()
    )
    widths = " ".join(str(v) for v in font.advance)
    kind = add(
        f"<< /Type /Font /Subtype /CIDFontType2 /BaseFont /{NAME} /CIDSystemInfo << /Registry "
        f"(Adobe) /Ordering (Identity) /Supplement 0 >> /FontDescriptor {descriptor} 0 R "
        f"/W [0 [{widths}]] /CIDToGIDMap /Identity >>".encode()
    )
    told = stream("<<", _to_unicode(font).encode())
    return add(
        f"<< /Type /Font /Subtype /Type0 /BaseFont /{NAME} /Encoding /Identity-H "
        f"/DescendantFonts [{kind} 0 R] /ToUnicode {told} 0 R >>".encode()
    )


def _to_unicode(font: _Font) -> str:
    """What a reader copies and searches: the character of each glyph (9.10.3)."""
    # Of characters that share a glyph the lowest, so that a hyphen is no soft one.
    of = {glyph: code for code, glyph in sorted(font.glyph.items(), reverse=True)}
    lines = [f"<{glyph:04X}> <{code:04X}>" for glyph, code in sorted(of.items())]
    blocks = [lines[i : i + 100] for i in range(0, len(lines), 100)]  # a block holds no more
    told = "\n".join(
        f"{len(block)} beginbfchar\n" + "\n".join(block) + "\nendbfchar" for block in blocks
    )
    return (
        "/CIDInit /ProcSet findresource begin\n12 dict begin\nbegincmap\n"
        "/CIDSystemInfo << /Registry (Adobe) /Ordering (UCS) /Supplement 0 >> def\n"
        "/CMapName /Adobe-Identity-UCS def\n/CMapType 2 def\n"
        "1 begincodespacerange\n<0000> <FFFF>\nendcodespacerange\n"
        f"{told}\nendcmap\nCMapName currentdict /CMap defineresource pop\nend\nend\n"
    )
