"""A lab's own files: a folder of them to begin with, and new ones with every key explained."""

from .folder import init
from .new import design, pattern, protocol, rig

__all__ = ["design", "init", "pattern", "protocol", "rig"]
