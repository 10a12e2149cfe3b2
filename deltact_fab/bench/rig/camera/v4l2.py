"""A V4L2 device by the kernel's own calls (include/uapi/linux/videodev2.h), on 64 bits.

OpenCV opens such a device too, but hides data that a record needs: the driver's number of an
image, the clock of its stamp, the error flag, and the range of a control.
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

uint32, int32 = ctypes.c_uint32, ctypes.c_int32
BUF_CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
MEMORY_MMAP = 1  # V4L2_MEMORY_MMAP
CAP_CAPTURE = 0x0000_0001  # V4L2_CAP_VIDEO_CAPTURE
CAP_DEVICE_CAPS = 0x8000_0000  # V4L2_CAP_DEVICE_CAPS
BUF_FLAG_ERROR = 0x0000_0040  # V4L2_BUF_FLAG_ERROR
TIMESTAMP_MASK = 0x0000_E000  # V4L2_BUF_FLAG_TIMESTAMP_MASK
TIMESTAMP_MONOTONIC = 0x0000_2000  # V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC
CTRL_DISABLED = 0x0001  # V4L2_CTRL_FLAG_DISABLED
BUFFER_COUNT = 4  # by hand: more ride out a late host, and cost memory


class _Capability(ctypes.Structure):
    _fields_ = [
        ("driver", ctypes.c_char * 16), ("card", ctypes.c_char * 32), ("bus", ctypes.c_char * 32),
        ("version", uint32), ("device", uint32), ("node", uint32), ("reserved", uint32 * 3),
    ]  # fmt: skip


class _Pixels(ctypes.Structure):
    _fields_ = [
        ("width", uint32), ("height", uint32), ("code", uint32), ("field", uint32),
        ("line_bytes", uint32), ("image_bytes", uint32), ("rest", uint32 * 6),
    ]  # fmt: skip


class _AnyFormat(ctypes.Union):
    _fields_ = [("pixels", _Pixels), ("raw", ctypes.c_ulong * 25)]


class _Format(ctypes.Structure):
    _fields_ = [("type", uint32), ("fmt", _AnyFormat)]


class _Rate(ctypes.Structure):
    _fields_ = [
        ("type", uint32), ("capability", uint32), ("mode", uint32), ("numerator", uint32),
        ("denominator", uint32), ("rest", uint32 * 46),
    ]  # fmt: skip


class _Request(ctypes.Structure):
    _fields_ = [("count", uint32), ("type", uint32), ("memory", uint32), ("rest", uint32 * 2)]


class _Buffer(ctypes.Structure):
    _fields_ = [
        ("index", uint32), ("type", uint32), ("used", uint32), ("flags", uint32), ("field", uint32),
        ("seconds", ctypes.c_long), ("microseconds", ctypes.c_long), ("timecode", uint32 * 4),
        ("sequence", uint32), ("memory", uint32), ("offset", ctypes.c_ulong), ("length", uint32),
        ("rest", uint32 * 2),
    ]  # fmt: skip


class _Control(ctypes.Structure):
    _fields_ = [("id", uint32), ("value", int32)]


class _Range(ctypes.Structure):
    _fields_ = [
        ("id", uint32), ("type", uint32), ("name", ctypes.c_char * 32), ("minimum", int32),
        ("maximum", int32), ("step", int32), ("default", int32), ("flags", uint32),
        ("reserved", uint32 * 2),
    ]  # fmt: skip


def _code(number: int, kind: type, direction: int = 3) -> int:
    """Request code, _IOC of asm-generic/ioctl.h; direction: 1 write, 2 read."""
    return direction << 30 | ctypes.sizeof(kind) << 16 | ord("V") << 8 | number


VIDIOC_QUERYCAP = _code(0, _Capability, 2)
VIDIOC_G_FMT, VIDIOC_S_FMT = _code(4, _Format), _code(5, _Format)
VIDIOC_REQBUFS, VIDIOC_QUERYBUF = _code(8, _Request), _code(9, _Buffer)
VIDIOC_QBUF, VIDIOC_DQBUF = _code(15, _Buffer), _code(17, _Buffer)
VIDIOC_STREAMON, VIDIOC_STREAMOFF = _code(18, int32, 1), _code(19, int32, 1)
VIDIOC_G_PARM, VIDIOC_S_PARM = _code(21, _Rate), _code(22, _Rate)
VIDIOC_G_CTRL, VIDIOC_S_CTRL = _code(27, _Control), _code(28, _Control)
VIDIOC_QUERYCTRL = _code(36, _Range)


@dataclass(frozen=True)
class ControlSetting:
    """A control's value and range."""

    value: int
    minimum: int
    maximum: int
    step: int


@dataclass(frozen=True)
class FilledBuffer:
    """A buffer filled by the driver; its data are valid until it is given back."""

    data: memoryview
    number: int
    t_s: float | None
    """Time of the kernel's monotonic clock; None if the driver stamps by another."""
    damaged: bool


