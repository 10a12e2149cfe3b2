"""Print jobs: job.py is the way in; stickers and page marks are marks on a page, pdf and page_image
write them."""

from .job import SheetReport, Sticker, write

__all__ = ["SheetReport", "Sticker", "write"]
