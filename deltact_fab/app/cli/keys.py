"""Single keys of a terminal, by name."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

KEY_NAMES = {
    b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left",
    b"\x1bOA": "up", b"\x1bOB": "down", b"\x1bOC": "right", b"\x1bOD": "left",
    b"\x1b[5~": "page up", b"\x1b[6~": "page down",
}  # fmt: skip


@contextmanager
def read_keys() -> Iterator[Callable[[float], str]]:
    """Yield a function that waits up to (s) for a key and returns its name or letter, else "".

    Ctrl-C still works. The terminal is restored afterwards.
    """
    import termios
    import tty

    number = sys.stdin.fileno()
    saved = termios.tcgetattr(number)

    def key(wait_s: float) -> str:
        if not select.select([number], [], [], wait_s)[0]:
            return ""
        data = os.read(number, 8)
        if not data:
            return "q"
        return KEY_NAMES.get(data, data[:1].decode("ascii", "replace"))

    tty.setcbreak(number)
    try:
        yield key
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, saved)


@contextmanager
def line_mode() -> Iterator[None]:
    """Switch the terminal to line input meanwhile."""
    import termios

    number = sys.stdin.fileno()
    raw = termios.tcgetattr(number)
    cooked = termios.tcgetattr(number)
    cooked[3] |= termios.ICANON | termios.ECHO
    termios.tcsetattr(number, termios.TCSADRAIN, cooked)
    try:
        yield
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, raw)
