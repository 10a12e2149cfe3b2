"""Firmware on a serial line: a program that is started here, or what runs on a terminal."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import serial

from deltact_fab.common import StageError

BOOT_S = 1.5  # by hand: an Arduino's boot loader; less loses the first line
OPEN_LIMIT_S = 15.0  # by hand: ten times as long, for a busy machine
STEP_LINE = re.compile(rb"^ *[\d.]+ -?\d+, -?\d+, (-?\d+),", re.MULTILINE)


@dataclass
class Board:
    """words: a program and its arguments, started in `folder`; none where a terminal is named."""

    words: list[str]
    terminal: str
    stdio: bool
    folder: Path
    steps_file: str
    settings: dict[int, float] = field(default_factory=dict)

    @contextmanager
    def powered(self) -> Iterator[str]:
        """Its address, powered on with the settings that its folder remembers."""
        if self.terminal:
            yield self.terminal
            return
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = str(free.getsockname()[1])
        words = [word.replace("{port}", port) for word in self.words]
        if words == self.words and not self.stdio:
            words.append(port)
        end, line = os.openpty()  # on a pipe what it says would stay in its buffer
        tty.setraw(line)
        out = end if self.stdio else subprocess.DEVNULL
        with subprocess.Popen(
            words, cwd=self.folder, stdin=end, stdout=out, stderr=subprocess.DEVNULL
        ) as process:
            os.close(end)
            time.sleep(BOOT_S)
            try:
                yield os.ttyname(line) if self.stdio else f"socket://127.0.0.1:{port}"
                # grblHAL's takes standard input for keys; ctrl-F ends it and keeps settings.
                with suppress(OSError, subprocess.TimeoutExpired):
                    os.write(line, b"\x06")
                    process.wait(3)
            finally:
                process.kill()
                os.close(line)

    @contextmanager
    def wire(self) -> Iterator[Any]:
        """A connection to it; reading takes 2 s at most. Raises StageError."""
        try:
            with self.powered() as url, _open(url) as wire:
                time.sleep(BOOT_S)
                yield wire
        except OSError as why:
            raise StageError(f"{self.terminal or self.words[0]}: no answer ({why})") from why

    def change(self, settings: dict[int, float]) -> None:
        """One after the other; what was not answered is written again, at another power-up."""
        left, refusal = dict(settings), "no answer"
        for _ in range(10):
            with suppress(StageError), self.wire() as wire:
                for n, value in list(left.items()):
                    refusal = ask(wire, f"${n}={value:.10g}")[-1]
                    if refusal == "ok":
                        self.settings[n] = left.pop(n)
            if not left:
                return
        lines = ", ".join(f"${n}={value:g}" for n, value in left.items())
        raise StageError(f"{lines}: never accepted ({refusal})")

    def height_mm(self) -> float | None:
        """Machine z by the last steps in its file; None without one.

        They are three numbers of 32 bits, as `carriage.c` has them, or lines "TIME X, Y, Z, ...".
        """
        with suppress(OSError), (self.folder / self.steps_file).open("rb") as file:
            file.seek(max(file.seek(0, os.SEEK_END) - 1000, 0))
            data = file.read()
            if len(data) == 12:
                return int.from_bytes(data[8:], "little", signed=True) / self.settings[102]
            if lines := STEP_LINE.findall(data):
                return int(lines[-1]) / self.settings[102]
        return None


def _open(url: str) -> Any:
    """Open a port; a program on a busy machine serves it seconds after its start."""
    until = time.monotonic() + OPEN_LIMIT_S
    while True:
        try:
            return serial.serial_for_url(url, 115200, timeout=2)
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(BOOT_S)


def ask(wire: Any, line: str) -> list[str]:
    """The lines of the answer, up to an ok or an error. Raises TimeoutError without one."""
    wire.write(f"{line}\n".encode())
    answer = [""]
    while answer[-1] != "ok" and not answer[-1].startswith("error:"):
        data = wire.read_until(b"\n")
        if not data.endswith(b"\n"):
            raise TimeoutError(f"none to {line}")
        answer.append(data.decode(errors="replace").strip())
    return answer
