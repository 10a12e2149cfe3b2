"""The laws that colour the patches: table.py finds them, patches.py draws, a file each law."""

from .table import LAWS, check_key, check_law

__all__ = ["LAWS", "check_key", "check_law"]
