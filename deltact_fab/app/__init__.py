"""The command line, the demo and a lab's own files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    from .cli.main import entry
else:
    __getattr__, __dir__ = open_door(__name__)
