"""Print jobs: job.py is the way in; stickers and page marks make marks, pdf writes them."""

from .job import SheetReport, Sticker, write

__all__ = ["SheetReport", "Sticker", "write"]
