"""A V4L2 device by the kernel's own calls (include/uapi/linux/videodev2.h), on 64 bits.

OpenCV opens such a device too, and keeps to itself what a record needs: the number that the driver
gives an image, whether its stamp is of the monotonic clock, that it is damaged, and what range a
setting has.
"""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os
import select
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

U32, S32 = ctypes.c_uint32, ctypes.c_int32
CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
MAPPED = 1  # V4L2_MEMORY_MMAP
CAN_CAPTURE = 0x0000_0001  # V4L2_CAP_VIDEO_CAPTURE
TELLS_NODE = 0x8000_0000  # V4L2_CAP_DEVICE_CAPS
DAMAGED = 0x0000_0040  # V4L2_BUF_FLAG_ERROR
CLOCK, MONOTONIC = 0x0000_E000, 0x0000_2000  # V4L2_BUF_FLAG_TIMESTAMP_MASK, _MONOTONIC
DISABLED = 0x0001  # V4L2_CTRL_FLAG_DISABLED
BUFFERS = 4


class _Capability(ctypes.Structure):
    _fields_ = [
        ("driver", ctypes.c_char * 16), ("card", ctypes.c_char * 32), ("bus", ctypes.c_char * 32),
        ("version", U32), ("whole", U32), ("node", U32), ("reserved", U32 * 3),
    ]  # fmt: skip


class _Pixels(ctypes.Structure):
    _fields_ = [
        ("width", U32), ("height", U32), ("code", U32), ("field", U32), ("line_bytes", U32),
        ("image_bytes", U32), ("rest", U32 * 6),
    ]  # fmt: skip


class _AnyFormat(ctypes.Union):
    _fields_ = [("pixels", _Pixels), ("raw", ctypes.c_ulong * 25)]


class _Format(ctypes.Structure):
    _fields_ = [("type", U32), ("of", _AnyFormat)]


class _Rate(ctypes.Structure):
    _fields_ = [
        ("type", U32), ("capability", U32), ("mode", U32), ("numerator", U32),
        ("denominator", U32), ("rest", U32 * 46),
    ]  # fmt: skip


class _Request(ctypes.Structure):
    _fields_ = [("count", U32), ("type", U32), ("memory", U32), ("rest", U32 * 2)]


class _Buffer(ctypes.Structure):
    _fields_ = [
        ("index", U32), ("type", U32), ("used", U32), ("flags", U32), ("field", U32),
        ("seconds", ctypes.c_long), ("microseconds", ctypes.c_long), ("timecode", U32 * 4),
        ("sequence", U32), ("memory", U32), ("offset", ctypes.c_ulong), ("length", U32),
        ("rest", U32 * 2),
    ]  # fmt: skip


class _Control(ctypes.Structure):
    _fields_ = [("id", U32), ("value", S32)]


class _Range(ctypes.Structure):
    _fields_ = [
        ("id", U32), ("type", U32), ("name", ctypes.c_char * 32), ("least", S32), ("most", S32),
        ("step", S32), ("default", S32), ("flags", U32), ("reserved", U32 * 2),
    ]  # fmt: skip


def _code(number: int, kind: type, direction: int = 3) -> int:
    """_IOC of asm-generic/ioctl.h; direction: 1 write, 2 read."""
    return direction << 30 | ctypes.sizeof(kind) << 16 | ord("V") << 8 | number


QUERYCAP = _code(0, _Capability, 2)
G_FMT, S_FMT = _code(4, _Format), _code(5, _Format)
REQBUFS, QUERYBUF = _code(8, _Request), _code(9, _Buffer)
QBUF, DQBUF = _code(15, _Buffer), _code(17, _Buffer)
STREAMON, STREAMOFF = _code(18, S32, 1), _code(19, S32, 1)
G_PARM, S_PARM = _code(21, _Rate), _code(22, _Rate)
G_CTRL, S_CTRL, QUERYCTRL = _code(27, _Control), _code(28, _Control), _code(36, _Range)


@dataclass(frozen=True)
class ControlSetting:
    """A control's value and what it may be."""

    value: int
    least: int
    most: int
    step: int


@dataclass(frozen=True)
class FilledBuffer:
    """A buffer that the driver has filled; what it holds is valid until it is given back."""

    data: memoryview
    number: int
    t_s: float | None
    """Of the kernel's monotonic clock; None where the driver stamps by another."""
    damaged: bool


