"""Parts to files: the same dimensions give the same bytes, in any process and any order.

batch.py is the way in, with cache and folder; part_files.py runs in a worker, formats/ are files.
"""

from .batch import MANIFEST, export_parts
from .part_files import FORMATS, PartFile

__all__ = ["FORMATS", "MANIFEST", "PartFile", "export_parts"]
