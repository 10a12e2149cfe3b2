"""What a plain install leaves out, and the one line that says how to get it."""

from __future__ import annotations

import importlib.util

from .errors import MissingLibrary


def require_extra(extra: str, what: str, *modules: str) -> None:
    """Look for the modules, none of which is imported; call it before any work is done.

    what: what cannot be had without them, as it stands before "needs". Raises MissingLibrary.
    """
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise MissingLibrary(f"{what} needs {module}: pip install 'deltact-fab[{extra}]'")