class V4l2Device:
    """An open device. Every method raises OSError as the kernel refuses."""

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._maps: list[mmap.mmap] = []
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def captures(self) -> bool:
        """Whether it gives images: metadata, outputs and codecs are nodes too."""
        told = self._ask(QUERYCAP, _Capability())
        return bool((told.node if told.whole & TELLS_NODE else told.whole) & CAN_CAPTURE)

    def shape(
        self, fourcc: str | None = None, size_px: tuple[int, int] | None = None
    ) -> tuple[str, tuple[int, int], int]:
        """Ask for coding and size; what the device takes of them, and the bytes of a line."""
        wish = self._ask(G_FMT, _Format(CAPTURE))
        pixels = wish.of.pixels
        if fourcc is not None:
            pixels.code = int.from_bytes(fourcc.encode("ascii"), "little")
        if size_px is not None:
            pixels.width, pixels.height = size_px
        pixels.field = pixels.line_bytes = pixels.image_bytes = 0  # the driver's to say
        pixels = self._ask(S_FMT, wish).of.pixels
        letters = pixels.code.to_bytes(4, "little").decode("ascii", errors="replace")
        return letters, (pixels.width, pixels.height), pixels.line_bytes

    def rate(self, asked_hz: float | None = None) -> float | None:
        """Ask for a rate; the one that the device takes, None where it has no say in it."""
        rate = _Rate(CAPTURE)
        try:
            if asked_hz is not None:
                period = 1 / Fraction(asked_hz).limit_denominator(1001)
                rate.numerator, rate.denominator = period.numerator, period.denominator
                self._ask(S_PARM, rate)
            self._ask(G_PARM, rate)
        except OSError:
            return None
        return rate.denominator / rate.numerator if rate.numerator else None

    def setting(self, control: int) -> ControlSetting | None:
        """A control as it is; None where the device has not got it."""
        try:
            limits = self._ask(QUERYCTRL, _Range(control))
            if limits.flags & DISABLED:
                return None
            value = self._ask(G_CTRL, _Control(control)).value
        except OSError:
            return None
        return ControlSetting(value, limits.least, limits.most, limits.step)

    def set(self, control: int, value: int) -> None:
        """Ask for a value, which the driver may round."""
        self._ask(S_CTRL, _Control(control, value))

    def start(self) -> None:
        """Map the buffers, give them to the driver and let images come."""
        request = self._ask(REQBUFS, _Request(BUFFERS, CAPTURE, MAPPED))
        for k in range(request.count):
            buffer = self._ask(QUERYBUF, _Buffer(k, CAPTURE, memory=MAPPED))
            self._maps.append(
                mmap.mmap(
                    self._fd, buffer.length, mmap.MAP_SHARED, mmap.PROT_READ,
                    offset=buffer.offset & 0xFFFF_FFFF,
                )
            )  # fmt: skip
            self._ask(QBUF, buffer)
        self._ask(STREAMON, S32(CAPTURE))

    @contextmanager
    def filled(self, timeout_s: float) -> Iterator[FilledBuffer | None]:
        """The next buffer, None when none is filled in time; it is given back afterwards."""
        if not self._poll.poll(timeout_s * 1e3):
            yield None
            return
        buffer = self._ask(DQBUF, _Buffer(0, CAPTURE, memory=MAPPED))
        t_s = None
        if buffer.flags & CLOCK == MONOTONIC:
            t_s = buffer.seconds + buffer.microseconds / 1e6
        with memoryview(self._maps[buffer.index])[: buffer.used] as data:
            yield FilledBuffer(data, buffer.sequence, t_s, bool(buffer.flags & DAMAGED))
        self._ask(QBUF, buffer)

    def close(self) -> None:
        if self._fd >= 0:
            fd, self._fd = self._fd, -1
            with suppress(OSError):  # it may be gone
                fcntl.ioctl(fd, STREAMOFF, bytes(S32(CAPTURE)))
            for mapped in self._maps:
                mapped.close()
            os.close(fd)

    def _ask(self, request: int, about: Any) -> Any:
        fcntl.ioctl(self._fd, request, about)
        return about
