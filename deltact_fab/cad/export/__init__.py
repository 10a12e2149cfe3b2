"""Parts to files: the same dimensions give the same bytes, in any process and any order.

batch.py is the way in; part_files.py runs in a worker, stored.py is the cache, formats/ the files.
"""

from .batch import export_parts
from .folder import MANIFEST, PartFile, manifest
from .part_files import FORMATS

__all__ = ["FORMATS", "MANIFEST", "PartFile", "export_parts", "manifest"]
