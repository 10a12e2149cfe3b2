"""Loops that are compiled when they are first called, and kept between runs.

Import what is compiled where it is called: numba takes half a second.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Loop = TypeVar("Loop", bound=Callable[..., Any])


def compile_loop(**options: Any) -> Callable[[Loop], Loop]:
    """Decorate a loop that numba compiles; options: numba's, besides sums in any order.

    Kept in the package's folder or the user's, or in neither where neither can be written.
    """
    options = {"fastmath": {"contract", "reassoc", "nsz"}, **options}

    def decorate(loop: Loop) -> Loop:
        try:
            return numba.njit(cache=True, **options)(loop)
        except RuntimeError:  # no folder to keep it in
            return numba.njit(**options)(loop)

    return decorate
