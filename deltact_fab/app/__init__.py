"""Command line, demo and a lab's own files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from deltact_fab.door import open_door

if TYPE_CHECKING:
    # isort: off
    # fmt: off
    from .cli.main import entry
    # fmt: on
else:
    __getattr__, __dir__ = open_door(__name__)
