"""A small PDF writer: boxes, words and pictures at exact printer dots, lossless.

ISO 32000-1 (PDF 1.7). Written here because a page's images are larger than memory should hold and
must neither be resampled nor wrapped in text: rows go through Deflate as they are made. The file
has no date and its identifier is a hash of its content, so equal sheets are equal bytes.

A picture is embedded in one of two ways. With one pixel a cell, the printer draws the cells at
exact millimetres; viewers smooth cells of less than about five dots. With one pixel a printer dot,
the edges are already on the grid, and at the sheet's resolution nothing is left to resample.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence

from ...units import POINTS_PER_MM
from .marks import Box, Mark, Picture, Words
from .pixels import NONE, SUB, packed

INSET_MM = 1e-4
"""By which a picture's box is smaller on each side than its place.

Renderers take every dot that a picture's box touches, and a box that ends exactly on a dot's edge
touches the next one by rounding: the picture would grow by a dot and be resampled.
"""

LEAST_DOTS = 5.0
"""Printer dots a cell from which one pixel a cell is right in every renderer tried."""


class Pdf:
    """Pages of marks, collected and then written by `finish`.

    page_px: size in printer dots; dpi: dots an inch. least_dots: printer dots a cell from which a
    picture is embedded with one pixel a cell.
    """

    def __init__(self, page_px: tuple[int, int], dpi: float, least_dots: float = LEAST_DOTS):
        self._dpi = dpi
        self._least_dots = least_dots
        # Rounded down: a renderer counts a dot's fraction at the page's edge as one more
        self._size_pt = tuple(int(side * 72 / dpi * 1e5) / 1e5 for side in page_px)
        self._objects: list[bytes] = [b"", b""]  # catalogue and page tree, known at the end
        self._images: dict[str, int] = {}
        self._pages: list[int] = []
        self._font = self._add(
            b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>"
        )

    def page(self, marks: Iterable[Mark]) -> None:
        """Add a page."""
        content, used = [], {}
        for mark in marks:
            if isinstance(mark, Box):
                content.append(self._box(mark))
            elif isinstance(mark, Words):
                content.append(self._words(mark))
            else:
                number = self._image(mark)
                used[number] = f"/I{number} {number} 0 R"
                content.append(self._placed(mark, number))
        stream = self._stream("<< /Filter /FlateDecode", packed_text("\n".join(content)))
        width, height = (_number(side) for side in self._size_pt)
        images = " ".join(used.values())
        page = (
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] /Contents {stream} 0 R "
            f"/Resources << /Font << /F {self._font} 0 R >> /XObject << {images} >> >> >>"
        )
        self._pages.append(self._add(page.encode()))

    def finish(self, title: str, producer: str, keywords: Sequence[str]) -> bytes:
        """The file. Viewers are told not to fit it to the paper."""
        kids = " ".join(f"{page} 0 R" for page in self._pages)
        self._objects[0] = (
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>"
        )
        self._objects[1] = f"<< /Type /Pages /Kids [{kids}] /Count {len(self._pages)} >>".encode()
        words = {"Title": title, "Producer": producer, "Keywords": " ".join(keywords)}
        info = self._add(
            ("<< " + " ".join(f"/{k} ({_escaped(v)})" for k, v in words.items()) + " >>").encode()
        )
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

    def _add(self, body: bytes) -> int:
        self._objects.append(body)
        return len(self._objects)

    def _stream(self, opening: str, data: bytes) -> int:
        head = f"{opening} /Length {len(data)} >>\nstream\n".encode()
        return self._add(b"".join([head, data, b"\nendstream"]))

    def _image(self, picture: Picture) -> int:
        if picture.key in self._images:
            return self._images[picture.key]
        if picture.by_cells(self._least_dots):
            small = picture.small()
            height, width = small.shape[:2]
            data = b"".join(packed([small], NONE))
        else:
            height, width = picture.height_px, picture.width_px
            data = b"".join(packed(picture.bands(), SUB))
        colours = 3 if picture.cells.ndim == 3 else 1
        space = "/DeviceRGB" if colours == 3 else "/DeviceGray"
        opening = (
            f"<< /Type /XObject /Subtype /Image /Width {width} /Height {height} "
            f"/ColorSpace {space} /BitsPerComponent 8 /Interpolate false /Filter /FlateDecode "
            f"/DecodeParms << /Predictor 15 /Colors {colours} /BitsPerComponent 8 "
            f"/Columns {width} >>"
        )
        number = self._images[picture.key] = self._stream(opening, data)
        return number

    def _placed(self, picture: Picture, number: int) -> str:
        inset = INSET_MM * POINTS_PER_MM
        if picture.by_cells(self._least_dots):
            # The file is longer than the real print by the scale, as the pitch is shorter
            width, height = (
                size_mm / pitch_mm
                for size_mm, pitch_mm in zip(picture.size_mm, picture.pitch_mm, strict=True)
            )
        else:
            width, height = picture.width_px, picture.height_px
        left, low = self._at(picture.x_px, picture.y_px + height)
        sides = (side * 72 / self._dpi - 2 * inset for side in (width, height))
        wide, high = (_number(side) for side in sides)
        return (
            f"q {wide} 0 0 {high} {_number(left + inset)} {_number(low + inset)} cm /I{number} Do Q"
        )

    def _box(self, box: Box) -> str:
        # A box's edges are kept off the dots' edges by the same inset
        left, low = self._at(box.x_px, box.y_px + box.height_px)
        inset = INSET_MM * POINTS_PER_MM
        wide, high = (s * 72 / self._dpi - 2 * inset for s in (box.width_px, box.height_px))
        ink = (
            f"{_number(box.ink / 255)} g"
            if isinstance(box.ink, int)
            else " ".join(_number(v / 255) for v in box.ink) + " rg"
        )
        place = " ".join(_number(v) for v in (left + inset, low + inset, wide, high))
        return f"{ink} {place} re f"

    def _words(self, words: Words) -> str:
        x, y = (_number(v) for v in self._at(words.x_px, words.y_px))
        return f"BT 0 g /F {_number(words.size_pt)} Tf {x} {y} Td ({_escaped(words.text)}) Tj ET"

    def _at(self, x_px: float, y_px: float) -> tuple[float, float]:
        """A place in points from the lower left corner."""
        return x_px * 72 / self._dpi, self._size_pt[1] - y_px * 72 / self._dpi


def packed_text(text: str) -> bytes:
    """Deflated text."""
    import zlib

    return zlib.compress(text.encode("ascii"), 9)


def _number(value: float) -> str:
    """To a millionth of a point, 0.4 nm."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
