"""Loops compiled by numba at the first call and cached between runs.

Import compiled modules within functions: numba takes half a second to load.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Loop = TypeVar("Loop", bound=Callable[..., Any])


def compile_loop(**options: Any) -> Callable[[Loop], Loop]:
    """Decorator that compiles a loop with numba, allowing reassociated sums; options: of numba.

    Cached in the package's folder or the user's, if one is writable.
    """
    options = {"fastmath": {"contract", "reassoc", "nsz"}, **options}

    def decorate(loop: Loop) -> Loop:
        try:
            return numba.njit(cache=True, **options)(loop)
        except RuntimeError:  # no writable cache folder
            return numba.njit(**options)(loop)

    return decorate
