"""PDF files that are the same bytes for the same content, and the font that they embed."""

from .document import Document, figure
from .font import glyphs, width_em

__all__ = ["Document", "figure", "glyphs", "width_em"]
