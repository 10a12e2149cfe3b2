"""A page as one lossless image, PNG or TIFF, one pixel a printer dot, in bands of rows.

PNG: ISO/IEC 15948. TIFF 6.0 with Deflate (tag 259 = 8) and the horizontal predictor.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...units import MM_PER_INCH
from ..cell_grid import BAND_ROWS, CellGrid
from .marks import FilledRectangle, Mark, TextLine, grey_bytes, width_mm
from .pixels import LEVEL, packed

MAX_PAGE_PX = 150_000_000
"""Common readers refuse images of more than about 178 million pixels as a likely attack."""

Band = NDArray[np.uint8]


def check_size(page_px: tuple[int, int], dpi: float) -> None:
    """Raise InputError for a page that image readers would not open."""
    width, height = page_px
    if width * height > MAX_PAGE_PX:
        most = math.floor(dpi * math.sqrt(MAX_PAGE_PX / (width * height)))
        raise InputError(
            f"a page of {width} x {height} pixels is more than the {MAX_PAGE_PX // 10**6} million "
            f"that image readers open; write a .pdf, or use at most {most} dpi"
        )


def png(page_px: tuple[int, int], dpi: float, marks: Sequence[Mark], text: dict[str, str]) -> bytes:
    """The page as PNG; pHYs holds whole pixels a metre."""
    per_metre = round(dpi / MM_PER_INCH * 1000)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", *page_px, 8, 2, 0, 0, 0)),
        (b"pHYs", struct.pack(">IIB", per_metre, per_metre, 1)),
        *((b"tEXt", f"{k}\0{v}".encode("latin-1")) for k, v in text.items()),
        (b"IDAT", b"".join(packed(_bands(page_px, dpi, marks)))),
        (b"IEND", b""),
    ]
    out = [b"\x89PNG\r\n\x1a\n"]
    for name, data in chunks:
        out += [struct.pack(">I", len(data)), name, data]
        out.append(struct.pack(">I", zlib.crc32(data, zlib.crc32(name))))
    return b"".join(out)


def tiff(page_px: tuple[int, int], dpi: float, marks: Sequence[Mark], software: str) -> bytes:
    """The page as TIFF, little-endian; the resolution is a fraction, to a millionth of a dpi."""
    width, height = page_px
    strips = []
    for band in _bands(page_px, dpi, marks):
        band[:, 1:] -= band[:, :-1].copy()
        strips.append(zlib.compress(band.tobytes(), LEVEL))
    resolution = struct.pack("<II", round(dpi * 1e5), 10**5)
    name = software.encode("ascii") + b"\0"
    at, offsets = 8, []
    for strip in strips:
        offsets.append(at)
        at += len(strip)
    shorts, longs, ascii_, rational = 3, 4, 2, 5
    entries: list[tuple[int, int, int, bytes]] = [
        (256, longs, 1, struct.pack("<I", width)),
        (257, longs, 1, struct.pack("<I", height)),
        (258, shorts, 3, struct.pack("<3H", 8, 8, 8)),
        (259, shorts, 1, struct.pack("<H", 8)),  # Deflate
        (262, shorts, 1, struct.pack("<H", 2)),  # RGB
        (273, longs, len(strips), struct.pack(f"<{len(strips)}I", *offsets)),
        (277, shorts, 1, struct.pack("<H", 3)),
        (278, longs, 1, struct.pack("<I", BAND_ROWS)),
        (279, longs, len(strips), struct.pack(f"<{len(strips)}I", *map(len, strips))),
        (282, rational, 1, resolution),
        (283, rational, 1, resolution),
        (296, shorts, 1, struct.pack("<H", 2)),  # an inch
        (305, ascii_, len(name), name),
        (317, shorts, 1, struct.pack("<H", 2)),  # difference from the left
    ]
    pad = at % 2  # tables begin on an even byte
    directory = at + pad
    beyond = directory + 2 + 12 * len(entries) + 4
    table, tail = [struct.pack("<H", len(entries))], b""
    for tag, kind, count, data in entries:
        if len(data) > 4:
            field = struct.pack("<I", beyond + len(tail))
            tail += data + b"\0" * (len(data) % 2)
        else:
            field = data.ljust(4, b"\0")
        table.append(struct.pack("<HHI", tag, kind, count) + field)
    head = struct.pack("<2sHI", b"II", 42, directory)
    return b"".join([head, *strips, b"\0" * pad, *table, b"\0" * 4, tail])


def _bands(page_px: tuple[int, int], dpi: float, marks: Iterable[Mark]) -> Iterator[Band]:
    """The page, (rows, width, 3), BAND_ROWS at a time."""
    width, height = page_px
    drawn = [(mark, *_extent(mark, dpi)) for mark in marks]
    glyphs: dict[TextLine, Band] = {}
    for first in range(0, height, BAND_ROWS):
        stop = min(first + BAND_ROWS, height)
        band = np.full((stop - first, width, 3), 255, np.uint8)
        for mark, top, end in drawn:
            low, high = max(first, top), min(stop, end)
            if low >= high:
                continue
            rows = slice(low - first, high - first)
            if isinstance(mark, FilledRectangle):
                band[rows, mark.x_px : mark.x_px + mark.width_px] = mark.ink
            elif isinstance(mark, CellGrid):
                drawn_rows = mark.rows(low - top, high - top)
                band[rows, mark.x_px : mark.x_px + mark.width_px] = grey_bytes(drawn_rows)
            else:
                if mark not in glyphs:
                    glyphs[mark] = _glyphs(mark, dpi)
                inked = glyphs[mark][low - top : high - top]
                room = width - mark.x_px
                band[rows, mark.x_px : mark.x_px + inked.shape[1]][inked[:, :room] > 0] = 0
        yield band


def _extent(mark: Mark, dpi: float) -> tuple[int, int]:
    """First row of a mark and the one after its last."""
    if isinstance(mark, TextLine):
        em_px = mark.size_pt * dpi / 72
        top = mark.y_px - math.ceil(em_px)
        return top, top + math.ceil(em_px) + math.ceil(em_px / 3)
    return mark.y_px, mark.y_px + mark.height_px


def _glyphs(words: TextLine, dpi: float) -> Band:
    """A line of text as a mask, inked or not, at most as wide as the PDF has it."""
    from PIL import Image, ImageDraw, ImageFont

    top, end = _extent(words, dpi)
    room_px = math.ceil(width_mm(words.text, words.size_pt) * dpi / MM_PER_INCH)
    size_px = words.size_pt * dpi / 72
    font = ImageFont.load_default(size_px)
    wide_px = font.getlength(words.text)
    if wide_px > room_px:
        font = ImageFont.load_default(size_px * room_px / wide_px)
    image = Image.new("L", (room_px + 2, end - top))
    draw = ImageDraw.Draw(image)
    draw.fontmode = "1"  # a printer dot is inked or not
    draw.text((0, words.y_px - top), words.text, fill=255, font=font, anchor="ls")
    return np.asarray(image)
