"""Measuring while it happens: where images come from, and the page that shows what they say.

A `Source` opens a camera, a file, a run or a rig; `measure` opens nothing and knows none of them.
"""

from .begin import open_session, told_once
from .open import open_source
from .source import Source

__all__ = ["Source", "open_session", "open_source", "told_once"]