class V4l2Device:
    """An open device. Every method raises OSError from the kernel."""

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._maps: list[mmap.mmap] = []
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)

    def gives_images(self) -> bool:
        """True for a node that gives images; others are for metadata, output or codecs."""
        caps = self._ioctl(VIDIOC_QUERYCAP, _Capability())
        return bool((caps.node if caps.device & CAP_DEVICE_CAPS else caps.device) & CAP_CAPTURE)

    def set_format(
        self, fourcc: str | None = None, size_px: tuple[int, int] | None = None
    ) -> tuple[str, tuple[int, int], int]:
        """Request pixel format and size; return the accepted ones, and the bytes per line."""
        wanted_format = self._ioctl(VIDIOC_G_FMT, _Format(BUF_CAPTURE))
        pixels = wanted_format.fmt.pixels
        if fourcc is not None:
            pixels.code = int.from_bytes(fourcc.encode("ascii"), "little")
        if size_px is not None:
            pixels.width, pixels.height = size_px
        pixels.field = pixels.line_bytes = pixels.image_bytes = 0  # set by the driver
        pixels = self._ioctl(VIDIOC_S_FMT, wanted_format).fmt.pixels
        letters = pixels.code.to_bytes(4, "little").decode("ascii", errors="replace")
        return letters, (pixels.width, pixels.height), pixels.line_bytes

    def set_rate(self, nominal_hz: float | None = None) -> float | None:
        """Request a rate; return the accepted one, None if the device has no rate control."""
        rate = _Rate(BUF_CAPTURE)
        try:
            if nominal_hz is not None:
                period = 1 / Fraction(nominal_hz).limit_denominator(1001)
                rate.numerator, rate.denominator = period.numerator, period.denominator
                self._ioctl(VIDIOC_S_PARM, rate)
            self._ioctl(VIDIOC_G_PARM, rate)
        except OSError:
            return None
        return rate.denominator / rate.numerator if rate.numerator else None

    def setting(self, control: int) -> ControlSetting | None:
        """Return a control's present state; None if the device lacks it."""
        try:
            limits = self._ioctl(VIDIOC_QUERYCTRL, _Range(control))
            if limits.flags & CTRL_DISABLED:
                return None
            value = self._ioctl(VIDIOC_G_CTRL, _Control(control)).value
        except OSError:
            return None
        return ControlSetting(value, limits.minimum, limits.maximum, limits.step)

    def set(self, control: int, value: int) -> None:
        """Request a value; the driver may round it."""
        self._ioctl(VIDIOC_S_CTRL, _Control(control, value))

    def start(self) -> None:
        """Map the buffers, queue them and start the stream."""
        request = self._ioctl(VIDIOC_REQBUFS, _Request(BUFFER_COUNT, BUF_CAPTURE, MEMORY_MMAP))
        for k in range(request.count):
            buffer = self._ioctl(VIDIOC_QUERYBUF, _Buffer(k, BUF_CAPTURE, memory=MEMORY_MMAP))
            self._maps.append(
                mmap.mmap(
                    self._fd, buffer.length, mmap.MAP_SHARED, mmap.PROT_READ,
                    offset=buffer.offset & 0xFFFF_FFFF,
                )
            )  # fmt: skip
            self._ioctl(VIDIOC_QBUF, buffer)
        self._ioctl(VIDIOC_STREAMON, int32(BUF_CAPTURE))

    @contextmanager
    def next_buffer(self, timeout_s: float) -> Iterator[FilledBuffer | None]:
        """Yield the next filled buffer, None at the timeout; it is given back afterwards."""
        if not self._poll.poll(timeout_s * 1e3):
            yield None
            return
        buffer = self._ioctl(VIDIOC_DQBUF, _Buffer(0, BUF_CAPTURE, memory=MEMORY_MMAP))
        t_s = None
        if buffer.flags & TIMESTAMP_MASK == TIMESTAMP_MONOTONIC:
            t_s = buffer.seconds + buffer.microseconds / 1e6
        with memoryview(self._maps[buffer.index])[: buffer.used] as data:
            yield FilledBuffer(data, buffer.sequence, t_s, bool(buffer.flags & BUF_FLAG_ERROR))
        self._ioctl(VIDIOC_QBUF, buffer)

    def close(self) -> None:
        if self._fd >= 0:
            fd, self._fd = self._fd, -1
            with suppress(OSError):  # disconnected
                fcntl.ioctl(fd, VIDIOC_STREAMOFF, bytes(int32(BUF_CAPTURE)))
            for mapped in self._maps:
                mapped.close()
            os.close(fd)

    def _ioctl(self, request: int, about: Any) -> Any:
        fcntl.ioctl(self._fd, request, about)
        return about
